#pragma once
// The paper's tracker, equation by equation and without optimisation, to be read beside the paper.
//
// Loch, Haessig, Vincze: Event-based high-speed low-latency fiducial marker tracking. Where its notation has slips, the
// code has what is meant, with a comment. Every event is compared with every segment and every system goes to Eigen's
// general solvers; the library's `DecoupledUpdate` takes the same steps many times faster.
#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"

namespace evmarker::paper {

/// The paper's numbers.
struct Gains {
  double w0 = 0.1;                 ///< weight of one event in the averages
  double lambda_T = 1.4;           ///< of Eq. (10)
  double lambda_r = 0.003;         ///< of the torque
  double unit_m = 0.01;            ///< unit of length of that torque: lambda_r is meant for centimetres
  int n = 100;                     ///< matched events between two updates
  double max_distance_px = 2;      ///< of an event from its segment, Eq. (1)
  double end_margin_px = 0.5;      ///< how far beyond the ends of a segment its foot may lie
  double ambiguity_px = 0.2;       ///< by how much the next segment must be farther
  int k = 100;                     ///< updates forward before the way back; 0 for none
  double max_translation_px = 5;   ///< epsilon_T
  double max_rotation_rad = 0.15;  ///< epsilon_R
};

/// Eqs. (13), (14).
struct BackwardError {
  double translation_px, rotation_rad;
};

/// Follows one marker from a known pose on.
class Tracker {
 public:
  Tracker(const PinholeCamera& camera, MarkerModel model, const Eigen::Isometry3d& T_camera_marker,
          const Gains& gains = {})
      : camera_(camera),
        model_(std::move(model)),
        R_(T_camera_marker.linear()),
        T_(T_camera_marker.translation()),
        gains_(gains),
        verifies_(gains.k > 0),
        start_(T_camera_marker) {
    project();
  }

  /// A pose every n matched events.
  std::optional<Eigen::Isometry3d> push(const Event& event) {
    if (verifies_) window_.push_back(event);
    const Eigen::Vector2d u(event.x, event.y);
    const std::optional<std::size_t> segment = nearest_segment(u);
    if (!segment) return std::nullopt;

    const Eigen::Vector3d M = camera_.line_of_sight(u);                     // Eq. (2)
    const Eigen::Vector3d V = P_[index(model_.segments[*segment].from)];    // the paper's V_i
    const Eigen::Vector3d S = P_[index(model_.segments[*segment].to)] - V;  // V_j - V_i
    Eigen::Matrix2d system;                                                 // Eq. (5)
    system << M.dot(M), -M.dot(S), M.dot(S), -S.dot(S);
    const Eigen::Vector2d a = system.fullPivLu().solve(Eigen::Vector2d(M.dot(V), S.dot(V)));
    const Eigen::Vector3d E = V + std::clamp(a(1), 0.0, 1.0) * S;  // Eq. (4), from V_i, not from V_j
    const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d L = M * M.transpose() / M.dot(M);                       // Eq. (6)
    A_ = gains_.w0 * (I - L) + (1 - gains_.w0) * A_;                              // Eq. (8)
    B_ = gains_.w0 * (L - I) * E + (1 - gains_.w0) * B_;                          // Eq. (9), E for F: (L - I) F is zero
    Gamma_ = gains_.w0 * (E - T_).cross((L - I) * E) + (1 - gains_.w0) * Gamma_;  // Eq. (11), likewise
    lever2_ = gains_.w0 * (E - T_).squaredNorm() + (1 - gains_.w0) * lever2_;

    if (++matched_ < gains_.n) return std::nullopt;
    matched_ = 0;
    update();
    if (verifies_ && ++updates_ == gains_.k) verify();
    return pose();
  }

  Eigen::Isometry3d pose() const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = R_;
    T.translation() = T_;
    return T;
  }

