#include "evmarker/update/motion_bound.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

TEST_CASE("motion bound: none until it is measured, and none when it is lifted") {
  MotionBound bound;
  CHECK_FALSE(bound.is_set());
  CHECK(bound.most_m() == kInfinity);
  bound.set(400, 4);
  CHECK(bound.is_set());
  CHECK(bound.most_m() == kInfinity);
  bound.measure(100, 1000);
  CHECK(bound.most_m() < kInfinity);
  bound.lift();
  CHECK(bound.most_m() == kInfinity);
}

TEST_CASE("motion bound: six times the way that so many events and three deviations of passages take") {
  MotionBound bound;
  bound.set(400, 4);  // 400 events a pixel, in passages of 4
  bound.measure(0, 1000);
  CHECK(bound.most_m() == doctest::Approx(6 * 3 * 4 / 400e3));
  bound.measure(140, 1000);
  CHECK(bound.most_m() == doctest::Approx(6 * (140 + 3 * 24) / 400e3));
}

TEST_CASE("motion bound: limits process noise to the bound, and to ten turns") {
  MotionBound bound;
  const MotionStep step{.q_pose = 4, .q_cross = 2, .q_velocity = 1};
  CHECK(bound.limited(step, 1, kInfinity).q_pose == 4);
  bound.set(1, 1);
  bound.measure(0, 18);  // 1 m
  const MotionStep limited = bound.limited(step, 2, kInfinity);
  CHECK(2 * limited.q_pose == doctest::Approx(1));
  CHECK(2 * limited.q_cross * limited.q_cross ==
        doctest::Approx(1));  // as correlated as before, where q_velocity stays
  CHECK(limited.q_velocity == 1);
  CHECK(bound.limited(step, 0.2, kInfinity).q_pose == 4);
  bound.lift();
  constexpr double kTurns_rad = 62.83185307179586, kLever2 = 1e-4;
  CHECK(bound.limited(step, 2, kLever2).q_pose == doctest::Approx(kTurns_rad * kTurns_rad * kLever2 / 2));
}
