#include "evmarker/events/noise_floor.hpp"

#include <doctest/doctest.h>

#include <random>

using namespace evmarker;

namespace {

constexpr SensorSize kNoisySensor{640, 480};
constexpr Timestamp kSecond_us = 1000000;

// Noise of a rate [Hz] for a time, in the columns from `left` on.
void add_noise(NoiseFloor& floor, double hz, Timestamp begin, Timestamp length, int left = 0) {
  std::mt19937 random(5);
  std::uniform_int_distribution<int> x(left, kNoisySensor.width - 1), y(0, kNoisySensor.height - 1);
  const auto count = static_cast<Timestamp>(1e-6 * hz * static_cast<double>(length));
  for (Timestamp i = 0; i < count; ++i)
    floor.add(
        {static_cast<std::uint16_t>(x(random)), static_cast<std::uint16_t>(y(random)), 1, begin + i * length / count});
}

}  // namespace

TEST_CASE("the noise floor is the rate of noise, or somewhat less") {
  for (const double hz : {3e3, 30e3, 3e6}) {
    CAPTURE(hz);
    NoiseFloor floor(kNoisySensor);
    add_noise(floor, hz, 0, 2 * kSecond_us);
    const double expected = floor.expected_events(2 * kSecond_us, 2 * kSecond_us + 1000) / 1e-3;
    CHECK(expected < 1.05 * hz);
    CHECK(expected > 0.4 * hz);
  }
}

TEST_CASE("no noise is due before it was measured, nor where a part of the sensor makes none") {
  NoiseFloor floor(kNoisySensor);
  CHECK(floor.expected_events(0, kSecond_us) == 0);
  add_noise(floor, 1e3, 0, kSecond_us);  // 16 for a tile, and fewer for the quietest one
  CHECK(floor.expected_events(kSecond_us, 2 * kSecond_us) == 0);
  NoiseFloor half(kNoisySensor);
  add_noise(half, 1e6, 0, kSecond_us, kNoisySensor.width / 2);
  CHECK(half.expected_events(kSecond_us, 2 * kSecond_us) == 0);
}

TEST_CASE("motion on most of the sensor does not raise the noise floor, a quiet time lowers it at once") {
  NoiseFloor floor(kNoisySensor);
  for (int i = 0; i < 20; ++i) {  // as in turn
    add_noise(floor, 1e4, i * 100000, 100000);
    add_noise(floor, 1e6, i * 100000, 100000, kNoisySensor.width / 8);
  }
  CHECK(floor.expected_events(2 * kSecond_us, 3 * kSecond_us) < 2e4);
  CHECK(floor.expected_events(2 * kSecond_us, 3 * kSecond_us) > 4e3);

  add_noise(floor, 1e6, 2 * kSecond_us, 100000);  // motion everywhere raises it step by step
  const double raised = floor.expected_events(2100000, 3100000);
  CHECK(raised > 4e3);
  CHECK(raised < 1e6);
  add_noise(floor, 1e3, 2100000, kSecond_us);  // at rest: the measurement is not over, but the rate is bounded
  CHECK(floor.expected_events(3100000, 4100000) < 4e3);
}

TEST_CASE("a clock that steps back starts the measurement of noise anew") {
  NoiseFloor floor(kNoisySensor);
  add_noise(floor, 3e4, 100 * kSecond_us, kSecond_us);
  add_noise(floor, 3e4, 0, kSecond_us);
  const double expected = floor.expected_events(kSecond_us, 2 * kSecond_us);
  CHECK(expected > 1e4);
  CHECK(expected < 3.2e4);
}
