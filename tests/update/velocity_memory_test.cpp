#include "evmarker/update/velocity_memory.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;

namespace {

constexpr double kEventsPerPx = 300, kSpeed_px_s = 200, kFastest = 20, kSlowest = 1;
constexpr Vec6 kVelocity{{0.5, -0.2, 0.1}, {2, 1, -3}};

/// After 100 updates of `events` each, 1 ms apart: 60 are to be expected.
VelocityMemory fed(int events, double events_per_px = kEventsPerPx) {
  VelocityMemory memory;
  for (int i = 0; i < 100; ++i) {
    for (const double side : {-1.0, 1.0}) memory.add_speed(side * kSpeed_px_s);
    memory.add(events, events_per_px, 1e-3, 0.1);
  }
  return memory;
}

std::array<double, 6> all_fading(VelocityMemory memory, double signal = 1) {
  return memory.update_fading(kFastest, kSlowest, 1, 0, signal);
}

/// Of all axes, which must be alike.
double fading(VelocityMemory memory, double velocity2 = 1, double variance = 0, double signal = 1) {
  const std::array<double, 6> rates = memory.update_fading(kFastest, kSlowest, velocity2, variance, signal);
  for (const double rate : rates) CHECK(rate == doctest::Approx(rates[0]));
  return rates[0];
}

/// Steps of 1 ms in which a thousandth of the velocity fades, and `correct(i)` times that is put back along each axis.
template <typename Correct>
void add_steps(VelocityMemory& memory, int steps, const Correct& correct) {
  for (int i = 0; i < steps; ++i) {
    std::array<double, 6> put_back = correct(i);
    for (double& part : put_back) part *= 0.001;
    memory.add_step(kVelocity, 0.999 * kVelocity, scaled(put_back, kVelocity));
    memory.add(20, kEventsPerPx, 1e-3, 0.1);
    if (memory.is_due()) memory.update_fading(kFastest, kSlowest, 1, 0, 1);
  }
}

}  // namespace

TEST_CASE("a velocity is kept as long as there are the events that it lets expect") {
  CHECK(fading(fed(60)) == doctest::Approx(kSlowest));
  CHECK(fading(fed(90)) == doctest::Approx(kSlowest));
  CHECK(fading(fed(20)) == kFastest);
  CHECK(fading(fed(0)) == kFastest);
  // 0.55 of those expected: halfway between too few and enough
  CHECK(fading(fed(33)) == doctest::Approx((kFastest + kSlowest) / 2).epsilon(0.01).scale(0));
}

TEST_CASE("nothing confirms a velocity before it is known how many events to expect") {
  CHECK(fading(VelocityMemory()) == kFastest);
  CHECK(fading(fed(60, 0)) == kFastest);
}

TEST_CASE("a velocity below its standard deviation is hardly kept") {
  const VelocityMemory memory = fed(60);
  CHECK(fading(memory, 1, 1) == doctest::Approx((kFastest + kSlowest) / 2));
  CHECK(fading(memory, 1, 100) > 0.98 * kFastest);
  CHECK(fading(memory, 0, 0) == kFastest);
}

TEST_CASE("noise confirms less of a velocity, as it makes its own") {
  CHECK(fading(fed(60), 1, 0, 0.5) == doctest::Approx((kFastest + kSlowest) / 2));
  CHECK(fading(fed(60), 1, 0, 0) == kFastest);
}

TEST_CASE("a velocity is kept along the axes where the measurements put back what fades") {
  VelocityMemory memory = fed(20);
  add_steps(memory, 200, [](int i) {  // as they do: wholly, by half, in either direction, further away, not, too much
    return std::array<double, 6>{1, 0.5, i % 2 == 0 ? 5.0 : -5.0, -1, 0, 3};
  });
  const std::array<double, 6> rates = all_fading(memory);
  CHECK(rates[0] == doctest::Approx(kSlowest));
  CHECK(rates[1] == doctest::Approx((kFastest + kSlowest) / 2));
  CHECK(rates[2] > 0.9 * kFastest);
  CHECK(rates[3] == kFastest);
  CHECK(rates[4] == kFastest);
  CHECK(rates[5] == kSlowest);
}

TEST_CASE("what was put back does not count after a pause") {
  VelocityMemory memory = fed(20);
  add_steps(memory, 200, [](int) { return std::array{1.0, 1.0, 1.0, 1.0, 1.0, 1.0}; });
  CHECK(fading(memory) == doctest::Approx(kSlowest));
  memory.add(20, kEventsPerPx, 3e-3, 0.1);  // others took 1 ms
  CHECK(fading(memory) == doctest::Approx(kSlowest));
  memory.add(20, kEventsPerPx, 0.5, 0.1);
  CHECK(fading(memory) > 0.98 * kFastest);
  memory.add(20, kEventsPerPx, 1e-3, 0.1);  // the pause is no measure of what is usual
  CHECK(fading(memory) == doctest::Approx(kSlowest));
}

TEST_CASE("the first update comes after no pause") {
  VelocityMemory memory;
  add_steps(memory, 1, [](int) { return std::array{1.0, 1.0, 1.0, 1.0, 1.0, 1.0}; });
  CHECK(fading(memory) == doctest::Approx(kSlowest));
}

TEST_CASE("what was put back long ago does not count") {
  VelocityMemory memory = fed(20);
  const auto all = [](double put_back) {
    return std::array{put_back, put_back, put_back, put_back, put_back, put_back};
  };
  add_steps(memory, 500, [&](int) { return all(1); });
  REQUIRE(fading(memory) == doctest::Approx(kSlowest));
  add_steps(memory, 200, [&](int) { return all(0); });
  CHECK(fading(memory) > 0.95 * kFastest);
}

TEST_CASE("after a pause in which the velocity would have made events, it is not confirmed") {
  VelocityMemory memory = fed(60);
  memory.add(10, kEventsPerPx, 0.1, 0.1);  // 6000 were to be expected
  CHECK(fading(memory) == kFastest);
}

TEST_CASE("what is not finite is forgotten") {
  SUBCASE("a speed") {
    VelocityMemory memory = fed(60);
    memory.add_speed(std::numeric_limits<double>::infinity());
    memory.add(60, kEventsPerPx, 1e-3, 0.1);
    CHECK(fading(memory) == kFastest);
    for (int i = 0; i < 100; ++i) {
      memory.add_speed(kSpeed_px_s);
      memory.add(60, kEventsPerPx, 1e-3, 0.1);
    }
    CHECK(fading(memory) == doctest::Approx(kSlowest));
  }
  SUBCASE("a velocity") {
    VelocityMemory memory;
    const auto along_z = [&] { return memory.update_fading(kFastest, kSlowest, 1, 0, 1)[2]; };
    memory.add_step({{0, 0, std::numeric_limits<double>::infinity()}, {}}, {}, kVelocity);
    CHECK(along_z() == kFastest);
    memory.add_step(kVelocity, {}, kVelocity);
    CHECK(along_z() == kSlowest);
  }
}
