#pragma once
// How a pose moves between events: constant velocity that fades, driven by white acceleration.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/base/vector.hpp"

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

  /// The motion of the pose for a twist at the step's begin.
  Vec6 moved(const Vec6& twist) const noexcept { return scaled(pose_by_velocity, twist); }
};

namespace detail {

inline constexpr double kShort = 1.0 / 64;  // of x: below, series to a relative error of 1e-9 for Q, 1e-12 for F

// (1 - exp(-x)) / x for x >= 0: the mean share of a velocity that is kept while it fades by exp(-x).
[[gnu::always_inline]] inline double mean_kept_shortly(double x) noexcept {
  return 1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5)));
}
inline double mean_kept(double x) noexcept { return x < kShort ? mean_kept_shortly(x) : -std::expm1(-x) / x; }

// The share of dt^3 / 3 in q_pose.
[[gnu::always_inline]] inline double pose_share_shortly(double x) noexcept {
  return 1 - x * (3.0 / 4 - x * (7.0 / 20 - x / 8));
}
inline double pose_share(double x) noexcept {
  if (x < kShort) return pose_share_shortly(x);
  const double f = -std::expm1(-x);
  return 3 * (x - f - f * f / 2) / (x * x * x);
}

}  // namespace detail

/// How far a velocity of 1 carries in a time dt [s] while it fades at a rate [1/s]: MotionStep::pose_by_velocity.
inline double carried(double dt, double fading) noexcept { return dt * detail::mean_kept(std::abs(dt) * fading); }

/// @param dt duration [s]
/// @param fading rate along each axis, not negative [1/s]
inline MotionStep motion_step(double dt, const std::array<double, 6>& fading) noexcept {
  MotionStep step;
  const double duration = std::abs(dt);
  const auto fill = [&](const auto& mean_kept, const auto& pose_share) __attribute__((always_inline)) {
    for (std::size_t k = 0; k < 6; ++k) {
      const double x = duration * fading[k], mean = mean_kept(x);
      step.pose_by_velocity[k] = dt * mean;
      step.velocity_kept[k] = 1 - x * mean;
      step.q_pose[k] = duration * duration * duration / 3 * pose_share(x);
      step.q_cross[k] = dt * duration / 2 * mean * mean;
      step.q_velocity[k] = duration * mean * (1 - x * mean / 2);
    }
  };
  if (duration * *std::ranges::max_element(fading) < detail::kShort) [[likely]]
    fill(detail::mean_kept_shortly, detail::pose_share_shortly);
  else
    fill(detail::mean_kept, detail::pose_share);
  return step;
}

}  // namespace evmarker
