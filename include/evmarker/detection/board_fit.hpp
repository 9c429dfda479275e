#pragma once
// Fits the pose of a board to the corners of its detected markers.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "evmarker/base/cholesky.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// A detected marker of a board.
struct SeenMarker {
  const BoardMarker* marker;
  Timestamp t;
  std::vector<Eigen::Isometry3d> T_camera_board;  ///< by this marker alone: the likelier pose, then its alternative
  std::array<Vec3, 4> corners;                    ///< as printed, board frame [m]
  std::array<Vec2, 4> seen;                       ///< as detected, lines of sight (X/Z, Y/Z)
};

/// A fitted pose of a board.
struct BoardFit {
  Eigen::Isometry3d T_camera_board;
  double cost_px = 0;  ///< root mean square of the corners' distances, each limited to 8 px
};

namespace detail {

// Calls `use(P, residual_px)` for every corner of the seen markers: its place by pose T [m, camera frame], and the
// vector from the image of P to where the corner was detected.
template <typename Use>
void for_each_corner(const Eigen::Isometry3d& T, const std::vector<SeenMarker>& seen_markers, double focal_length,
                     Use&& use) {
  for (const SeenMarker& marker : seen_markers)
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3 P = transform(T, marker.corners[i]);
      use(P, focal_length * (marker.seen[i] - on_plane(P)));
    }
}

// Adds a measurement, with the row J = [g, lever x g], to the normal equations H x = b.
inline void add_row(Vec3 g, Vec3 lever, double residual_px, double weight, Cholesky<6>::Matrix& H,
                    Cholesky<6>::Vector& b) {
  const std::array<double, 6> J = Vec6(g, cross(lever, g)).array();
  for (std::size_t k = 0; k < 6; ++k) {
    for (std::size_t i = 0; i < 6; ++i) H[k][i] += weight * J[i] * J[k];
    b[k] += weight * J[k] * residual_px;
  }
}

}  // namespace detail

/// Fits a board's pose to the corners of all seen markers, by Gauss-Newton with Cauchy weights.
/// @param start T_camera_board to start from
/// @param seen_markers one at least
/// @param focal_length [px]
inline BoardFit fit_board(const Eigen::Isometry3d& start, const std::vector<SeenMarker>& seen_markers,
                          double focal_length) {
  constexpr double kOutlier_px = 4;
  Eigen::Isometry3d T = start;
  for (int iteration = 0; iteration < 10; ++iteration) {
    Cholesky<6>::Matrix H{};
    Cholesky<6>::Vector b{};
    for (std::size_t i = 0; i < 6; ++i) H[i][i] = 1e-9;  // invertible even where the corners leave a direction free
    detail::for_each_corner(T, seen_markers, focal_length, [&](Vec3 P, Vec2 residual_px) {
      const double weight = 1 / (1 + squared_norm(residual_px) / (kOutlier_px * kOutlier_px));
      detail::add_row(image_gradient({1, 0}, P, focal_length), P - translation(T), residual_px.x, weight, H, b);
      detail::add_row(image_gradient({0, 1}, P, focal_length), P - translation(T), residual_px.y, weight, H, b);
    });
    const Vec6 step = Cholesky<6>(H).solve(b);
    if (!is_finite(step)) break;
    set_translation(T, translation(T) + step.t);
    turn(T, step.r);
    orthonormalize(T);
  }
  // Limited, so that no single far corner decides between two poses.
  constexpr double kMost_px = 2 * kOutlier_px;
  double cost = 0;
  int corners = 0;
  detail::for_each_corner(T, seen_markers, focal_length, [&](Vec3, Vec2 residual_px) {
    cost += std::min(squared_norm(residual_px), kMost_px * kMost_px);
    ++corners;
  });
  return {T, std::sqrt(cost / corners)};
}

}  // namespace evmarker
