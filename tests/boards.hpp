#pragma once
// Boards that tests look at, track and measure: a plate, a cube's corner, a cube.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "evmarker/base/so3.hpp"
#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/board_calibration.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/simulation/trajectory.hpp"

namespace evmarker::boards {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr MarkerId kId = 100;
inline const auto kDictionary = opencv::make_dictionary("DICT_4X4_50");

inline Isometry3d pose(const Matrix3d& R, const Vector3d& translation) {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = R;
  T.translation() = translation;
  return T;
}
inline Matrix3d columns(const Vector3d& x, const Vector3d& y, const Vector3d& z) {
  return (Matrix3d() << x, y, z).finished();
}
inline BoardMarker marker(MarkerId id, double length, const Isometry3d& T_board_marker) {
  return {id, length, opencv::marker_bits(kDictionary, id), T_board_marker};
}

/// Four markers of 4 cm on a plate of 11 cm.
inline Board plate() {
  Board board{kId, {}};
  for (int i = 0; i < 4; ++i)
    board.markers.push_back(
        marker(1 + i, 0.04, pose(Matrix3d::Identity(), {i % 2 == 0 ? -0.035 : 0.035, i < 2 ? 0.035 : -0.035, 0})));
  return board;
}

/// Three markers of 5 cm on three sides of a cube of 8 cm that meet in a corner; their z out of it.
inline Board corner() {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  return {kId,
          {marker(11, 0.05, pose(columns(y, z, x), 0.04 * x)), marker(12, 0.05, pose(columns(z, x, y), 0.04 * y)),
           marker(13, 0.05, pose(columns(x, y, z), 0.04 * z))}};
}

/// The cube's corner towards the camera: all three sides 55 deg from it.
inline Isometry3d corner_ahead(double distance) {
  const Vector3d towards_camera = Vector3d::Ones().normalized();
  return pose(Eigen::Quaterniond::FromTwoVectors(towards_camera, -Vector3d::UnitZ()).toRotationMatrix(),
              {0, 0, distance});
}

constexpr double kCubeMarkerLength = 0.05;

/// Five sides of a cube of 8 cm with markers of 5 cm: front, right, left, top, bottom. The frame is that of marker 1.
inline Board cube() {
  const double quarter = std::numbers::pi / 2;
  Board board{kId, {}};
  for (const Vector3d& turned : {Vector3d(0, 0, 0), Vector3d(0, quarter, 0), Vector3d(0, -quarter, 0),
                                 Vector3d(-quarter, 0, 0), Vector3d(quarter, 0, 0)}) {
    const Matrix3d R = so3_exp(turned);
    board.markers.push_back(marker(1 + static_cast<MarkerId>(board.markers.size()), kCubeMarkerLength,
                                   pose(R, 0.04 * (R.col(2) - Vector3d::UnitZ()))));
  }
  return board;
}

/// In a hand that shows all sides of the cube in turn.
inline Trajectory turning(std::uint64_t seed) {
  constexpr double kDegree = std::numbers::pi / 180;
  return trajectory::handheld({.T_centre = facing_pose({0, 0, 0.45}),
                               .amplitude_m = {0.04, 0.032, 0.04},
                               .amplitude_rad = {130 * kDegree, 130 * kDegree, 30 * kDegree},
                               .frequency_hz = 0.25,
                               .seed = seed});
}

/// Of the worst marker, also in its standard deviations.
struct CalibrationError {
  double mm = 0, deg = 0, sigmas = 0;
};

inline CalibrationError worst_error(const BoardCalibration& calibration, const Board& board) {
  CalibrationError worst;
  for (std::size_t m = 1; m < board.markers.size(); ++m) {
    const CalibratedMarker& marker = calibration.markers[m];
    CHECK(marker.id == board.markers[m].id);
    const PoseError error = pose_error(marker.T_board_marker, board.markers[m].T_board_marker);
    worst.mm = std::max(worst.mm, error.translation_mm);
    worst.deg = std::max(worst.deg, error.rotation_deg);
    worst.sigmas = std::max({worst.sigmas, 1e-3 * error.translation_mm / marker.sigma_m,
                             std::numbers::pi / 180 * error.rotation_deg / marker.sigma_rad});
  }
  return worst;
}

}  // namespace evmarker::boards
