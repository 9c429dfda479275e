#include "evmarker/matched_fraction.hpp"

#include <doctest/doctest.h>

#include <random>

using namespace evmarker;

TEST_CASE("the fraction follows the share of explained events, and only the last ones count") {
  MatchedFraction fraction(100);
  CHECK(fraction.value() == 1);
  for (int i = 0; i < 50; ++i) fraction.add(i % 2 == 0);
  CHECK(fraction.value() == doctest::Approx(0.5));
  for (int i = 0; i < 1000; ++i) fraction.add(false);
  CHECK(fraction.value() < 1e-3);
  fraction.restore();
  CHECK(fraction.value() == 1);
}

TEST_CASE("no events take it across a limit whose side it is said to keep, and few more can") {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> share(0, 1);
  int kept = 0, crossed = 0;
  for (int run = 0; run < 2000; ++run) {
    MatchedFraction fraction(200);
    const double explained = share(random), limit = share(random);
    const int events = static_cast<int>(1000 * share(random));
    for (int i = 0; i < events; ++i) fraction.add(share(random) < explained);
    for (const std::size_t more : {1u, 7u, 64u}) {
      bool crosses = false;
      for (const bool all : {false, true}) {
        MatchedFraction worst = fraction;
        for (std::size_t i = 0; i < more; ++i) {
          worst.add(all);
          crosses = crosses || (worst.value() > limit) != (fraction.value() > limit);
        }
      }
      if (fraction.keeps_side(limit, more)) {
        ++kept;
        REQUIRE_FALSE(crosses);
      }
      crossed += crosses;
    }
  }
  CHECK(kept > 3000);
  CHECK(crossed > 300);
}
