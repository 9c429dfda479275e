#include "evmarker/tracking/pose_comparison.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

using namespace evmarker;

TEST_CASE("a comparison says nothing by few events, and the more the surer it is, by the right number") {
  std::mt19937_64 random(3);
  std::exponential_distribution<double> misfit(4);
  PoseComparison comparison;
  for (int i = 0; i < 1000; ++i) comparison.add(misfit(random), misfit(random) + 1);
  CHECK(comparison.z() == 0);
  PoseComparison alike, first_better, second_better;
  constexpr int kEvents = 64000;
  for (int i = 0; i < kEvents; ++i) {
    const double one = misfit(random), other = misfit(random);
    alike.add(one, other);
    first_better.add(one, other + 0.02);
    second_better.add(one + 0.02, other);
  }
  CHECK(alike.events() == kEvents);
  CHECK(std::abs(alike.z()) < 3);
  // Each difference has twice the variance of an exponential distribution with mean 1/4. Sums of 64 vary about zero.
  const double expected = 0.02 * std::sqrt(kEvents / (2.0 / 16 + 64 * 0.02 * 0.02));
  CHECK(first_better.z() - alike.z() == doctest::Approx(expected).epsilon(0.1).scale(0));
  CHECK(alike.z() - second_better.z() == doctest::Approx(expected).epsilon(0.1).scale(0));
}
