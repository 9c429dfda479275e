#pragma once
// The yardstick: the paper's tracker as one writes it down from the (corrected) equations, without any trick.
#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/camera.hpp"
#include "evmarker/event.hpp"
#include "evmarker/marker_model.hpp"

namespace evmarker::bench {

/// Same corrections, gains and gates as `SegmentMatcher` and `DecoupledUpdate`, so that the same events give about the
/// same poses; no verification. Every event asks every segment; every system goes to Eigen's general solvers.
class ReferenceTracker {
 public:
  ReferenceTracker(const PinholeCamera& camera, MarkerModel model, const Eigen::Isometry3d& T_camera_marker, int n)
      : camera_(camera),
        model_(std::move(model)),
        R_(T_camera_marker.linear()),
        T_(T_camera_marker.translation()),
        n_(n) {
    w0_ = std::min(0.1, 1.0 / n);
    project();
  }

  /// A pose every n matched events.
  std::optional<Eigen::Isometry3d> push(const Event& event) {
    const Eigen::Vector2d u(event.x, event.y);
    const std::optional<std::size_t> segment = nearest_segment(u);
    if (!segment) return std::nullopt;

    const Eigen::Vector3d M = camera_.line_of_sight(u);  // Eq. (2)
    const Eigen::Vector3d V = P_[static_cast<std::size_t>(model_.segments[*segment].from)];
    const Eigen::Vector3d S = P_[static_cast<std::size_t>(model_.segments[*segment].to)] - V;
    Eigen::Matrix2d system;  // Eq. (5), from the vertex that Eq. (4) starts at
    system << M.dot(M), -M.dot(S), M.dot(S), -S.dot(S);
    const Eigen::Vector2d a = system.fullPivLu().solve(Eigen::Vector2d(M.dot(V), S.dot(V)));
    const Eigen::Vector3d E = V + std::clamp(a(1), 0.0, 1.0) * S;  // Eq. (4)
    const Eigen::Matrix3d L = M * M.transpose() / M.dot(M);        // Eq. (6)
    const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
    A_ = w0_ * (I - L) + (1 - w0_) * A_;                              // Eq. (8)
    B_ = w0_ * (L - I) * E + (1 - w0_) * B_;                          // Eq. (9), E for F
    Gamma_ = w0_ * (E - T_).cross((L - I) * E) + (1 - w0_) * Gamma_;  // Eq. (11), E for F
    lever2_ = w0_ * (E - T_).squaredNorm() + (1 - w0_) * lever2_;

    if (++matched_ < n_) return std::nullopt;
    matched_ = 0;
    update();
    return pose();
  }

 private:
  // Eq. (1): the nearest segment, if it is near, has the foot of the event, and no other is about as near.
  std::optional<std::size_t> nearest_segment(const Eigen::Vector2d& u) const {
    double best = std::numeric_limits<double>::infinity(), second = best;
    std::optional<std::size_t> nearest;
    for (std::size_t i = 0; i < model_.segments.size(); ++i) {
      const Eigen::Vector2d& v = p_[static_cast<std::size_t>(model_.segments[i].from)];
      const Eigen::Vector2d s = p_[static_cast<std::size_t>(model_.segments[i].to)] - v;
      const double foot = (u - v).dot(s.normalized());
      if (foot < -kEndMargin || foot > s.norm() + kEndMargin) continue;
      const double distance = std::abs(s.x() * (v.y() - u.y()) - (v.x() - u.x()) * s.y()) / s.norm();
      if (distance < best) {
        second = std::exchange(best, distance);
        nearest = i;
      } else if (distance < second) {
        second = distance;
      }
    }
    if (best > kMaxDistance || second - best < kAmbiguity) return std::nullopt;
    return nearest;
  }

  void update() {
    const double renewed = std::min(1.0, n_ * w0_);
    const Eigen::Vector3d dT = A_.fullPivLu().solve(B_);                                         // Eq. (7)
    T_ += renewed * kTranslationGain * dT;                                                       // Eq. (10)
    const Eigen::Vector3d r = renewed * kRotationGain * Gamma_ / lever2_;                        // dimensionless
    if (r.norm() > 0) R_ = Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix() * R_;  // Eq. (12)
    R_ = Eigen::Quaterniond(R_).normalized().toRotationMatrix();
    project();
  }

  void project() {
    P_.clear();
    p_.clear();
    for (const Eigen::Vector3d& vertex : model_.vertices) {
      P_.push_back(R_ * vertex + T_);
      p_.push_back(camera_.project(P_.back()));
    }
  }

  Eigen::Isometry3d pose() const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = R_;
    T.translation() = T_;
    return T;
  }

  static constexpr double kMaxDistance = 2, kEndMargin = 0.5, kAmbiguity = 0.5;  // [px]
  static constexpr double kTranslationGain = 1.4, kRotationGain = 2;             // lambda_T, lambda_r

  PinholeCamera camera_;
  MarkerModel model_;
  Eigen::Matrix3d R_;
  Eigen::Vector3d T_;
  int n_;
  double w0_;
  std::vector<Eigen::Vector3d> P_;  // vertices in the camera frame [m]
  std::vector<Eigen::Vector2d> p_;  // and in the image [px]
  Eigen::Matrix3d A_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d B_ = Eigen::Vector3d::Zero(), Gamma_ = Eigen::Vector3d::Zero();
  double lever2_ = 0;
  int matched_ = 0;
};

}  // namespace evmarker::bench
