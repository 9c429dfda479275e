#include "evmarker/update/motion_noise.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;

namespace {

constexpr double kUsual = 8, kWindow_s = 0.01;

Vec6 forward(double m_s) { return {{m_s, 0, 0}, {0, 0, 0}}; }

// After corrections for 50 ms, each of acceleration * dt, with alternating signs or not.
MotionNoise corrected(double acceleration, double dt, bool alternating = false) {
  MotionNoise noise;
  double sign = 1;
  for (double t = 0; t < 0.05; t += dt, sign = alternating ? -sign : sign)
    noise.add(forward(sign * acceleration * dt), dt, kWindow_s);
  return noise;
}

}  // namespace

TEST_CASE("motion noise: as usual until something is known, then a twentieth while nothing accelerates") {
  MotionNoise noise;
  CHECK(noise.translation(kUsual) == kUsual);
  for (int i = 0; i < 29; ++i) noise.add({}, 1e-3, kWindow_s);
  CHECK(noise.translation(kUsual) == kUsual);
  for (int i = 0; i < 2; ++i) noise.add({}, 1e-3, kWindow_s);
  CHECK(noise.translation(kUsual) == doctest::Approx(kUsual / 20));
  CHECK(noise.rotation(kUsual) == doctest::Approx(kUsual / 20));
}

TEST_CASE("motion noise: grows with the square of an acceleration, however often the velocity is corrected") {
  for (const double dt : {1e-5, 1e-4, 1e-3}) {
    CAPTURE(dt);
    const double slow = corrected(2, dt).translation(kUsual), fast = corrected(4, dt).translation(kUsual);
    CHECK(slow == doctest::Approx(20 * kWindow_s * 4).epsilon(0.03).scale(0));  // all but exp(-5) of it, twice
    CHECK(fast == doctest::Approx(4 * slow));
    CHECK(corrected(4, dt).rotation(kUsual) == doctest::Approx(kUsual / 20));
  }
}

TEST_CASE("motion noise: corrections to and fro are not taken for an acceleration, and never are more than usual") {
  CHECK(corrected(10, 1e-4, true).translation(kUsual) == doctest::Approx(kUsual / 20));
  CHECK(corrected(5, 1e-4).translation(kUsual) == doctest::Approx(20 * kWindow_s * 25).epsilon(0.03).scale(0));
  CHECK(corrected(10, 1e-4).translation(kUsual) == kUsual);
}

TEST_CASE("motion noise: nothing is known after a pause, or a correction that is not finite") {
  MotionNoise noise = corrected(0, 1e-4);
  REQUIRE(noise.translation(kUsual) < kUsual);
  noise.add({}, kWindow_s, kWindow_s);
  CHECK(noise.translation(kUsual) == kUsual);

  noise = corrected(0, 1e-4);
  noise.add(forward(std::numeric_limits<double>::quiet_NaN()), 1e-4, kWindow_s);
  CHECK(noise.translation(kUsual) == kUsual);
}
