#pragma once
// The image of a board's marker by OpenCV's projection, with its derivatives by camera and pose.
#include <ceres/ceres.h>

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <evmarker/evmarker.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <vector>

#include "board_corners.hpp"
#include "corner_errors.hpp"

enum class LensModel { radtan, fisheye };

/// fx, fy, cx, cy [px], then k1, k2, p1, p2 (radtan) or k1, k2, k3, k4 (fisheye), then the scale of the distances
/// between the markers of the board, which is 1 unless it is estimated too.
using Intrinsics = std::array<double, 9>;

inline constexpr std::size_t kPitch = 8;

namespace detail {

// A marker's corners by OpenCV's projection [px], with the derivatives by the intrinsics and by the board's pose. In
// the image the board's y axis points up; OpenCV's rotation vectors are at their best where it points down.
struct ProjectedMarker {
  Eigen::Matrix<double, 8, 1> px;
  Eigen::Matrix<double, 8, 9> by_intrinsics;
  Eigen::Matrix<double, 8, 6> by_pose;  // rotation vector, translation
};

inline std::vector<cv::Point3d> object_points(const evmarker::BoardMarker& marker, double pitch) {
  std::vector<cv::Point3d> points;
  for (const evmarker::Vec3 corner : corners_of(marker, pitch)) points.emplace_back(corner.x, -corner.y, -corner.z);
  return points;
}

inline ProjectedMarker project_marker(const evmarker::BoardMarker& marker, const double* k, const double* pose,
                                      LensModel model) {
  const cv::Matx33d K(k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1);
  const cv::Vec4d lens(k[4], k[5], k[6], k[7]);
  const cv::Vec3d r(pose[0], pose[1], pose[2]), t(pose[3], pose[4], pose[5]);
  std::vector<cv::Point2d> pixels;
  cv::Mat J;
  const bool fisheye = model == LensModel::fisheye;
  if (fisheye)
    cv::fisheye::projectPoints(object_points(marker, k[kPitch]), pixels, r, t, K, lens, 0, J);
  else
    cv::projectPoints(object_points(marker, k[kPitch]), r, t, K, lens, pixels, J);
  // Columns: OpenCV has r, t, f, c, k for pinholes; f, c, k, r, t, skew for fisheyes.
  const int at_f = fisheye ? 0 : 6, at_r = fisheye ? 8 : 0, at_t = at_r + 3;
  cv::Matx33d R;
  cv::Rodrigues(r, R);
  const evmarker::Vec3 centre = evmarker::translation(marker.T_board_marker);
  const cv::Vec3d moved = R * cv::Vec3d(centre.x, -centre.y, -centre.z);  // of the corners, by the scale
  ProjectedMarker projected;
  for (int row = 0; row < 8; ++row) {
    projected.px(row) = row % 2 == 0 ? pixels[std::size_t(row) / 2].x : pixels[std::size_t(row) / 2].y;
    for (int i = 0; i < 8; ++i) projected.by_intrinsics(row, i) = J.at<double>(row, at_f + i);
    projected.by_intrinsics(row, kPitch) = 0;
    for (int i = 0; i < 3; ++i) {
      projected.by_pose(row, i) = J.at<double>(row, at_r + i);
      projected.by_pose(row, 3 + i) = J.at<double>(row, at_t + i);
      projected.by_intrinsics(row, kPitch) += J.at<double>(row, at_t + i) * moved[i];
    }
  }
  return projected;
}

// The distances of a marker's corners, off by the errors that all share, from where they are seen [px].
class CornerDistances : public ceres::SizedCostFunction<8, 9, 6, int(CornerErrors::kCount)> {
 public:
  CornerDistances(const SeenMarker& seen, LensModel model, const CornerErrors& errors)
      : seen_(seen), model_(model), by_errors_(errors.by_px(seen)) {}

  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
    const ProjectedMarker projected = project_marker(*seen_.marker, parameters[0], parameters[1], model_);
    const Eigen::Matrix<double, 8, 1> errors = by_errors_ * Eigen::Map<const CornerErrors::Vector>(parameters[2]);
    for (int row = 0; row < 8; ++row) {
      const evmarker::Vec2 corner = seen_.corners_px[std::size_t(row) / 2];
      residuals[row] = projected.px(row) + errors(row) - (row % 2 == 0 ? corner.x : corner.y);
    }
    if (jacobians == nullptr) return true;
    const auto give = [](double* to, const auto& J) {
      if (to == nullptr) return;
      for (Eigen::Index row = 0; row < J.rows(); ++row)
        for (Eigen::Index column = 0; column < J.cols(); ++column) *to++ = J(row, column);
    };
    give(jacobians[0], projected.by_intrinsics);
    give(jacobians[1], projected.by_pose);
    give(jacobians[2], by_errors_);
    return true;
  }

 private:
  SeenMarker seen_;
  LensModel model_;
  CornerErrors::Jacobian by_errors_;
};

}  // namespace detail
