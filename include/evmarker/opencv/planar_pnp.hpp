#pragma once
// The two poses of a square marker that nearly explain the same image of its corners.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/dark_quads.hpp"

namespace evmarker::opencv {

/// Both planar solutions for the corners of a square marker (IPPE), the better one first; empty if the lens model has
/// no line of sight for a corner.
/// @param corners in the distorted image, from the marker's top left clockwise [px]
/// @param length side of the square [m]
/// @return T_camera_marker
template <CameraModel Camera>
std::vector<Eigen::Isometry3d> solve_planar_pnp(const Camera& camera, const Quad& corners, double length) {
  // OpenCV's rotation vectors are wrong near half a turn. So the problem is solved for a square whose y and z axes
  // point as the camera's, and whose first corner is the one nearest to the image's top left.
  const double h = length / 2;
  const std::vector<cv::Point3d> points{{-h, -h, 0}, {h, -h, 0}, {h, h, 0}, {-h, h, 0}};
  const auto upper_left = std::ranges::min_element(corners, {}, [](Vec2 p) { return p.x + p.y; });
  const std::ptrdiff_t quarter_turns = upper_left - corners.begin();
  std::vector<cv::Point2d> undistorted;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d M = camera.line_of_sight(corners[(i + static_cast<std::size_t>(quarter_turns)) % 4]);
    if (!is_finite(Vec3(M))) return {};
    undistorted.emplace_back(M.x(), M.y());
  }
  Eigen::Matrix3d R_square_marker = so3_exp({0, 0, -std::numbers::pi / 2 * static_cast<double>(quarter_turns)});
  for (int i = 3; i < 9; ++i) R_square_marker.data()[i] *= -1;  // the marker's y is up, its z toward the camera
  std::vector<cv::Mat> rotations, translations;
  cv::solvePnPGeneric(points, undistorted, cv::Matx33d::eye(), cv::noArray(), rotations, translations, false,
                      cv::SOLVEPNP_IPPE);
  std::vector<Eigen::Isometry3d> poses;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    const cv::Vec3d r = rotations[i], t = translations[i];
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = product(so3_exp({r[0], r[1], r[2]}), R_square_marker);
    set_translation(T, {t[0], t[1], t[2]});
    if (is_finite(T) && t[2] > 0) poses.push_back(T);
  }
  return poses;
}

}  // namespace evmarker::opencv
