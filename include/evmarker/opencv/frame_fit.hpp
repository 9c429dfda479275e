#pragma once
// opencv. How well a marker's pose agrees with a frame of last polarities, and the pose nearby that agrees best.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>

#include "evmarker/camera.hpp"
#include "evmarker/marker_model.hpp"
#include "evmarker/so3.hpp"

namespace evmarker::opencv {

/// What the edges of a model found in a frame.
struct FrameFit {
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
  double support = 0;  ///< share of the edges' length along which the frame steps from bright to dark
  double cost_px = 0;  ///< root mean square distance of the edges to these steps, a missing step counted as 2 px
};

namespace detail {

// 1 last seen brighter, -1 last seen darker, 0 nothing seen there, or outside the frame.
inline double brightness(const cv::Mat& frame, const Eigen::Vector2d& pixel) {
  if (!(pixel.x() > -0.5 && pixel.y() > -0.5 && pixel.x() < frame.cols - 0.5 && pixel.y() < frame.rows - 0.5)) return 0;
  return (frame.at<uchar>(static_cast<int>(pixel.y() + 0.5), static_cast<int>(pixel.x() + 0.5)) - 128) / 128.0;
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

}  // namespace detail

/// Moves a pose so that the model's edges fall on the steps from bright to dark in the frame (8 bit, 128 where nothing
/// was seen): Gauss-Newton with Huber weights over pose and one offset, by which all dark areas look too small because
/// pixels that sense the logarithm of light fire on the dark side of a blurred edge.
/// @param reach_px how far to each side of an edge its step is looked for
/// @return nothing where the model is not in front of the camera or the lens model has no image of it
template <CameraModel Camera>
std::optional<FrameFit> fit_to_frame(const Camera& camera, const cv::Mat& frame, const MarkerModel& model,
                                     const Eigen::Isometry3d& T_camera_marker, double reach_px, int iterations = 5) {
  using Vector7d = Eigen::Matrix<double, 7, 1>;
  using Matrix7d = Eigen::Matrix<double, 7, 7>;
  constexpr double kSampleDistancePx = 2, kMissingPx = 2, kHuberPx = 1;
  FrameFit fit{.T_camera_marker = T_camera_marker};
  double offset_px = 0;
  for (int iteration = 0;; ++iteration) {
    const Eigen::Isometry3d T = fit.T_camera_marker;
    Matrix7d H = Matrix7d::Zero();
    Vector7d b = Vector7d::Zero();
    double squares = 0;
    int samples = 0, found = 0;
    for (const MarkerSegment& segment : model.segments) {
      const Eigen::Vector3d from = T * model.vertices[static_cast<std::size_t>(segment.from)];
      const Eigen::Vector3d to = T * model.vertices[static_cast<std::size_t>(segment.to)];
      const Eigen::Vector3d dark_side = T.linear() * segment.dark_side;
      if (!(from.z() > 0 && to.z() > 0)) return std::nullopt;
      const double length_px = (camera.project(to) - camera.project(from)).norm();
      if (!(length_px < 1e4)) return std::nullopt;
      const int count = std::max(1, static_cast<int>(length_px / kSampleDistancePx));
      for (int i = 0; i < count; ++i) {
        const Eigen::Vector3d E = from + (i + 0.5) / count * (to - from);
        const Eigen::Vector2d e = camera.project(E);
        const double h = 1e-6 * E.z();
        Eigen::Matrix<double, 2, 3> de_dE;
        for (int k = 0; k < 3; ++k) de_dE.col(k) = (camera.project(E + h * Eigen::Vector3d::Unit(k)) - e) / h;
        const Eigen::Vector2d along = (de_dE * (to - from)).normalized();
        Eigen::Vector2d normal(-along.y(), along.x());
        if (normal.dot(de_dE * dark_side) < 0) normal = -normal;
        if (!normal.allFinite() || !e.allFinite()) return std::nullopt;
        ++samples;
        const auto step = detail::find_step(frame, e, normal, reach_px);
        if (!step) continue;
        ++found;
        const double d = *step - offset_px;
        const Eigen::Vector3d g = (normal.transpose() * de_dE).transpose();
        Vector7d J;
        J << g, (E - T.translation()).cross(g), 1;
        const double weight = kHuberPx / std::max(kHuberPx, std::abs(d));
        H += weight * J * J.transpose();
        b += weight * d * J;
        squares += std::min(d * d, kMissingPx * kMissingPx);
      }
    }
    if (samples == 0) return std::nullopt;
    fit.support = static_cast<double>(found) / samples;
    fit.cost_px = std::sqrt((squares + kMissingPx * kMissingPx * (samples - found)) / samples);
    if (iteration >= iterations || found < 12) return fit;
    // The offset stays near zero where only an outline is seen: there it cannot be told from the distance.
    constexpr double kOffsetWeight = 10;
    H(6, 6) += kOffsetWeight;
    b(6) -= kOffsetWeight * offset_px;
    const Vector7d scale = H.diagonal().cwiseMax(1e-9).cwiseSqrt().cwiseInverse();  // metres, radians, pixels
    const Matrix7d damped = Matrix7d(scale.asDiagonal() * H * scale.asDiagonal()) + 1e-4 * Matrix7d::Identity();
    const Vector7d dx = scale.cwiseProduct(damped.ldlt().solve(scale.cwiseProduct(b)));
    if (!dx.allFinite()) return std::nullopt;
    fit.T_camera_marker.translation() += dx.head<3>();
    fit.T_camera_marker.linear() = orthonormalized(so3_exp(dx.segment<3>(3)) * T.linear());
    offset_px += dx(6);
  }
}

/// Share of a code marker's area, border included, that the frame shows as black or white as the code demands; pixels
/// at which nothing was seen count against it. Looks at the middle of every cell.
template <CameraModel Camera>
double code_agreement(const Camera& camera, const cv::Mat& frame, const CodeBits& bits, double length,
                      const Eigen::Isometry3d& T_camera_marker) {
  constexpr int kSamples = 5;
  const int cells = static_cast<int>(bits.rows()) + 2;
  const double cell = length / cells;
  int right = 0;
  for (int row = 0; row < cells; ++row)
    for (int column = 0; column < cells; ++column) {
      const bool border = row == 0 || column == 0 || row == cells - 1 || column == cells - 1;
      const bool white = !border && bits(row - 1, column - 1) != 0;
      for (int i = 0; i < kSamples; ++i)
        for (int j = 0; j < kSamples; ++j) {
          const double u = 0.2 + 0.6 * (i + 0.5) / kSamples, v = 0.2 + 0.6 * (j + 0.5) / kSamples;
          const Eigen::Vector3d point((column + u) * cell - length / 2, length / 2 - (row + v) * cell, 0);
          const double seen = detail::brightness(frame, camera.project(T_camera_marker * point));
          right += white ? seen > 0.5 : seen < -0.5;
        }
    }
  return static_cast<double>(right) / (cells * cells * kSamples * kSamples);
}

}  // namespace evmarker::opencv
