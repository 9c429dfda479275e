#pragma once
// How a pose moves between events: constant velocity that fades, driven by white acceleration.
#include <algorithm>
#include <cmath>

namespace evmarker {

/// A discretised Ornstein-Uhlenbeck velocity: s(t + dt) = F s(t) + w, cov(w) = Q, for s = [pose; velocity], with
/// F = [I, pose_by_velocity I; 0, velocity_kept I], and Q = q [q_pose, q_cross; q_cross, q_velocity] for white
/// acceleration of density q [m^2/s^3]. With tau the time constant of the velocity, x = |dt| / tau, f = 1 - exp(-x):
///
///     pose_by_velocity = tau f,  velocity_kept = 1 - f
///     q_pose = tau^3 (x - f - f^2 / 2),  q_cross = tau^2 f^2 / 2,  q_velocity = tau (f - f^2 / 2)
///
/// which for short times are dt, 1, dt^3 / 3, dt^2 / 2 and dt. For a negative dt, a step back, pose_by_velocity and
/// q_cross change their signs; the others are those of |dt|.
struct MotionStep {
  double pose_by_velocity = 0, velocity_kept = 1;  ///< of F
  double q_pose = 0, q_cross = 0, q_velocity = 0;  ///< of Q, for q = 1
};

namespace detail {

// 1 - exp(-x) for x >= 0; for small x a series, which is faster than std::expm1.
inline double faded(double x) noexcept {
  if (x < 1.0 / 32) [[likely]]  // the next term is under 1e-14 of the sum
    return x * (1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6 * (1 - x / 7))))));
  return -std::expm1(-x);
}

}  // namespace detail

inline MotionStep motion_step(double dt, double tau) noexcept {
  const double x = std::abs(dt) / tau, f = detail::faded(x);
  const double cubic = std::max(0.0, x - f - f * f / 2);  // x^3 / 3 for small x, where rounding may make it negative
  return {std::copysign(tau * f, dt), 1 - f, tau * tau * tau * cubic, std::copysign(tau * tau * f * f / 2, dt),
          tau * (f - f * f / 2)};
}

}  // namespace evmarker
