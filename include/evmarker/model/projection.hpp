#pragma once
// The pinhole projection and its derivative.
#include "evmarker/base/vector.hpp"

namespace evmarker {

/// Image of a point [camera frame] on the plane z = 1: (X/Z, Y/Z).
constexpr Vec2 on_plane(Vec3 point) noexcept { return {point.x / point.z, point.y / point.z}; }

/// Image of a point in the undistorted image [px from the principal point].
constexpr Vec2 image_point(Vec3 point, double focal_length) noexcept {
  return focal_length / point.z * Vec2(point.x, point.y);
}

/// Derivative, by the point, of the place of its image along a unit normal [px/m].
constexpr Vec3 image_gradient(Vec2 normal, Vec3 point, double focal_length) noexcept {
  const double inverse_z = 1 / point.z, scale = focal_length * inverse_z;
  return {scale * normal.x, scale * normal.y, -scale * inverse_z * (normal.x * point.x + normal.y * point.y)};
}

}  // namespace evmarker
