#pragma once
// How well a marker's pose agrees with a frame of last polarities, and the pose nearby that agrees best.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"

namespace evmarker::opencv {

/// What the edges of a model found in a frame.
struct FrameFit {
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
  double support = 0;    ///< share of the edges' length along which the frame steps from bright to dark
  double cost_px = 0;    ///< root mean square distance of the edges to these steps, a missing step counted as 2 px
  double offset_px = 0;  ///< how far inside the dark areas the steps lie: more than 0 where these look too small
};

namespace detail {

// 1 last seen brighter, -1 last seen darker, 0 nothing seen there, or outside the frame.
inline double brightness(const cv::Mat& frame, const Eigen::Vector2d& pixel) {
  if (!(pixel.x() > -0.5 && pixel.y() > -0.5 && pixel.x() < frame.cols - 0.5 && pixel.y() < frame.rows - 0.5)) return 0;
  return (frame.at<uchar>(cvRound(pixel.y()), cvRound(pixel.x())) - 128) / 128.0;
}

// Signed distance [px] along the normal from `at` to the place with the most brightness before and darkness behind it;
// nothing where less than half of the way looks like that, or the step is at the end of the reach.
inline std::optional<double> find_step(const cv::Mat& frame, const Eigen::Vector2d& at, const Eigen::Vector2d& normal,
                                       double reach_px) {
  constexpr double kStride = 0.5;  // [px]
  const int reach = static_cast<int>(std::lround(reach_px / kStride));
  const auto seen = [&](int i) { return brightness(frame, at + kStride * i * normal); };
  double score = 0;
  for (int i = -reach; i <= reach; ++i) score -= seen(i);
  double best = reach + 0.5;  // half of the 2 reach + 1 samples
  int ties = 0, sum = 0;
  for (int i = -reach; i <= reach; ++i) {  // bright before sample i, dark from it on
    if (score > best) best = score, ties = sum = 0;
    if (score == best) ++ties, sum += i;
    score += 2 * seen(i);
  }
  if (ties == 0) return std::nullopt;
  const double step = static_cast<double>(sum) / ties - 0.5;
  if (std::abs(step) > reach - 1) return std::nullopt;
  return kStride * step;
}

using Vector7d = Eigen::Matrix<double, 7, 1>;  // translation [m], rotation [rad], offset [px]
using Matrix7d = Eigen::Matrix<double, 7, 7>;

// A point of an edge and how its image moves.
struct EdgePoint {
  Eigen::Vector3d E;       // [m, camera frame]
  Eigen::Vector2d e;       // its pixel
  Eigen::Vector2d normal;  // of the edge in the image, toward the dark side
  Eigen::Vector3d g;       // d(normal . e) / dE [px/m]
};

// Nothing where the lens model has no image of the point.
template <CameraModel Camera>
std::optional<EdgePoint> project_edge(const Camera& camera, const Eigen::Vector3d& E, const Eigen::Vector3d& S,
                                      const Eigen::Vector3d& dark_side) {
  const Eigen::Vector2d e = camera.project(E);
  const double h = 1e-6 * E.z();
  Eigen::Matrix<double, 2, 3> de_dE;
  for (int k = 0; k < 3; ++k) de_dE.col(k) = (camera.project(E + h * Eigen::Vector3d::Unit(k)) - e) / h;
  const Eigen::Vector2d along = (de_dE * S).normalized();
  Eigen::Vector2d normal(-along.y(), along.x());
  if (normal.dot(de_dE * dark_side) < 0) normal = -normal;
  if (!normal.allFinite() || !e.allFinite()) return std::nullopt;
  return EdgePoint{E, e, normal, (normal.transpose() * de_dE).transpose()};
}

// Calls `visit` with points along all edges of a model, 2 px apart; false where the camera does not see one of them.
template <CameraModel Camera, typename Visit>
bool for_each_edge_point(const Camera& camera, const MarkerModel& model, const Eigen::Isometry3d& T, Visit&& visit) {
  constexpr double kDistancePx = 2;
  for (const MarkerSegment& segment : model.segments) {
    const Eigen::Vector3d from = T * model.vertices[static_cast<std::size_t>(segment.from)];
    const Eigen::Vector3d to = T * model.vertices[static_cast<std::size_t>(segment.to)];
    const Eigen::Vector3d dark_side = T.linear() * segment.dark_side;
    if (!(from.z() > 0 && to.z() > 0)) return false;
    const double length_px = (camera.project(to) - camera.project(from)).norm();
    if (!(length_px < 1e4)) return false;
    const int count = std::max(1, static_cast<int>(length_px / kDistancePx));
    for (int i = 0; i < count; ++i) {
      const auto point = project_edge(camera, from + (i + 0.5) / count * (to - from), to - from, dark_side);
      if (!point) return false;
      visit(*point);
    }
  }
  return true;
}

// Sums over the points of all edges: how far each is from its step, and the normal equations that bring them there.
class EdgeResiduals {
 public:
  void add_missing() { ++points_; }

  void add(const EdgePoint& point, const Eigen::Vector3d& origin, double distance_px) {
    constexpr double kHuberPx = 1;
    Vector7d J;
    J << point.g, (point.E - origin).cross(point.g), 1;
    const double weight = kHuberPx / std::max(kHuberPx, std::abs(distance_px));
    H_ += weight * J * J.transpose();
    b_ += weight * distance_px * J;
    squares_ += std::min(distance_px * distance_px, kMissingPx * kMissingPx);
    ++points_;
    ++found_;
  }

  int points() const { return points_; }
  int found() const { return found_; }
  double support() const { return static_cast<double>(found_) / points_; }
  double cost_px() const { return std::sqrt((squares_ + kMissingPx * kMissingPx * (points_ - found_)) / points_); }

