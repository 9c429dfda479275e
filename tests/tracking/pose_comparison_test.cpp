#include "evmarker/tracking/pose_comparison.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <random>

using namespace evmarker;

namespace {

constexpr int kEdges = 20;

// Compares residuals of normally distributed events, of edges that are off by `first_px` and `second_px`, plus and
// minus in turn.
PoseComparison compared(int events, double first_px, double second_px, double spread_px = 0.3) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0, spread_px);
  PoseComparison comparison;
  for (int i = 0; i < events; ++i) {
    const int edge = i % kEdges;
    const double event_px = noise(random), sign = edge % 2 == 0 ? 1 : -1;
    comparison.add({edge, event_px + sign * first_px}, {edge, event_px + sign * second_px});
  }
  return comparison;
}

}  // namespace

TEST_CASE("a comparison says nothing by few events, and decides by many for the pose that they lie nearer to") {
  CHECK(!compared(1000, 0, 0.3).decided());
  CHECK(compared(1000, 0, 0.3).probability_of_second() == 0.5);
  CHECK(compared(20000, 0, 0.3).events() == 20000);
  CHECK(compared(20000, 0, 0.3).decided());
  CHECK(!compared(20000, 0, 0.3).second_is_nearer());
  CHECK(compared(20000, 0, 0.3).probability_of_second() < 1e-3);
  CHECK(compared(20000, 0.3, 0).decided());
  CHECK(compared(20000, 0.3, 0).second_is_nearer());
  CHECK(compared(20000, 0.3, 0).probability_of_second() > 1 - 1e-3);
  CHECK(!compared(20000, 0.2, 0.2).decided());
}

TEST_CASE("no number of events decides between poses whose edges are off by nearly as much") {
  // 20 / 2 ln(0.27^2 / 0.25^2) is that of z = 1.75.
  CHECK(!compared(2000000, 0.25, 0.27).decided());
  const double z = std::sqrt(2 * kEdges * std::log(0.27 / 0.25));
  CHECK(compared(2000000, 0.25, 0.27).probability_of_second() ==
        doctest::Approx(std::erfc(z / std::numbers::sqrt2) / 2).epsilon(0.1).scale(0));
}

TEST_CASE("the later the edges decide, the more they must differ: the errors of edges change with the motion") {
  // 20 / 2 ln(0.3^2 / 0.25^2) is that of z = 2.7, enough at first; z = 3.1 is enough after two million events, too.
  CHECK(compared(20000, 0.25, 0.3).decided());
  CHECK(!compared(2000000, 0.25, 0.3).decided());
  CHECK(compared(2000000, 0.25, 0.32).decided());
  CHECK(!compared(2000000, 0.25, 0.32).second_is_nearer());
}

TEST_CASE("no difference of the edges decides while it may be chance of their events") {
  const PoseComparison comparison = compared(2000, 0, 0.02, 1);
  CHECK(!comparison.decided());
  CHECK(comparison.probability_of_second() > 1e-3);
}

TEST_CASE("where one pose has no edge near, an event counts by how far it can be off") {
  PoseComparison comparison;
  for (int i = 0; i < 20000; ++i)
    comparison.add({i % kEdges, 0.1}, i % 3 == 0 ? EdgeResidual{.px = 1} : EdgeResidual{i % kEdges, 0.3});
  CHECK(comparison.decided());
  CHECK(!comparison.second_is_nearer());
}
