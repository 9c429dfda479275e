#include "evmarker/update/motion_bound.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>

using namespace evmarker;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

TEST_CASE("motion bound: none until it is measured, and none when it is lifted") {
  MotionBound bound;
  CHECK_FALSE(bound.rates_known());
  CHECK(bound.most_px() == kInfinity);
  CHECK(bound.most_m() == kInfinity);
  bound.set_event_rates(400, 4);
  CHECK(bound.rates_known());
  CHECK(bound.most_m() == kInfinity);
  bound.measure(100, 0.01, 0, 1, 1000);
  CHECK(bound.most_px() < kInfinity);
  CHECK(bound.most_m() == doctest::Approx(bound.most_px() / 1000).scale(0));
  bound.lift();
  CHECK(bound.most_px() == kInfinity);
  CHECK(bound.most_m() == kInfinity);
}

TEST_CASE("motion bound: eight times the way that so many events and three deviations of passages take") {
  MotionBound bound;
  bound.set_event_rates(400, 4);  // 400 events a pixel, in passages of 4
  bound.measure(0, 0.01, 0, 1, 1000);
  CHECK(bound.most_px() == doctest::Approx(8 * 3 * 4 / 400.0).scale(0));
  bound.measure(96, 0.01, 0, 1, 1000);  // nearly the 100 over which the interval is taken
  CHECK(bound.most_px() == doctest::Approx(8 * (96 + 3 * 20) / 400.0).epsilon(0.02).scale(0));
  SUBCASE("noise is no motion") {
    for (const double noise_per_s : {9600.0, 20000.0}) {
      bound.measure(96, 0.01, noise_per_s, 1, 1000);
      CHECK(bound.most_px() == doctest::Approx(8 * 3 * 4 / 400.0).epsilon(0.05).scale(0));
    }
  }
}

TEST_CASE("motion bound: steps of single events may not move farther than their events tell together") {
  constexpr double kShare = 0.01, kInterval_s = 1e-4;  // n = 1
  MotionBound bound;
  bound.set_event_rates(400, 4);
  const auto step = [&](int events, double dt) {
    bound.measure(events, dt, 0, kShare, 1000);
    return bound.most_px();
  };
  for (int i = 0; i < 1000; ++i) step(1, kInterval_s);
  const double usual = step(1, kInterval_s);
  CHECK(usual == doctest::Approx(8 * 1.62 / 400.0).epsilon(0.02).scale(0));  // 100 and 3 deviations, by 100
  SUBCASE("a step without an event, and one after a long rest, are bounded by their own") {
    CHECK(step(0, 60) == doctest::Approx(8 * 3 * 4 / 400.0).scale(0));
    CHECK(step(1, 60) == doctest::Approx(8 * (1 + 3 * std::sqrt(20.0)) / 400.0).scale(0));
    CHECK(step(1, kInterval_s) == doctest::Approx(usual).epsilon(0.05).scale(0));  // a rest is not how often they come
  }
  SUBCASE("a motion that becomes faster is bounded as before after 500 events, a pixel and a quarter") {
    const double fast = step(1, 0.01 * kInterval_s);
    CHECK(fast == doctest::Approx(0.01 * usual).epsilon(0.05).scale(0));
    double moved_px = 0;
    for (int i = 0; i < 500; ++i) moved_px += step(1, 0.01 * kInterval_s);
    CHECK(step(1, 0.01 * kInterval_s) > 0.5 * usual);
    CHECK(moved_px > 500 / 400.0);  // no less than it does move
  }
  SUBCASE("times that stand still bound nothing but the step") {
    for (int i = 0; i < 10000; ++i) step(1, 0);
    CHECK(step(1, 1) == doctest::Approx(8 * (1 + 3 * std::sqrt(20.0)) / 400.0).scale(0));
  }
}

TEST_CASE("motion bound: limits process noise to the bound, and to ten turns") {
  MotionBound bound;
  const MotionStep step{.q_pose = {4, 8}, .q_cross = {2, 4}, .q_velocity = {1, 2}};
  CHECK(bound.limited(step, 1, kInfinity).q_pose == step.q_pose);
  bound.set_event_rates(1, 1);
  bound.measure(0, 1, 0, 1, 24);  // 1 m
  const MotionStep limited = bound.limited(step, 2, kInfinity);
  CHECK(2 * limited.q_pose[0] == doctest::Approx(1));
  CHECK(2 * limited.q_pose[1] == doctest::Approx(2));  // along each axis by the same factor
  for (const std::size_t k : {0U, 1U})                 // as correlated as before, where q_velocity stays
    CHECK(limited.q_cross[k] * limited.q_cross[k] == doctest::Approx(limited.q_pose[k] * limited.q_velocity[k]));
  CHECK(limited.q_velocity == step.q_velocity);
  CHECK(bound.limited(step, 0.2, kInfinity).q_pose == step.q_pose);
  bound.lift();
  constexpr double kTurns_rad = 62.83185307179586, kLever2 = 1e-4;
  CHECK(bound.limited(step, 2, kLever2).q_pose[0] == doctest::Approx(kTurns_rad * kTurns_rad * kLever2 / 2));
}
