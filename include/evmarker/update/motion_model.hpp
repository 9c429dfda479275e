#pragma once
// How a pose moves between events: constant velocity that fades, driven by white acceleration.
#include <algorithm>
#include <cmath>

namespace evmarker {

/// What a time dt does to a pose and its velocity: F = [I, carried I; 0, kept I], and Q = q [pose, both; both,
/// velocity] for white acceleration of density q [m^2/s^3]. With x = |dt| / tau, tau the memory of the velocity, and f
/// = 1 - exp(-x), the share of it that fades:
///
///     carried = tau f,  kept = 1 - f
///     pose = tau^3 (x - f - f^2 / 2),  both = tau^2 f^2 / 2,  velocity = tau (f - f^2 / 2)
///
/// which for short times are dt, 1, dt^3 / 3, dt^2 / 2 and dt. A time before now is as uncertain as one after it.
struct MotionStep {
  double carried = 0, kept = 1;             ///< of F
  double pose = 0, both = 0, velocity = 0;  ///< of Q, for q = 1
};

namespace detail {

// 1 - exp(-x) for x >= 0.
inline double faded(double x) noexcept {
  if (x < 1.0 / 32) [[likely]]  // the next term is under 1e-14 of the sum
    return x * (1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6 * (1 - x / 7))))));
  return -std::expm1(-x);
}

}  // namespace detail

inline MotionStep motion_step(double dt, double tau) noexcept {
  const double x = std::abs(dt) / tau, f = detail::faded(x);
  return {std::copysign(tau * f, dt), 1 - f, tau * tau * tau * std::max(0.0, x - f - f * f / 2),
          std::copysign(tau * tau * f * f / 2, dt), tau * (f - f * f / 2)};
}

}  // namespace evmarker
