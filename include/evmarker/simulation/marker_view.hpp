#pragma once
// A printed marker in the view of a camera, at one pose.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "evmarker/base/vector.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/simulation/printed_marker.hpp"

namespace evmarker {

/// Line of sight of a pixel, as a point on the plane z = 1, and its change from pixel to pixel. In single precision, so
/// that many fit the processor's cache: rounding shifts a pixel by less than 1e-4 px, always by the same.
struct Sight {
  float x = 0, y = 0;                                        ///< (X/Z, Y/Z)
  float x_per_x = 0, y_per_x = 0, x_per_y = 0, y_per_y = 0;  ///< its change to the next pixel in x, and in y

  /// The point on the plane z = 1.
  Vec2 m() const noexcept { return {x, y}; }
  /// False if the lens model has no line of sight for the pixel.
  bool exists() const noexcept { return std::isfinite(x) && std::isfinite(y); }
  /// Distance on the plane z = 1 per pixel (Frobenius norm of the change, at least the largest over all directions).
  float scale() const noexcept {
    return std::sqrt((x_per_x * x_per_x + x_per_y * x_per_y) + (y_per_x * y_per_x + y_per_y * y_per_y));
  }
};

/// Radius [px] around a line of sight within which the scale of a fisheye lens changes by at most about a tenth.
/// @param focal_length [px]
inline double fisheye_reach_px(const Sight& sight, double focal_length) {
  // The scale is proportional to 1 + tangent^2.
  const double tangent = static_cast<double>(std::sqrt(sight.x * sight.x + sight.y * sight.y));
  return focal_length * 0.5 * (std::sqrt(tangent * tangent + 0.2) - tangent);
}

/// The printed sheet of a marker at one pose.
class MarkerView {
 public:
  /// What the sheet adds to a pixel.
  struct Sample {
    double inverse_depth;  ///< [1/m]
    double coverage;       ///< share of the pixel that the sheet covers
    double radiance;       ///< light from the sheet, weighted with the coverage
    double clearance_px;   ///< how far the sheet may move before the light changes; 0 if it changes with any motion
  };

  /// An invisible sheet.
  MarkerView() = default;

  /// An invisible sheet if the pose is not finite or the sheet is seen edge-on.
  /// @param length side of the black square [m]
  MarkerView(const PrintedMarker& print, double length, const Eigen::Isometry3d& T_camera_marker) {
    const auto& T = T_camera_marker;
    const double facing = dot(axis(T, 2), translation(T));
    const bool edge_on = !(std::abs(facing) > 1e-6 * norm(translation(T)));
    if (!is_finite(T) || edge_on) return;
    back_ = facing > 0;

    const double cell = length / print.cells();
    // In the camera frame: the way of one cell to the right and down, and the top left corner of the black square.
    const Vec3 right = cell * axis(T, 0), down = -cell * axis(T, 1),
               corner = transform(T, {-length / 2, length / 2, 0});
    const double inverse = 1 / dot(cross(down, corner), right);
    grid_ = {inverse * cross(down, corner), inverse * cross(corner, right), inverse * cross(right, down)};

    const double nearest = 0.01 * length, extent = print.last_edge() - print.first_edge();
    bool whole = true;
    for (std::size_t i = 0; i < probes_.size(); ++i) {
      const double column = static_cast<double>(i % 5) / 4, row = static_cast<double>(i / 5) / 4;
      const double a = print.first_edge() + extent * column, b = print.first_edge() + extent * row;
      const Vec3 point = a * right + b * down + corner;
      const bool in_front = point.z > nearest;
      visible_ = visible_ || in_front;
      whole = whole && in_front;
      constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
      probes_[i] = in_front ? on_plane(point) : Vec2(kNone, kNone);
    }
    radius_ = whole ? 0 : std::numeric_limits<double>::infinity();
    if (!whole) return;
    centre_ = probes_[12];
    for (const Vec2& point : probes_) radius_ = std::max(radius_, norm(point - centre_));
  }

  /// True if a part of the sheet is in front of the camera, in or out of its field of view.
  bool visible() const noexcept { return visible_; }
  /// True if the blank side faces the camera.
  bool back() const noexcept { return back_; }
  /// 5 x 5 points of the sheet, seen on the plane z = 1; NaN for those behind the camera.
  const std::array<Vec2, 25>& probes() const noexcept { return probes_; }

  /// Distance of a line of sight from a circle around the sheet [px]; negative inside.
  double distance_px(const Sight& sight) const {
    return (norm(sight.m() - centre_) - radius_) / static_cast<double>(sight.scale());
  }

  /// What a pixel sees of the sheet through a Gaussian blur.
  /// @param print the one that the view was made from
  /// @param point_spread_px sigma of the blur
  Sample sample(const PrintedMarker& print, const Sight& sight, double point_spread_px) const {
    // Distances to edges in px are extrapolated linearly; the factor keeps them safe from the effects of lens and
    // perspective. The simulator need not sample a pixel until its light has changed by 1 %, which an edge does from a
    // number of sigmas on: a dark edge must come closer to bright paper than a bright edge to dark ink.
    const auto safe_clearance = [&](double distance_px, bool on_paper) {
      return 0.85 * distance_px - (on_paper ? 2.3 : 3.1) * point_spread_px;
    };
    if (!visible_) return {0, 0, 0, std::numeric_limits<double>::infinity()};
    const Vec2 m = sight.m();
    if (squared_norm(m - centre_) > radius_ * radius_)
      if (const double to_circle = safe_clearance(distance_px(sight), false); to_circle > 0)
        return {0, 0, 0, to_circle};
    const auto product_with_sight = [&](const Vec3& row) { return row.x * m.x + row.y * m.y + row.z; };
    const double inverse_depth = product_with_sight(grid_[2]);
    if (!(inverse_depth > 0)) return {};  // the sheet's plane is behind the camera here
    const double depth = 1 / inverse_depth, a = product_with_sight(grid_[0]) * depth,
                 b = product_with_sight(grid_[1]) * depth;
    const auto gradient = [&](std::size_t row, double value) {  // norm of the change of a grid coordinate [cells/px]
      const double per_mx = grid_[row].x - value * grid_[2].x;
      const double per_my = grid_[row].y - value * grid_[2].y;
      const double per_x = per_mx * sight.x_per_x + per_my * sight.y_per_x;
      const double per_y = per_mx * sight.x_per_y + per_my * sight.y_per_y;
      return std::sqrt(per_x * per_x + per_y * per_y) * depth;
    };
    const double gradient_a = gradient(0, a), gradient_b = gradient(1, b);
    if (!(std::isfinite(gradient_a) && std::isfinite(gradient_b) && gradient_a > 0 && gradient_b > 0)) return {};
    const double sigma_a = gradient_a * point_spread_px, sigma_b = gradient_b * point_spread_px;
    const auto sheet = back_ ? print.back(a, b, sigma_a, sigma_b) : print.front(a, b, sigma_a, sigma_b);
    const double distance_px = sheet.clearance / std::max(gradient_a, gradient_b);
    return {inverse_depth, sheet.coverage, sheet.radiance,
            safe_clearance(distance_px, 2 * sheet.radiance > print.white())};
  }

 private:
  bool visible_ = false, back_ = false;
  std::array<Vec3, 3> grid_;  // maps a line of sight to homogeneous grid coordinates (a, b, 1) / depth
  Vec2 centre_;               // circle around the sheet on the plane z = 1
  double radius_ = 0;         // infinite where part of the sheet is behind the camera
  std::array<Vec2, 25> probes_;
};

}  // namespace evmarker
