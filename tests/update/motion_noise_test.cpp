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
  CHECK(noise.translation(kUsual, 0) == kUsual);
  for (int i = 0; i < 29; ++i) noise.add({}, 1e-3, kWindow_s);
  CHECK(noise.translation(kUsual, 0) == kUsual);
  for (int i = 0; i < 2; ++i) noise.add({}, 1e-3, kWindow_s);
  CHECK(noise.translation(kUsual, 0) == doctest::Approx(kUsual / 20));
  CHECK(noise.rotation(kUsual, 0) == doctest::Approx(kUsual / 20));
}

TEST_CASE("motion noise: grows with the square of an acceleration, however often the velocity is corrected") {
  for (const double dt : {1e-5, 1e-4, 1e-3}) {
    CAPTURE(dt);
    const double slow = corrected(2, dt).translation(kUsual, 0), fast = corrected(4, dt).translation(kUsual, 0);
    CHECK(slow == doctest::Approx(20 * kWindow_s * 4).epsilon(0.03).scale(0));  // all but exp(-5) of it, twice
    CHECK(fast == doctest::Approx(4 * slow));
    CHECK(corrected(4, dt).rotation(kUsual, 0) == doctest::Approx(kUsual / 20));
  }
}

TEST_CASE("motion noise: corrections to and fro are not taken for an acceleration, and never are more than usual") {
  CHECK(corrected(10, 1e-4, true).translation(kUsual, 0) == doctest::Approx(kUsual / 20));
  CHECK(corrected(5, 1e-4).translation(kUsual, 0) == doctest::Approx(20 * kWindow_s * 25).epsilon(0.03).scale(0));
  CHECK(corrected(10, 1e-4).translation(kUsual, 0) == kUsual);
}

TEST_CASE("motion noise: nothing is known in a pause and after it, or after a correction that is not finite") {
  MotionNoise noise = corrected(0, 1e-4);
  REQUIRE(noise.translation(kUsual, 0.99 * kWindow_s) < kUsual);
  REQUIRE(noise.rotation(kUsual, 0.99 * kWindow_s) < kUsual);
  CHECK(noise.translation(kUsual, kWindow_s) == kUsual);
  CHECK(noise.rotation(kUsual, kWindow_s) == kUsual);
  noise.add({}, kWindow_s, kWindow_s);
  CHECK(noise.translation(kUsual, 0) == kUsual);

  noise = corrected(0, 1e-4);
  noise.add(forward(std::numeric_limits<double>::quiet_NaN()), 1e-4, kWindow_s);
  CHECK(noise.translation(kUsual, 0) == kUsual);
}
