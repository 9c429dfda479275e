#pragma once
// Rotations and rigid motions: products, exponential and logarithm, roll/pitch/yaw, turning and orthonormalisation in
// place.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "evmarker/base/vector.hpp"

namespace evmarker {

namespace detail {

/// The coefficients of Rodrigues' formula R = I + first K + second K^2 for a rotation vector r, where K b = r x b:
/// first = sin(angle) / angle, second = (1 - cos(angle)) / angle^2.
struct RodriguesCoefficients {
  double first, second;
};

inline RodriguesCoefficients rodrigues(double angle2) {
  // Taylor series below 1e-4 rad^2, where 1 - cos(angle) loses digits; the terms left out are under 1e-15.
  if (angle2 < 1e-4)
    return {1 - angle2 / 6 * (1 - angle2 / 20 * (1 - angle2 / 42)),
            0.5 - angle2 / 24 * (1 - angle2 / 30 * (1 - angle2 / 56))};
  const double angle = std::sqrt(angle2);
  return {std::sin(angle) / angle, (1 - std::cos(angle)) / angle2};
}

}  // namespace detail

/// The matrix product `A * B`, as a plain function: it compiles once, Eigen's operator once for every expression type.
inline Eigen::Matrix3d product(const Eigen::Matrix3d& A, const Eigen::Matrix3d& B) noexcept {
  Eigen::Matrix3d C;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < 3; ++i) C(i, k) = A(i, 0) * B(0, k) + A(i, 1) * B(1, k) + A(i, 2) * B(2, k);
  return C;
}
/// The matrix product `A.transpose() * B`.
inline Eigen::Matrix3d transposed_product(const Eigen::Matrix3d& A, const Eigen::Matrix3d& B) noexcept {
  Eigen::Matrix3d C;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < 3; ++i) C(i, k) = A(0, i) * B(0, k) + A(1, i) * B(1, k) + A(2, i) * B(2, k);
  return C;
}

/// The matrix product `A * B.transpose()`.
inline Eigen::Matrix3d product_with_transposed(const Eigen::Matrix3d& A, const Eigen::Matrix3d& B) noexcept {
  Eigen::Matrix3d C;
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < 3; ++i) C(i, k) = A(i, 0) * B(k, 0) + A(i, 1) * B(k, 1) + A(i, 2) * B(k, 2);
  return C;
}
/// The rigid motion `A * B`.
inline Eigen::Isometry3d product(const Eigen::Isometry3d& A, const Eigen::Isometry3d& B) noexcept {
  Eigen::Isometry3d C = A;
  for (int i = 0; i < 3; ++i) set_axis(C, i, rotate(A, axis(B, i)));
  set_translation(C, transform(A, translation(B)));
  return C;
}
/// The rigid motion `T.inverse()`.
inline Eigen::Isometry3d inverse(const Eigen::Isometry3d& T) noexcept {
  const Vec3 x = axis(T, 0), y = axis(T, 1), z = axis(T, 2), t = translation(T);
  Eigen::Isometry3d result = T;
  set_axis(result, 0, {x.x, y.x, z.x});
  set_axis(result, 1, {x.y, y.y, z.y});
  set_axis(result, 2, {x.z, y.z, z.z});
  set_translation(result, {-dot(x, t), -dot(y, t), -dot(z, t)});
  return result;
}

/// Rotation matrix of a rotation vector [rad], by Rodrigues' formula; exact to rounding for every angle.
inline Eigen::Matrix3d so3_exp(const Eigen::Vector3d& rotation) {
  const Vec3 r = rotation;
  const auto [a, b] = detail::rodrigues(squared_norm(r));
  const Vec3 ar = a * r, br = b * r;
  Eigen::Matrix3d R;
  R << 1 - (br.z * r.z + br.y * r.y), br.y * r.x - ar.z, br.z * r.x + ar.y,  //
      br.x * r.y + ar.z, 1 - (br.z * r.z + br.x * r.x), br.z * r.y - ar.x,   //
      br.x * r.z - ar.y, br.y * r.z + ar.x, 1 - (br.y * r.y + br.x * r.x);
  return R;
}

/// Rotation vector [rad] of a rotation matrix, its length in [0, pi].
inline Eigen::Vector3d so3_log(const Eigen::Matrix3d& R) {
  // The quaternion is accurate near 0 and near pi; the formula with the trace of R is not.
  const Eigen::Quaterniond q(R);
  const double sign = q.w() < 0 ? -1 : 1, w = sign * q.w();
  const Vec3 v = sign * Vec3(q.x(), q.y(), q.z());
  const double n = norm(v);
  if (n < 1e-12) return 2 * v;
  return 2 * std::atan2(n, w) / n * v;
}

/// Angle [rad] of the rotation from `a` to `b`, in [0, pi].
inline double geodesic_angle(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return norm(Vec3(so3_log(transposed_product(a, b))));
}

/// Roll, pitch, yaw [rad] with `R = Rz(yaw) Ry(pitch) Rx(roll)`; pitch in [-pi/2, pi/2].
inline Eigen::Vector3d roll_pitch_yaw(const Eigen::Matrix3d& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}

/// The equivalent of an angle [rad] in [-pi, pi].
inline double wrap_angle(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

/// True if a matrix is a rotation: R^T R = I to within 1e-6 in each element, and not mirrored.
inline bool is_rotation(const Eigen::Matrix3d& R) {
  constexpr double kTolerance = 1e-6;
  const Eigen::Matrix3d square = transposed_product(R, R);
  for (int i = 0; i < 9; ++i)
    if (!(std::abs(square.data()[i] - (i % 4 == 0 ? 1 : 0)) <= kTolerance)) return false;
  const Vec3 x(R(0, 0), R(1, 0), R(2, 0)), y(R(0, 1), R(1, 1), R(2, 1)), z(R(0, 2), R(1, 2), R(2, 2));
  return dot(cross(x, y), z) > 0;
}

// The next two functions work in place, column by column. With a temporary matrix, the processor would load pairs of
// numbers that were stored one by one, and such a load waits until the stores have reached the cache.

/// Rotates a frame about its own origin by the rotation vector r [rad]: R becomes so3_exp(r) R, the translation stays.
inline void turn(Eigen::Isometry3d& T, Vec3 r) noexcept {
  const auto [a, b] = detail::rodrigues(squared_norm(r));
  for (int i = 0; i < 3; ++i) {
    const Vec3 column = axis(T, i), moved = cross(r, column);
    set_axis(T, i, column + a * moved + b * cross(r, moved));
  }
}

/// Brings the rotation part back to SO(3), from which rounding has taken it slightly: one Newton step of the polar
/// decomposition, R becomes R (3 I - R^T R) / 2.
inline void orthonormalize(Eigen::Isometry3d& T) noexcept {
  const Vec3 x = axis(T, 0), y = axis(T, 1), z = axis(T, 2);
  const double xy = dot(x, y), yz = dot(y, z), zx = dot(z, x);
  set_axis(T, 0, 0.5 * ((3 - dot(x, x)) * x - xy * y - zx * z));
  set_axis(T, 1, 0.5 * ((3 - dot(y, y)) * y - xy * x - yz * z));
  set_axis(T, 2, 0.5 * ((3 - dot(z, z)) * z - zx * x - yz * y));
}

}  // namespace evmarker