  // The Gauss-Newton step, damped in units that make translation, rotation and offset comparable.
  Vector7d step(double offset_px) const {
    // The offset stays near zero where only an outline is seen: there it cannot be told from the distance.
    constexpr double kOffsetWeight = 10, kDamping = 1e-4;
    Matrix7d H = H_;
    Vector7d b = b_;
    H(6, 6) += kOffsetWeight;
    b(6) -= kOffsetWeight * offset_px;
    const Vector7d scale = H.diagonal().cwiseMax(1e-9).cwiseSqrt().cwiseInverse();
    const Matrix7d damped = Matrix7d(scale.asDiagonal() * H * scale.asDiagonal()) + kDamping * Matrix7d::Identity();
    return scale.cwiseProduct(damped.ldlt().solve(scale.cwiseProduct(b)));
  }

  // How far a step moves the edges, root mean square.
  double moved_px(const Vector7d& step) const { return std::sqrt(step.dot(H_ * step) / found_); }

 private:
  static constexpr double kMissingPx = 2;

  Matrix7d H_ = Matrix7d::Zero();
  Vector7d b_ = Vector7d::Zero();
  double squares_ = 0;
  int points_ = 0, found_ = 0;
};

// Nothing where the camera does not see the model.
template <CameraModel Camera>
std::optional<EdgeResiduals> compare(const Camera& camera, const cv::Mat& frame, const MarkerModel& model,
                                     const FrameFit& fit, double reach_px) {
  EdgeResiduals residuals;
  const Eigen::Isometry3d& T = fit.T_camera_marker;
  const bool seen = for_each_edge_point(camera, model, T, [&](const EdgePoint& point) {
    if (const auto step = find_step(frame, point.e, point.normal, reach_px))
      residuals.add(point, T.translation(), *step - fit.offset_px);
    else
      residuals.add_missing();
  });
  if (!seen || residuals.points() == 0) return std::nullopt;
  return residuals;
}

}  // namespace detail

/// Moves a pose so that the model's edges fall on the steps from bright to dark in the frame (8 bit, 128 where nothing
/// was seen): Gauss-Newton with Huber weights over pose and one offset, by which all dark areas look too small because
/// pixels that sense the logarithm of light fire on the dark side of a blurred edge.
/// @param reach_px how far to each side of an edge its step is looked for
/// @return the pose as it was where the frame shows hardly a step (see `support`); nothing where the model is not in
/// front of the camera or the lens model has no image of it
template <CameraModel Camera>
std::optional<FrameFit> fit_to_frame(const Camera& camera, const cv::Mat& frame, const MarkerModel& model,
                                     const Eigen::Isometry3d& T_camera_marker, double reach_px, int iterations = 10) {
  constexpr int kFewestSteps = 12;
  constexpr double kConverged_px = 0.02;
  FrameFit fit{.T_camera_marker = T_camera_marker};
  for (int iteration = 0;; ++iteration) {
    const auto residuals = detail::compare(camera, frame, model, fit, reach_px);
    if (!residuals) return std::nullopt;
    fit.support = residuals->support();
    fit.cost_px = residuals->cost_px();
    if (iteration >= iterations || residuals->found() < kFewestSteps) return fit;

    const detail::Vector7d dx = residuals->step(fit.offset_px);
    if (!dx.allFinite()) return std::nullopt;
    if (residuals->moved_px(dx) < kConverged_px) return fit;
    fit.T_camera_marker.translation() += dx.head<3>();
    fit.T_camera_marker.linear() = orthonormalized(so3_exp(dx.segment<3>(3)) * fit.T_camera_marker.linear());
    fit.offset_px += dx(6);
  }
}

/// What a frame shows of a code marker at a pose.
struct CodeReading {
  double agreement = 0;  ///< share of the area, border included, that is black or white as the code demands
  int contradicted = 0;  ///< cells that look mostly like the opposite
};

/// Compares the middle of every cell of a code marker, `length` wide [m], with what its code demands; pixels at which
/// nothing was seen agree with nothing and contradict nothing.
template <CameraModel Camera>
CodeReading read_code(const Camera& camera, const cv::Mat& frame, const CodeBits& bits, double length,
                      const Eigen::Isometry3d& T_camera_marker) {
  constexpr int kSide = 5, kSamples = kSide * kSide;
  const int cells = static_cast<int>(bits.rows()) + 2;
  const double cell = length / cells;
  CodeReading reading;
  int agreeing = 0;
  for (int row = 0; row < cells; ++row)
    for (int column = 0; column < cells; ++column) {
      const bool border = row == 0 || column == 0 || row == cells - 1 || column == cells - 1;
      const bool white = !border && bits(row - 1, column - 1) != 0;
      int right = 0, wrong = 0;
      for (int i = 0; i < kSide; ++i)
        for (int j = 0; j < kSide; ++j) {
          const double u = 0.2 + 0.6 * (i + 0.5) / kSide, v = 0.2 + 0.6 * (j + 0.5) / kSide;
          const Eigen::Vector3d point((column + u) * cell - length / 2, length / 2 - (row + v) * cell, 0);
          const Eigen::Vector3d P = T_camera_marker * point;
          const double seen = P.z() > 0 ? detail::brightness(frame, camera.project(P)) : 0;
          right += white ? seen > 0.5 : seen < -0.5;
          wrong += white ? seen < -0.5 : seen > 0.5;
        }
      agreeing += right;
      reading.contradicted += wrong > right;
    }
  reading.agreement = agreeing / static_cast<double>(cells * cells * kSamples);
  return reading;
}

}  // namespace evmarker::opencv
