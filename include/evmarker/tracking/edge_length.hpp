#pragma once
// How long the edges in sight are in the image.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "evmarker/model/marker_model.hpp"

namespace evmarker {

/// The length in the image of the edges that a camera sees, side by side of a body: sides that are turned away show
/// none. Of a side seen at an angle, edges along the axis of its tilt keep their length, those across it are shortened
/// by the cosine of the angle, and half of each are taken for all.
class EdgeLength {
 public:
  /// @param focal_length [px]
  EdgeLength(const MarkerModel& model, double focal_length) : focal_length_(focal_length) {
    for (const MarkerSegment& segment : model.segments) {
      const Vec3 from = model.vertices[static_cast<std::size_t>(segment.from)],
                 to = model.vertices[static_cast<std::size_t>(segment.to)];
      Side& side = side_of(segment.face_normal, from);
      const double length = norm(to - from);
      side.middle = side.middle + 0.5 * length * (from + to);
      side.length += length;
    }
    for (Side& side : sides_) side.middle = side.middle / side.length;
  }

  /// Of all edges in sight [px]; 0 if none is.
  double px(const Eigen::Isometry3d& T_camera_model) const noexcept {
    double length_px = 0;
    for (const Side& side : sides_) {
      const Vec3 middle = transform(T_camera_model, side.middle);
      const double seen_px = focal_length_ / middle.z * side.length;
      const bool from_everywhere = squared_norm(side.normal) == 0;
      const double cosine = -dot(rotate(T_camera_model, side.normal), middle) / norm(middle);
      if (from_everywhere)
        length_px += seen_px;
      else if (cosine > 0)
        length_px += seen_px * (1 + cosine) / 2;
    }
    return length_px;
  }

 private:
  // The edges on a plane that is seen from the front only; or, with the normal 0, those that are seen from everywhere.
  struct Side {
    Vec3 normal;
    double distance;    // of the plane from the origin [m]
    Vec3 middle{};      // of its edges [m]
    double length = 0;  // of all of them [m]
  };

  Side& side_of(Vec3 normal, Vec3 point) {
    constexpr double kSame = 1e-6;
    const double distance = dot(normal, point);
    const auto same = [&](const Side& side) {
      return norm(side.normal - normal) < kSame && std::abs(side.distance - distance) < kSame;
    };
    const auto known = std::ranges::find_if(sides_, same);
    if (known != sides_.end()) return *known;
    sides_.push_back({.normal = normal, .distance = distance});
    return sides_.back();
  }

  double focal_length_;
  std::vector<Side> sides_;
};

}  // namespace evmarker
