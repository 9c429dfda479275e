#include "evmarker/update/unexplained_spread.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

using namespace evmarker;

namespace {

// Mean square of those of normally distributed distances that are within a matching distance.
double matched_px2(double sigma_px, double max_distance_px) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, sigma_px);
  double sum = 0;
  int count = 0;
  while (count < 200000) {
    const double distance = normal(random);
    if (std::abs(distance) > max_distance_px) continue;
    sum += distance * distance;
    ++count;
  }
  return sum / count;
}

}  // namespace

TEST_CASE("unexplained spread: none of a sharp edge, or of what the response time explains") {
  UnexplainedSpread spread;
  CHECK(spread.px2() == 0);
  CHECK_FALSE(spread.fills_distance());
  spread.measure(matched_px2(0.7, 2), 2, 0);
  CHECK(spread.px2() == 0);
  CHECK_FALSE(spread.fills_distance());
  spread.measure(matched_px2(1.4, 4), 4, 0, 2);  // blur
  CHECK(spread.px2() == 0);
  spread.measure(matched_px2(1.6, 4), 4, 1.6);
  CHECK(spread.px2() == 0);
  CHECK_FALSE(spread.fills_distance());
}

TEST_CASE("unexplained spread: the variance of all events, from that of those within the matching distance") {
  constexpr double kSharp_px2 = 0.64;
  for (const double sigma_px : {1.2, 1.6, 2.0, 3.0}) {
    CAPTURE(sigma_px);
    UnexplainedSpread spread;
    spread.measure(matched_px2(sigma_px, 2), 2, 0);
    CHECK(spread.px2() + kSharp_px2 == doctest::Approx(sigma_px * sigma_px).epsilon(0.35).scale(0));
    CHECK(spread.fills_distance() == (sigma_px > 1.7));
  }
}

TEST_CASE("unexplained spread: events that lie anywhere fill the distance, and their variance stays finite") {
  UnexplainedSpread spread;
  for (const double px2 : {4 / 3.0, 2.0, 1e9}) {
    spread.measure(px2, 2, 0);
    CHECK(spread.fills_distance());
    CHECK(std::isfinite(spread.px2()));
    CHECK(spread.px2() > 10);
  }
}
