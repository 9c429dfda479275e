#pragma once
// Errors that the corners of all markers share.
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "board_corners.hpp"

/// Errors that the corners of all markers share, in motion or at rest. They are small, but taken for the lens they
/// would bend it: they are estimated with the camera. Blur rounds corners, and edges are seen toward their dark side:
/// corners lie too near the middle of their marker. And edges are seen behind where they are, as pixels answer late. By
/// how much depends on the speed along the edge's normal: a delay alone would be proportional to it, but slow pixels
/// lag by less the faster an edge is, and one contrast step is as far at any speed. What is proportional to it is left
/// out: so the whole board seems to be where it was a little earlier, which changes no camera.
struct CornerErrors {
  static constexpr std::size_t kSpeeds = 4, kCount = 1 + kSpeeds;
  using Vector = Eigen::Matrix<double, int(kCount), 1>;
  using Jacobian = Eigen::Matrix<double, 8, int(kCount)>;

  double fastest_px_per_s = 1;
  /// How far the corners are seen toward the middle of their marker; then how far the edges lag at a sixteenth, an
  /// eighth, a fourth and a half of the fastest speed, beyond a delay by which they would not lag at the fastest.
  std::array<double, kCount> px{};

  /// No errors yet, for views whose velocities are known.
  static CornerErrors none(const std::vector<BoardCorners>& views) {
    std::vector<double> speeds{1};  // at least
    for (const BoardCorners& view : views)
      for (const SeenMarker& seen : view.markers)
        for (const evmarker::Vec2 velocity : seen.px_per_s) speeds.push_back(norm(velocity));
    const auto nearly_fastest = speeds.begin() + static_cast<std::ptrdiff_t>(0.999 * double(speeds.size() - 1));
    std::ranges::nth_element(speeds, nearly_fastest);
    return {.fastest_px_per_s = std::max(1.0, *nearly_fastest)};
  }

  /// By how much each corner (x and y of the first, of the second, ...) is off for a pixel of each error.
  Jacobian by_px(const SeenMarker& seen) const {
    const auto at = [&](std::size_t i) { return Eigen::Vector2d(seen.corners_px[i]); };
    const Eigen::Vector2d right = at(1) - at(0) + at(2) - at(3), down = at(3) - at(0) + at(2) - at(1);
    Eigen::Matrix2d normals;  // of the edges, in rows
    normals << Eigen::RowVector2d(-down.y(), down.x()).normalized(),
        Eigen::RowVector2d(-right.y(), right.x()).normalized();
    const Eigen::Matrix2d from_normals = normals.inverse();
    const Eigen::Vector2d middle = 0.25 * (at(0) + at(1) + at(2) + at(3));
    Jacobian moved;
    for (std::size_t i = 0; i < 4; ++i) {
      auto corner = moved.middleRows<2>(static_cast<Eigen::Index>(2 * i));
      corner.setZero();
      corner.col(0) = (middle - at(i)).normalized();
      const Eigen::Vector2d px_per_s = normals * Eigen::Vector2d(seen.px_per_s[i]);
      for (Eigen::Index edge = 0; edge < 2; ++edge)
        for (std::size_t k = 0; k < kSpeeds; ++k)
          corner.col(static_cast<Eigen::Index>(1 + k)) -=
              std::copysign(share_of(k, std::abs(px_per_s[edge])), px_per_s[edge]) * from_normals.col(edge);
    }
    return moved;
  }
  /// By how much each corner is off.
  Eigen::Matrix<double, 8, 1> of(const SeenMarker& seen) const {
    return by_px(seen) * Eigen::Map<const Vector>(px.data());
  }

 private:
  double speed(std::size_t k) const { return std::ldexp(fastest_px_per_s, static_cast<int>(k) - int(kSpeeds)); }

  // Between the speeds, the lag is interpolated: the share of that at speed number k. There is none at rest, nor at the
  // fastest speed.
  double share_of(std::size_t k, double px_per_s) const {
    const double below = k == 0 ? 0 : speed(k - 1), here = speed(k), above = speed(k + 1);
    return std::max(0.0, px_per_s < here ? (px_per_s - below) / (here - below) : (above - px_per_s) / (above - here));
  }
};
