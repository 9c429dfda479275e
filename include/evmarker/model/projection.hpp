#pragma once
// The pinhole projection and its derivative.
#include "evmarker/base/vector.hpp"

namespace evmarker {

/// Where a point is seen on the plane z = 1.
constexpr Vec2 on_plane(Vec3 point) noexcept { return {point.x / point.z, point.y / point.z}; }

/// Where it is seen in the undistorted image [px from the principal point].
constexpr Vec2 image_point(Vec3 point, double focal_length) noexcept {
  return focal_length / point.z * Vec2(point.x, point.y);
}

/// How far a point's image moves along a unit normal, by the point [px/m]: the derivative of the projection.
constexpr Vec3 image_gradient(Vec2 normal, Vec3 point, double focal_length) noexcept {
  const double inverse_z = 1 / point.z, scale = focal_length * inverse_z;
  return {scale * normal.x, scale * normal.y, -scale * inverse_z * (normal.x * point.x + normal.y * point.y)};
}

}  // namespace evmarker
