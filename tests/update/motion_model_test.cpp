#include "evmarker/update/motion_model.hpp"

#include <doctest/doctest.h>

#include <cmath>

using namespace evmarker;

namespace {

/// The textbook's formulas, in long double, for which the differences of nearly equal numbers are exact enough.
struct Exact {
  long double pose_by_velocity, velocity_kept, q_pose, q_cross, q_velocity;
};
Exact exact(long double dt, long double rate) {
  const long double x = std::abs(dt) * rate, f = -std::expm1(-x);
  return {std::copysign(f / rate, dt), 1 - f, (x - f - f * f / 2) / (rate * rate * rate),
          std::copysign(f * f / (2 * rate * rate), dt), (f - f * f / 2) / rate};
}

}  // namespace

TEST_CASE("motion model: a velocity that fades along each axis at its own rate is the textbook's process") {
  const std::array<double, 6> fading{0.5, 1, 2, 14, 20, 50};
  for (const double dt : {1e-4, 3e-4, 1e-3, 0.02, -0.02, 0.3, 5.0}) {
    CAPTURE(dt);
    const MotionStep step = motion_step(dt, fading);
    for (std::size_t k = 0; k < 6; ++k) {
      CAPTURE(fading[k]);
      const Exact expected = exact(static_cast<long double>(dt), static_cast<long double>(fading[k]));
      const auto near = [](long double value, double tolerance) {
        return doctest::Approx(static_cast<double>(value)).epsilon(tolerance).scale(0);
      };
      CHECK(step.pose_by_velocity[k] == near(expected.pose_by_velocity, 1e-9));
      CHECK(step.pose_by_velocity[k] == doctest::Approx(carried(dt, fading[k])).epsilon(1e-9).scale(0));
      CHECK(std::abs(step.velocity_kept[k] - static_cast<double>(expected.velocity_kept)) < 1e-12);
      CHECK(step.q_pose[k] == near(expected.q_pose, 2e-6));
      CHECK(step.q_cross[k] == near(expected.q_cross, 1e-9));
      CHECK(step.q_velocity[k] == near(expected.q_velocity, 1e-9));
    }
  }
}

TEST_CASE("motion model: a velocity that does not fade is constant, with the noise of white acceleration") {
  const MotionStep step = motion_step(-0.2, {});
  for (std::size_t k = 0; k < 6; ++k) {
    CHECK(step.pose_by_velocity[k] == -0.2);
    CHECK(step.velocity_kept[k] == 1);
    CHECK(step.q_pose[k] == doctest::Approx(0.008 / 3).scale(0));
    CHECK(step.q_cross[k] == doctest::Approx(-0.02).scale(0));
    CHECK(step.q_velocity[k] == doctest::Approx(0.2).scale(0));
  }
}

TEST_CASE("motion model: no time changes nothing") {
  const MotionStep step = motion_step(0, {1, 2, 3, 4, 5, 6});
  CHECK(step.pose_by_velocity == MotionStep().pose_by_velocity);
  CHECK(step.velocity_kept == MotionStep().velocity_kept);
  CHECK(step.q_velocity == MotionStep().q_velocity);
}
