#pragma once
// A printed marker as a camera sees it at one pose.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "evmarker/base/vector.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/simulation/printed_marker.hpp"

namespace evmarker {

/// Line of sight of a pixel and its change from pixel to pixel. In single precision, so that many fit the processor's
/// cache: that moves a pixel by less than 1e-4 px, and always by the same.
struct Sight {
  float x = 0, y = 0;                                        ///< (X/Z, Y/Z)
  float x_per_x = 0, y_per_x = 0, x_per_y = 0, y_per_y = 0;  ///< its change to the next pixel in x, and in y

  Vec2 m() const noexcept { return {x, y}; }
  bool shows() const noexcept { return std::isfinite(x) && std::isfinite(y); }
  float scale() const noexcept {
    return std::sqrt((x_per_x * x_per_x + x_per_y * x_per_y) + (y_per_x * y_per_x + y_per_y * y_per_y));
  }
};

/// How far [px] around a line of sight a fisheye lens shows a plane in one scale, to a tenth.
/// @param focal_length [px]
inline double fisheye_reach_px(const Sight& sight, double focal_length) {
  const double tangent =
      static_cast<double>(std::sqrt(sight.x * sight.x + sight.y * sight.y));  // the scale goes with 1 + tangent^2
  return focal_length * 0.5 * (std::sqrt(tangent * tangent + 0.2) - tangent);
}

/// The sheet of a marker at one pose.
class MarkerView {
 public:
  /// Light that the sheet adds to a pixel; the clearance is how far [px] its edges may move before that changes.
  struct Sample {
    double inverse_depth, coverage, radiance;
    double clearance_px;
  };

  /// Nothing to be seen.
  MarkerView() = default;

  /// @param length side of the black square [m]
  MarkerView(const PrintedMarker& print, double length, const Eigen::Isometry3d& T_camera_marker) {
    const auto& T = T_camera_marker;
    const double facing = dot(axis(T, 2), translation(T));
    const bool edge_on = !(std::abs(facing) > 1e-6 * norm(translation(T)));
    if (!is_finite(T) || edge_on) return;
    back_ = facing > 0;

    const double cell = length / print.cells();
    // One cell right, one cell down, top left corner of the black square.
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
    center_ = probes_[12];
    for (const Vec2& point : probes_) radius_ = std::max(radius_, norm(point - center_));
  }

  bool visible() const noexcept { return visible_; }
  /// True if the blank side faces the camera.
  bool back() const noexcept { return back_; }
  /// Points of the sheet on the plane z = 1, NaN behind the camera.
  const std::array<Vec2, 25>& probes() const noexcept { return probes_; }

  /// Distance [px] of a line of sight from a circle around the sheet; negative inside.
  double distance_px(const Sight& sight) const {
    return (norm(sight.m() - center_) - radius_) / static_cast<double>(sight.scale());
  }

  /// @param point_spread_px sigma of the blur
  Sample sample(const PrintedMarker& print, const Sight& sight, double point_spread_px) const {
    // Clearances are linear extrapolations: kept on the safe side of lens and perspective. A pixel may sleep until its
    // light has changed by 1 %, and then takes the change as part of a ramp: on paper an edge of ink may come closer
    // than on ink an edge of paper.
    const auto safe = [&](double distance_px, bool on_sheet) {
      return 0.85 * distance_px - (on_sheet ? 2.3 : 3.1) * point_spread_px;
    };
    if (!visible_) return {0, 0, 0, std::numeric_limits<double>::infinity()};
    const Vec2 m = sight.m();
    if (squared_norm(m - center_) > radius_ * radius_)
      if (const double to_circle = safe(distance_px(sight), false); to_circle > 0) return {0, 0, 0, to_circle};
    const auto at = [&](const Vec3& row) { return row.x * m.x + row.y * m.y + row.z; };
    const double inverse_depth = at(grid_[2]);
    if (!(inverse_depth > 0)) return {};  // the sheet's plane is behind the camera here
    const double depth = 1 / inverse_depth, a = at(grid_[0]) * depth, b = at(grid_[1]) * depth;
    const auto gradient = [&](std::size_t row, double value) {  // [cells/px]
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
    return {inverse_depth, sheet.coverage, sheet.radiance, safe(distance_px, 2 * sheet.radiance > print.white())};
  }

 private:
  bool visible_ = false, back_ = false;
  std::array<Vec3, 3> grid_;  // line of sight -> homogeneous grid coordinates, third = inverse depth
  Vec2 center_;               // circle around the sheet on the plane z = 1
  double radius_ = 0;         // infinite where part of the sheet is behind the camera
  std::array<Vec2, 25> probes_;
};

}  // namespace evmarker
