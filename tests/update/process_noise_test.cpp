#include "evmarker/update/process_noise.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

constexpr double kLever2 = 0.0025;  // 5 cm

}  // namespace

TEST_CASE("edge speed: rotation moves edges by its lever arm") {
  const EdgeSpeed speed = EdgeSpeed::of({{0.3, 0, 0.4}, {0, 2, 0}}, kLever2);
  CHECK(speed.by_rotation == doctest::Approx(0.1));
  CHECK(speed.all == doctest::Approx(0.6));
}

TEST_CASE("process noise: grows with the cube of the speed, rotation's with that of rotation") {
  const ProcessNoise noise({.acceleration_noise = 2, .turning_distance_m = 0.02, .rotation_share = 0.5});
  const auto at_rest = noise.density({}, kLever2), carried = noise.density({0, 0.6}, kLever2),
             turned = noise.density({0.6, 0.6}, kLever2);
  CHECK(at_rest[0] == doctest::Approx(2));
  CHECK(at_rest[3] == doctest::Approx(1 / kLever2));
  CHECK(carried[2] == doctest::Approx(2 + 10.8));
  CHECK(carried[5] == doctest::Approx(6.4 / kLever2));
  CHECK(turned[2] == carried[2]);
  CHECK(turned[5] == doctest::Approx((6.4 + 10.8) / kLever2));
  CHECK(noise.density({}, 0)[3] == doctest::Approx(1e8));  // before the lever arm is known
}

TEST_CASE("process noise: what shows of an acceleration is learned over four pixels of way, at most 50 ms") {
  const auto learned = [](double px_per_s, double seconds) {
    ProcessNoise noise({.acceleration_noise = 2});
    for (double t = 0; t < seconds; t += 1e-4) noise.add({}, 1e-4, px_per_s);
    return noise.density({}, kLever2)[0];
  };
  CHECK(learned(1000, 0.011) == 2);  // three windows of 4 ms
  CHECK(learned(1000, 0.013) == doctest::Approx(0.1));
  CHECK(learned(1, 0.149) == 2);
  CHECK(learned(1, 0.151) == doctest::Approx(0.1));
}
