#pragma once
// Fits the pose of a board to the corners of its detected markers.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>
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

// Calls `use(P, residual_px, from_centre)` for every corner of the seen markers: with its place P by pose T [m, camera
// frame], the vector from the image of P to where the corner was detected, and that from its marker's centre to P [m].
template <typename Use>
void for_each_corner(const Eigen::Isometry3d& T, const std::vector<SeenMarker>& seen_markers, double focal_length,
                     Use&& use) {
  for (const SeenMarker& marker : seen_markers) {
    const Vec3 centre = transform(T, translation(marker.marker->T_board_marker));
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3 P = transform(T, marker.corners[i]);
      use(P, focal_length * (marker.seen[i] - on_plane(P)), P - centre);
    }
  }
}

// The row [g, lever x g] of a measurement with gradient g: what moves and turns the board changes it by so much.
inline std::array<double, 6> pose_row(Vec3 g, Vec3 lever) { return Vec6(g, cross(lever, g)).array(); }

// Normal equations H x = b of N unknowns.
template <std::size_t N>
struct NormalEquations {
  typename Cholesky<N>::Matrix H{};
  typename Cholesky<N>::Vector b{};

  NormalEquations() {
    for (std::size_t i = 0; i < N; ++i) H[i][i] = 1e-9;  // invertible even where the corners leave a direction free
  }

  void add(const std::array<double, N>& row, double residual_px, double weight) {
    for (std::size_t k = 0; k < N; ++k) {
      for (std::size_t i = 0; i < N; ++i) H[k][i] += weight * row[i] * row[k];
      b[k] += weight * row[k] * residual_px;
    }
  }
};

inline constexpr double kOutlier_px = 4;  // distance at which a corner's weight has fallen to a half

// Cauchy's.
inline double corner_weight(Vec2 residual_px) {
  return 1 / (1 + squared_norm(residual_px) / (kOutlier_px * kOutlier_px));
}

}  // namespace detail

/// Fits a board's pose to the corners of all seen markers, by Gauss-Newton with Cauchy weights.
/// @param start T_camera_board to start from
/// @param seen_markers one at least
/// @param focal_length [px]
inline BoardFit fit_board(const Eigen::Isometry3d& start, const std::vector<SeenMarker>& seen_markers,
                          double focal_length) {
  Eigen::Isometry3d T = start;
  for (int iteration = 0; iteration < 10; ++iteration) {
    detail::NormalEquations<6> equations;
    detail::for_each_corner(T, seen_markers, focal_length, [&](Vec3 P, Vec2 residual_px, Vec3) {
      const double weight = detail::corner_weight(residual_px);
      const Vec3 lever = P - translation(T);
      equations.add(detail::pose_row(image_gradient({1, 0}, P, focal_length), lever), residual_px.x, weight);
      equations.add(detail::pose_row(image_gradient({0, 1}, P, focal_length), lever), residual_px.y, weight);
    });
    const Vec6 step = Cholesky<6>(equations.H).solve(equations.b);
    if (!is_finite(step)) break;
    set_translation(T, translation(T) + step.t);
    turn(T, step.r);
    orthonormalize(T);
  }
  // Limited, so that no single far corner decides between two poses.
  constexpr double kMost_px = 2 * detail::kOutlier_px;
  double cost = 0;
  int corners = 0;
  detail::for_each_corner(T, seen_markers, focal_length, [&](Vec3, Vec2 residual_px, Vec3) {
    cost += std::min(squared_norm(residual_px), kMost_px * kMost_px);
    ++corners;
  });
  return {T, std::sqrt(cost / corners)};
}

/// How large the markers of a board are seen, each about its own centre, as a share of their size in the board's file.
/// Where the distances between the markers are wrong in the file, they make up for it.
struct MarkerScale {
  double value = 1;
  double sigma = 0;  ///< by the corners' distances from the fit
};

/// Fits the scale of all markers together with a correction of the board's pose, in one step.
/// @param T T_camera_board that fits the markers best
/// @param seen_markers two at least
/// @param focal_length [px]
inline MarkerScale fit_marker_scale(const Eigen::Isometry3d& T, const std::vector<SeenMarker>& seen_markers,
                                    double focal_length) {
  constexpr std::size_t kUnknowns = 7, kScale = 6;
  struct Measurement {
    std::array<double, kUnknowns> row;
    double residual_px, weight;
  };
  std::vector<Measurement> measurements;
  detail::NormalEquations<kUnknowns> equations;
  detail::for_each_corner(T, seen_markers, focal_length, [&](Vec3 P, Vec2 residual_px, Vec3 from_centre) {
    for (const auto& [axis, residual] : {std::pair{Vec2{1, 0}, residual_px.x}, std::pair{Vec2{0, 1}, residual_px.y}}) {
      const Vec3 g = image_gradient(axis, P, focal_length);
      Measurement measurement{{}, residual, detail::corner_weight(residual_px)};
      std::ranges::copy(detail::pose_row(g, P - translation(T)), measurement.row.begin());
      measurement.row[kScale] = dot(g, from_centre);
      equations.add(measurement.row, residual, measurement.weight);
      measurements.push_back(measurement);
    }
  });
  const Cholesky<kUnknowns> factors(equations.H);
  const auto solution = factors.solve(equations.b);
  double squares = 0;
  for (const auto& [row, residual_px, weight] : measurements)
    squares += weight * std::pow(residual_px - std::inner_product(row.begin(), row.end(), solution.begin(), 0.0), 2);
  const double variance_px2 = squares / static_cast<double>(measurements.size() - kUnknowns);
  Cholesky<kUnknowns>::Vector of_scale{};
  of_scale[kScale] = 1;
  return {1 + solution[kScale], std::sqrt(variance_px2 * factors.solve(of_scale)[kScale])};
}

}  // namespace evmarker