  /// Of the last way back, if there was one.
  const std::optional<BackwardError>& backward_error() const { return backward_error_; }
  bool verified() const {
    return backward_error_ && backward_error_->translation_px < gains_.max_translation_px &&
           backward_error_->rotation_rad < gains_.max_rotation_rad;
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  // Eq. (1): the nearest segment, if it is near, has the foot of the event, and no other is about as near.
  std::optional<std::size_t> nearest_segment(const Eigen::Vector2d& u) const {
    double best = std::numeric_limits<double>::infinity(), second = best;
    std::optional<std::size_t> nearest;
    for (std::size_t i = 0; i < model_.segments.size(); ++i) {
      const Eigen::Vector2d& v = p_[index(model_.segments[i].from)];
      const Eigen::Vector2d s = p_[index(model_.segments[i].to)] - v;
      const double foot = (u - v).dot(s.normalized());
      if (foot < -gains_.end_margin_px || foot > s.norm() + gains_.end_margin_px) continue;
      const double distance = std::abs(s.x() * (v.y() - u.y()) - (v.x() - u.x()) * s.y()) / s.norm();
      if (distance < best) {
        second = std::exchange(best, distance);
        nearest = i;
      } else if (distance < second) {
        second = distance;
      }
    }
    if (best > gains_.max_distance_px || second - best < gains_.ambiguity_px) return std::nullopt;
    return nearest;
  }

  void update() {
    const double renewed = std::min(1.0, gains_.n * gains_.w0);  // share of the averages that is new
    const double unit2 = gains_.unit_m > 0 ? gains_.unit_m * gains_.unit_m : lever2_;
    const Eigen::Vector3d dT = A_.fullPivLu().solve(B_);                                         // Eq. (7)
    T_ += renewed * gains_.lambda_T * dT;                                                        // Eq. (10)
    const Eigen::Vector3d r = renewed * gains_.lambda_r * Gamma_ / unit2;                        // r = lambda_r Gamma
    if (r.norm() > 0) R_ = Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix() * R_;  // Eq. (12)
    R_ = Eigen::Quaterniond(R_).normalized().toRotationMatrix();
    project();
  }

  // The way back over the events of k updates. The paper compares it with the pose at the end of the way forward;
  // that is another time, and the pose at its start is meant.
  void verify() {
    Gains gains = gains_;
    gains.k = 0;
    Tracker back(camera_, model_, pose(), gains);
    std::for_each(window_.rbegin(), window_.rend(), [&](const Event& event) { back.push(event); });
    const auto image = [&](const Eigen::Isometry3d& T) { return camera_.project(T.translation()); };
    const auto angles = [](const Eigen::Isometry3d& T) {
      const Eigen::Matrix3d R = T.linear();
      return Eigen::Vector3d(std::atan2(R(2, 1), R(2, 2)), -std::asin(std::clamp(R(2, 0), -1.0, 1.0)),
                             std::atan2(R(1, 0), R(0, 0)));  // roll, pitch, yaw
    };
    const Eigen::Vector3d turned = angles(start_) - angles(back.pose());
    backward_error_ = {
        (image(start_) - image(back.pose())).lpNorm<1>(),                                                 // Eq. (13)
        turned.unaryExpr([](double a) { return std::remainder(a, 2 * std::numbers::pi); }).lpNorm<1>()};  // Eq. (14)
    window_.clear();
    updates_ = 0;
    start_ = pose();
  }

  void project() {
    P_.clear();
    p_.clear();
    for (const Eigen::Vector3d& vertex : model_.vertices) {
      P_.push_back(R_ * vertex + T_);
      p_.push_back(camera_.project(P_.back()));
    }
  }

  PinholeCamera camera_;
  MarkerModel model_;
  Eigen::Matrix3d R_;
  Eigen::Vector3d T_;
  Gains gains_;
  bool verifies_;
  std::vector<Eigen::Vector3d> P_;  // vertices in the camera frame [m]
  std::vector<Eigen::Vector2d> p_;  // and in the image [px]
  Eigen::Matrix3d A_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d B_ = Eigen::Vector3d::Zero(), Gamma_ = Eigen::Vector3d::Zero();
  double lever2_ = 0;
  int matched_ = 0, updates_ = 0;
  std::vector<Event> window_;
  Eigen::Isometry3d start_;  // of the window
  std::optional<BackwardError> backward_error_;
};

}  // namespace evmarker::paper
