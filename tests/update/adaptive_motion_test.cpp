#include "evmarker/update/adaptive_motion.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <numbers>

using namespace evmarker;

namespace {

constexpr double kLever2 = 0.0025, kPxPerM = 1000;

// Of events at a mean distance of 50 mm from the origin, seen at 1000 px/m.
MeasurementStatistics statistics() {
  MeasurementStatistics statistics;
  statistics.set_events_per_update(1);
  statistics.add({.residual2 = 0.3, .lever2 = kLever2, .gradient2 = kPxPerM * kPxPerM, .since_us = 0});
  statistics.update_means(1);
  return statistics;
}

KalmanState moving_at(double m_per_s) {
  KalmanState state;
  state.twist.t.x = m_per_s;
  return state;
}

}  // namespace

TEST_CASE("adaptive motion: a velocity that nothing confirms fades with the memory that is set") {
  KalmanSettings settings;
  settings.velocity_memory_s = 0.1;
  const AdaptiveMotion motion(settings);
  const Vec6 moved = motion.moved({{1, 0, 0}, {0, 0, 2}}, 0.1);
  CHECK(moved.t.x == doctest::Approx(0.1 * (1 - std::exp(-1))));
  CHECK(moved.r.z == doctest::Approx(0.2 * (1 - std::exp(-1))));
  const Vec6 faded = motion.faded({{1, 0, 0}, {0, 0, 2}}, moved, 0.1);
  CHECK(faded.t.x == doctest::Approx(std::exp(-1)));
  CHECK(faded.r.z == doctest::Approx(2 * std::exp(-1)));
  const Vec6 moved_back = motion.moved({{1, 0, 0}, {}}, -0.1);  // it fades in a step back in time, too
  CHECK(motion.faded({{1, 0, 0}, {}}, moved_back, -0.1).t.x == doctest::Approx(std::exp(-1)));
}

TEST_CASE("adaptive motion: a translation whose velocity has faded is no better known for it") {
  KalmanSettings settings;
  settings.velocity_memory_s = 0.1;
  settings.confirmed_velocity_memory_s = 2;
  const AdaptiveMotion motion(settings);
  const MotionStep step = motion.step(0.1, {}, statistics()).motion;
  for (std::size_t k = 0; k < 6; ++k) {
    CAPTURE(k);
    CHECK(step.velocity_kept[k] == doctest::Approx(std::exp(k < 3 ? -0.05 : -1)));
    CHECK(step.pose_by_velocity[k] == doctest::Approx(k < 3 ? 2 * (1 - std::exp(-0.05)) : 0.1 * (1 - std::exp(-1))));
  }
}

TEST_CASE("adaptive motion: few events bound the motion, once it is known how many the edges make") {
  constexpr double dt = 0.01;
  AdaptiveMotion motion{KalmanSettings()};
  motion.add_sample({kPxPerM, 0, 0, 0, 0, 0}, kPxPerM);
  KalmanState state = moving_at(1);
  motion.limit(state, 0, dt, 0, statistics());
  CHECK(state.twist.t.x == 1);
  CHECK(motion.lead(state.twist, 1, dt, kLever2).s == dt);

  motion.bound_by_events(100, 1);
  motion.limit(state, 0, dt, 0, statistics());
  CHECK(state.twist.t.x < 0.1);
  CHECK(motion.moved(state.twist, dt).t.x == doctest::Approx(motion.bound().most_m()));
  // Nor does the pose lead the state by more.
  const KalmanState::Lead lead = motion.lead({{1, 0, 0}, {}}, 0, dt, kLever2);
  CHECK(lead.s == doctest::Approx(motion.bound().most_m()));
  CHECK(lead.motion.t.x < motion.bound().most_m());
  // A velocity of which only the variance is known leads no farther either.
  CHECK(motion.lead({}, 1, dt, kLever2).s == doctest::Approx(motion.bound().most_m()));
  CHECK(motion.lead({{1, 0, 0}, {}}, 4, dt, kLever2).s == doctest::Approx(motion.bound().most_m() / 2));

  motion.lift_bound();
  CHECK(motion.lead({{1, 0, 0}, {}}, 1, dt, kLever2).s == dt);
}

TEST_CASE("adaptive motion: the process noise of a pause is limited by what is possible, and its density is not") {
  const AdaptiveMotion motion{KalmanSettings()};
  const auto [brief, q] = motion.step(0.001, {}, statistics());
  CHECK(brief.q_pose[0] == doctest::Approx(1e-9 / 3).epsilon(0.02));
  const auto [years, q_of_years] = motion.step(1e8, {}, statistics());
  CHECK(q_of_years == q);
  CHECK(std::sqrt(q[0] * years.q_pose[0] / kLever2) == doctest::Approx(20 * std::numbers::pi));  // ten turns
}

TEST_CASE("adaptive motion: the edges' speed is that of translation, and of rotation with their lever") {
  CHECK(AdaptiveMotion::px_per_s({{3, 0, 0}, {0, 40, 0}}, statistics()) == doctest::Approx(kPxPerM * (3 + 0.05 * 40)));
}
