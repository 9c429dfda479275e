#pragma once
// A printed marker as a camera sees it at one pose.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "evmarker/simulation/printed_marker.hpp"

namespace evmarker {

/// Line of sight of a pixel and its change from pixel to pixel. In single precision, so that many fit the processor's
/// cache: that moves a pixel by less than 1e-4 px, and always by the same.
struct Sight {
  Eigen::Vector2f m;
  Eigen::Matrix2f per_px;
};

/// How far [px] around a line of sight a fisheye lens shows a plane in one scale, to a tenth.
/// @param focal_length [px]
inline double fisheye_reach_px(const Sight& sight, double focal_length) {
  const double tangent = static_cast<double>(sight.m.norm());  // the scale goes with 1 + tangent^2
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
    const double facing = T.linear().col(2).dot(T.translation());
    const bool edge_on = !(std::abs(facing) > 1e-6 * T.translation().norm());
    if (!T.matrix().allFinite() || edge_on) return;
    back_ = facing > 0;

    const double cell = length / print.cells();
    Eigen::Matrix3d camera_from_lattice;  // top left corner of the black square, one cell right, one cell down
    camera_from_lattice.col(0) = T.linear().col(0) * cell;
    camera_from_lattice.col(1) = T.linear().col(1) * -cell;
    camera_from_lattice.col(2) = T * Eigen::Vector3d(-length / 2, length / 2, 0);
    lattice_ = camera_from_lattice.inverse();

    const double nearest = 0.01 * length, extent = print.last_edge() - print.first_edge();
    bool whole = true;
    for (std::size_t i = 0; i < probes_.size(); ++i) {
      const double column = static_cast<double>(i % 5) / 4, row = static_cast<double>(i / 5) / 4;
      const Eigen::Vector3d point = camera_from_lattice * Eigen::Vector3d(print.first_edge() + extent * column,
                                                                          print.first_edge() + extent * row, 1);
      const bool in_front = point.z() > nearest;
      visible_ = visible_ || in_front;
      whole = whole && in_front;
      probes_[i] = in_front ? Eigen::Vector2d(point.head<2>() / point.z())
                            : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
    }
    radius_ = whole ? 0 : std::numeric_limits<double>::infinity();
    if (!whole) return;
    center_ = probes_[12];
    for (const auto& point : probes_) radius_ = std::max(radius_, (point - center_).norm());
  }

  bool visible() const noexcept { return visible_; }
  /// Whether the blank side faces the camera.
  bool back() const noexcept { return back_; }
  /// Points of the sheet on the plane z = 1, NaN behind the camera.
  const std::array<Eigen::Vector2d, 25>& probes() const noexcept { return probes_; }

  /// Distance [px] of a line of sight from a circle around the sheet; negative inside.
  double distance_px(const Sight& sight) const {
    return ((sight.m.cast<double>() - center_).norm() - radius_) / static_cast<double>(sight.per_px.norm());
  }

  /// @param point_spread_px sigma of the blur
  Sample sample(const PrintedMarker& print, const Sight& sight, double point_spread_px) const {
    // Clearances are linear extrapolations: kept on the safe side of lens and perspective. A pixel may sleep until its
    // light has changed by 1 %, and then takes the change as part of a ramp: on paper an edge of ink may come closer
    // than on ink an edge of paper.
    const auto safe = [&](double distance_px, bool on_paper) {
      return 0.85 * distance_px - (on_paper ? 2.3 : 3.1) * point_spread_px;
    };
    if (!visible_) return {0, 0, 0, std::numeric_limits<double>::infinity()};
    const Eigen::Vector2d m = sight.m.cast<double>();
    if ((m - center_).squaredNorm() > radius_ * radius_)
      if (const double to_circle = safe(distance_px(sight), false); to_circle > 0) return {0, 0, 0, to_circle};
    const Eigen::Vector3d h = lattice_ * m.homogeneous();
    if (!(h.z() > 0)) return {};  // the sheet's plane is behind the camera here
    const double depth = 1 / h.z(), a = h.x() * depth, b = h.y() * depth;
    const auto gradient = [&](Eigen::Index row, double value) {  // [cells/px]
      const double per_mx = lattice_(row, 0) - value * lattice_(2, 0);
      const double per_my = lattice_(row, 1) - value * lattice_(2, 1);
      const double per_x = per_mx * sight.per_px(0, 0) + per_my * sight.per_px(1, 0);
      const double per_y = per_mx * sight.per_px(0, 1) + per_my * sight.per_px(1, 1);
      return std::sqrt(per_x * per_x + per_y * per_y) * depth;
    };
    const double gradient_a = gradient(0, a), gradient_b = gradient(1, b);
    if (!(std::isfinite(gradient_a) && std::isfinite(gradient_b) && gradient_a > 0 && gradient_b > 0)) return {};
    const double sigma_a = gradient_a * point_spread_px, sigma_b = gradient_b * point_spread_px;
    const auto sheet = back_ ? print.back(a, b, sigma_a, sigma_b) : print.front(a, b, sigma_a, sigma_b);
    const double distance_px = sheet.clearance / std::max(gradient_a, gradient_b);
    return {h.z(), sheet.coverage, sheet.radiance, safe(distance_px, 2 * sheet.radiance > print.white())};
  }

 private:
  bool visible_ = false, back_ = false;
  Eigen::Matrix3d lattice_;       // line of sight -> homogeneous lattice coordinates, third = inverse depth
  Eigen::Vector2d center_{0, 0};  // circle around the sheet on the plane z = 1
  double radius_ = 0;             // infinite where part of the sheet is behind the camera
  std::array<Eigen::Vector2d, 25> probes_;
};

}  // namespace evmarker
