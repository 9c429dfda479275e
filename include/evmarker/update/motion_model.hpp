#pragma once
// How a pose moves between events: constant velocity that fades, driven by white acceleration.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace evmarker {

/// A discretised Ornstein-Uhlenbeck velocity along each of six axes: s(t + dt) = F s(t) + w, cov(w) = Q, for s = [pose;
/// velocity], with F = [1, pose_by_velocity; 0, velocity_kept], and Q = q [q_pose, q_cross; q_cross, q_velocity] for
/// white acceleration of density q [m^2/s^3]. With r the rate at which the velocity fades, x = r |dt|, f = 1 - exp(-x):
///
///     pose_by_velocity = f / r,  velocity_kept = 1 - f
///     q_pose = (x - f - f^2 / 2) / r^3,  q_cross = f^2 / (2 r^2),  q_velocity = (f - f^2 / 2) / r
///
/// which for short times are dt, 1, dt^3 / 3, dt^2 / 2 and dt. For a negative dt, a step back, pose_by_velocity and
/// q_cross change their signs; the others are those of |dt|.
struct MotionStep {
  std::array<double, 6> pose_by_velocity{}, velocity_kept{1, 1, 1, 1, 1, 1};  ///< of F
  std::array<double, 6> q_pose{}, q_cross{}, q_velocity{};                    ///< of Q, for q = 1
};

namespace detail {

inline constexpr double kShort = 1.0 / 1024;  // of x: below, series are exact to 1e-9, and faster

// (1 - exp(-x)) / x for small x: the mean share of a velocity that is left while it fades to exp(-x).
[[gnu::always_inline]] inline double mean_kept_series(double x) noexcept { return 1 - x / 2 * (1 - x / 3); }

// Set what a step is along axis k.
[[gnu::always_inline]] inline void set_short(MotionStep& step, std::size_t k, double dt, double fading) noexcept {
  const double duration = std::abs(dt), x = duration * fading, mean = mean_kept_series(x);
  step.pose_by_velocity[k] = dt * mean;
  step.velocity_kept[k] = 1 - x * mean;
  step.q_pose[k] = duration * duration * duration / 3 * (1 - x * (3.0 / 4 - x * 7 / 20));
  step.q_cross[k] = dt * duration / 2 * mean * mean;
  step.q_velocity[k] = duration * mean * (1 - x * mean / 2);
}
inline void set_long(MotionStep& step, std::size_t k, double dt, double fading) noexcept {
  const double x = std::abs(dt) * fading, f = -std::expm1(-x), tau = 1 / fading;
  step.pose_by_velocity[k] = std::copysign(tau * f, dt);
  step.velocity_kept[k] = 1 - f;
  step.q_pose[k] = tau * tau * tau * (x - f - f * f / 2);
  step.q_cross[k] = std::copysign(tau * tau * f * f / 2, dt);
  step.q_velocity[k] = tau * (f - f * f / 2);
}

}  // namespace detail

/// How far a velocity of 1 carries in a time dt [s] while it fades at a rate [1/s]: MotionStep::pose_by_velocity.
inline double carried(double dt, double fading) noexcept {
  const double x = std::abs(dt) * fading;
  return x < detail::kShort ? dt * detail::mean_kept_series(x) : std::copysign(-std::expm1(-x) / fading, dt);
}

/// @param dt duration [s]
/// @param fading rate along each axis, not negative [1/s]
inline MotionStep motion_step(double dt, const std::array<double, 6>& fading) noexcept {
  MotionStep step;
  if (std::abs(dt) * *std::ranges::max_element(fading) < detail::kShort) [[likely]] {
    for (std::size_t k = 0; k < 6; ++k) detail::set_short(step, k, dt, fading[k]);
    return step;
  }
  for (std::size_t k = 0; k < 6; ++k) {
    if (std::abs(dt) * fading[k] < detail::kShort)
      detail::set_short(step, k, dt, fading[k]);
    else
      detail::set_long(step, k, dt, fading[k]);
  }
  return step;
}

}  // namespace evmarker
