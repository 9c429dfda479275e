#include "evmarker/update/polarity_agreement.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

using namespace evmarker;

namespace {

// Of events of which so many come from edges that move toward the dark or away from it, and the others from anything
// that makes ON events as often as said.
PolarityAgreement fed(double moving, double on_of_others, int events = 2000) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0, 1);
  PolarityAgreement agreement;
  for (int i = 0; i < events; ++i) {
    const double speed = unit(random) < 0.3 ? 5 : -80;
    const bool on = unit(random) < moving ? speed > 0 : unit(random) < on_of_others;
    agreement.add(speed, on ? 1 : -1);
  }
  return agreement;
}

}  // namespace

TEST_CASE("events whose polarities fit the motion come from moving edges") {
  CHECK(PolarityAgreement().moving_share().least == 0);
  CHECK(fed(1, 0).moving_share().least > 0.85);
  const MovingShare half = fed(0.5, 0.5).moving_share();
  CHECK(half.least > 0.4);
  CHECK(half.least < 0.5);
  CHECK(half.likely == doctest::Approx(0.5).epsilon(0.05));
}

TEST_CASE("events that do not know of the motion are of no moving edge, whatever their polarities") {
  for (const double on : {0.0, 0.2, 0.5, 0.9, 1.0}) {
    CAPTURE(on);
    CHECK(fed(0, on).moving_share().least < 0.02);
  }
  CHECK(fed(-1, 0).moving_share().least == 0);
}

TEST_CASE("what came before `clear` says nothing of what comes after it") {
  PolarityAgreement agreement = fed(1, 0);
  agreement.clear();
  CHECK(agreement.moving_share().least == 0);
  for (int i = 0; i < 64; ++i) {
    agreement.add(i % 2 == 0 ? 5 : -5, i % 4 < 2 ? 1 : -1);
    CHECK(agreement.moving_share().least == 0);
  }
}

TEST_CASE("64 events, as many as BackgroundShare judges, are enough to see motion, and far more than one or two") {
  CHECK(fed(1, 0, 64).moving_share().least > 0.5);
  CHECK(fed(1, 0, 2).moving_share().least == 0);
}

TEST_CASE("polarities that are not known say nothing") {
  PolarityAgreement agreement = fed(1, 0);
  const double before = agreement.moving_share().least;
  for (int i = 0; i < 1000; ++i) agreement.add(i % 2 == 0 ? 5 : -5, 0);
  CHECK(agreement.moving_share().least == before);
}

TEST_CASE("polarities of several events at once count as one by one") {
  std::mt19937 random(6);
  PolarityAgreement together, single;
  for (int batch = 0; batch < 40; ++batch) {
    simd::Lanes speeds, polarities, is_event;
    for (std::size_t i = 0; i < simd::kLanes; ++i) {
      speeds[i] = static_cast<double>(random() % 7) - 3.5;
      polarities[i] = random() % 9 == 0   ? 0
                      : random() % 4 == 0 ? -std::copysign(1, speeds[i])
                                          : std::copysign(1, speeds[i]);
      is_event[i] = random() % 5 == 0 ? 0 : 1;
    }
    together.add(speeds, polarities, is_event);
    for (std::size_t i = 0; i < simd::kLanes; ++i)
      if (is_event[i] == 1) single.add(speeds[i], polarities[i]);
  }
  REQUIRE(single.moving_share().least > 0.1);
  CHECK(together.moving_share().least == doctest::Approx(single.moving_share().least).epsilon(1e-12).scale(0));
}
