#include "evmarker/update/velocity_memory.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;

namespace {

constexpr double kEventsPerPx = 300, kSpeed_px_s = 200, kShortest_s = 0.05, kLongest_s = 1;

/// After 100 updates of `events` each, 1 ms apart: 60 are to be expected.
VelocityMemory fed(int events, double events_per_px = kEventsPerPx) {
  VelocityMemory memory;
  for (int i = 0; i < 100; ++i) {
    for (const double side : {-1.0, 1.0}) memory.add_speed(side * kSpeed_px_s);
    memory.add(events, events_per_px, 1e-3, 0.1);
  }
  return memory;
}

double time_constant(const VelocityMemory& memory, double velocity2 = 1, double variance = 0) {
  return memory.time_constant(kShortest_s, kLongest_s, velocity2, variance);
}

}  // namespace

TEST_CASE("a velocity is kept as long as there are the events that it lets expect") {
  CHECK(time_constant(fed(60)) == doctest::Approx(kLongest_s));
  CHECK(time_constant(fed(90)) == doctest::Approx(kLongest_s));
  CHECK(time_constant(fed(20)) == kShortest_s);
  CHECK(time_constant(fed(0)) == kShortest_s);
  const double partly = time_constant(fed(33));  // 0.55 of those expected: halfway between too few and enough
  CHECK(1 / partly == doctest::Approx((1 / kShortest_s + 1 / kLongest_s) / 2).epsilon(0.01).scale(0));
}

TEST_CASE("nothing confirms a velocity before it is known how many events to expect") {
  CHECK(time_constant(VelocityMemory()) == kShortest_s);
  CHECK(time_constant(fed(60, 0)) == kShortest_s);
}

TEST_CASE("a velocity below its standard deviation is hardly kept") {
  const VelocityMemory memory = fed(60);
  CHECK(time_constant(memory, 1, 1) == doctest::Approx(1 / (0.5 / kShortest_s + 0.5 / kLongest_s)));
  CHECK(time_constant(memory, 1, 100) < 1.02 * kShortest_s);
  CHECK(time_constant(memory, 0, 0) == kShortest_s);
}

TEST_CASE("after a pause in which the velocity would have made events, it is not confirmed") {
  VelocityMemory memory = fed(60);
  memory.add(10, kEventsPerPx, 0.1, 0.1);  // 6000 were to be expected
  CHECK(time_constant(memory) == kShortest_s);
}

TEST_CASE("a speed that is not finite is forgotten") {
  VelocityMemory memory = fed(60);
  memory.add_speed(std::numeric_limits<double>::infinity());
  memory.add(60, kEventsPerPx, 1e-3, 0.1);
  CHECK(time_constant(memory) == kShortest_s);
  for (int i = 0; i < 100; ++i) {
    memory.add_speed(kSpeed_px_s);
    memory.add(60, kEventsPerPx, 1e-3, 0.1);
  }
  CHECK(time_constant(memory) == doctest::Approx(kLongest_s));
}
