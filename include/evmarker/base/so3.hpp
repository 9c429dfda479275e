#pragma once
// Rotations: skew matrices, exponential and logarithm, roll/pitch/yaw.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace evmarker {

/// The matrix with `skew(a) * b == a x b`.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

namespace detail {

/// sin(angle) / angle and (1 - cos(angle)) / angle^2: Rodrigues' formula is I + first K + second K^2, K = skew(r).
struct RodriguesCoefficients {
  double first, second;
};

inline RodriguesCoefficients rodrigues(double angle2) {
  // Taylor series below 1e-4 rad^2, where (1 - cos) / angle^2 would cancel; the next terms are under 1e-15.
  if (angle2 < 1e-4)
    return {1 - angle2 / 6 * (1 - angle2 / 20 * (1 - angle2 / 42)),
            0.5 - angle2 / 24 * (1 - angle2 / 30 * (1 - angle2 / 56))};
  const double angle = std::sqrt(angle2);
  return {std::sin(angle) / angle, (1 - std::cos(angle)) / angle2};
}

}  // namespace detail

/// Rotation matrix of a rotation vector [rad] (Rodrigues' formula, exact to rounding for every angle).
inline Eigen::Matrix3d so3_exp(const Eigen::Vector3d& r) {
  const auto [a, b] = detail::rodrigues(r.squaredNorm());
  const Eigen::Matrix3d k = skew(r);
  return Eigen::Matrix3d::Identity() + a * k + b * k * k;
}

/// Rotation vector [rad] of a rotation matrix, its length in [0, pi].
inline Eigen::Vector3d so3_log(const Eigen::Matrix3d& R) {
  // Through the quaternion: no loss near 0 and none near pi, where the trace formula has both.
  Eigen::Quaterniond q(R);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double n = q.vec().norm();
  if (n < 1e-12) return 2 * q.vec();
  return 2 * std::atan2(n, q.w()) / n * q.vec();
}

/// Angle [rad] of the rotation from `a` to `b`, in [0, pi].
inline double geodesic_angle(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return so3_log(a.transpose() * b).norm();
}

/// Roll, pitch, yaw [rad] with `R = Rz(yaw) Ry(pitch) Rx(roll)`; pitch in [-pi/2, pi/2].
inline Eigen::Vector3d roll_pitch_yaw(const Eigen::Matrix3d& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}

/// An angle [rad] moved by whole turns into [-pi, pi].
inline double wrap_angle(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

/// The rotation nearest to a matrix that rounding has taken slightly off SO(3): one Newton step of the polar
/// decomposition.
inline Eigen::Matrix3d orthonormalized(const Eigen::Matrix3d& R) {
  return 0.5 * R * (3 * Eigen::Matrix3d::Identity() - R.transpose() * R);
}

/// `so3_exp(r) * R`, without a matrix for the turn.
inline Eigen::Matrix3d turned(const Eigen::Matrix3d& R, const Eigen::Vector3d& r) {
  const auto [a, b] = detail::rodrigues(r.squaredNorm());
  Eigen::Matrix3d result;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d moved = r.cross(R.col(i));
    result.col(i) = R.col(i) + a * moved + b * r.cross(moved);
  }
  return result;
}

/// The same for a step of many: rounding errors do not add up. The rotation is made orthonormal before the turn, not
/// after it, so that who waits for the step does not wait for that.
inline Eigen::Matrix3d rotated(const Eigen::Matrix3d& R, const Eigen::Vector3d& r) {
  return turned(orthonormalized(R), r);
}

}  // namespace evmarker
