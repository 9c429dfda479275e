#include "evmarker/search/edge_evidence.hpp"

#include <doctest/doctest.h>

#include <random>

using namespace evmarker;

namespace {

constexpr int kSize = 100;

// A vertical edge at x = 40 with so many events in each of its cells, and noise.
EdgeEvidence evidence(int events, double noise, int kept_free_from_x = kSize) {
  CellRegion region{{0, 0}, 1, kSize, kSize, 0, 0, kept_free_from_x, kSize};
  FadingCounts counts(kSize * kSize);
  std::mt19937 random(1);
  std::poisson_distribution<int> noisy(noise > 0 ? noise : 1e-9);
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kept_free_from_x; ++x)
      for (int i = noisy(random) + (x == 40 ? events : 0); i > 0; --i)
        counts.add(static_cast<std::size_t>(y * kSize + x), 0);
  EdgeEvidence result(kSize * kSize);
  result.start(region, 3, counts.total(3));
  int rows = 1;
  while (!result.step(counts)) ++rows;
  CHECK(rows == 4 * kSize);
  return result;
}

double mean_at(const EdgeEvidence& evidence, int x) {
  double sum = 0;
  for (int y = 0; y < kSize; ++y) sum += evidence[static_cast<std::size_t>(y * kSize + x)] / EdgeEvidence::kUnit;
  return sum / kSize;
}

}  // namespace

TEST_CASE("events speak for an edge where they are and against it elsewhere") {
  const EdgeEvidence clean = evidence(1, 0);
  CHECK(mean_at(clean, 40) > 2);  // three of a hundred columns have an event beside them
  CHECK(mean_at(clean, 43) < mean_at(clean, 41));
  CHECK(mean_at(clean, 60) == doctest::Approx(-0.7).epsilon(0.1).scale(0));  // one of two edges may be silent
}

TEST_CASE("an edge stands out of noise by as many events as noise has not") {
  CHECK(mean_at(evidence(8, 0.1), 40) > 2);
  CHECK(mean_at(evidence(8, 10), 40) > 0.5);  // 90 +- 7 events around a cell, 24 more at the edge
  CHECK(mean_at(evidence(1, 10), 40) < 0.3);
  double most = 0;
  const EdgeEvidence noise = evidence(0, 10);
  for (int x = 5; x < 95; ++x) most = std::max(most, mean_at(noise, x));
  CHECK(most < 0.1);
}

TEST_CASE("there is no evidence outside of the sensor") {
  const EdgeEvidence cut = evidence(3, 0, 60);
  CHECK(mean_at(cut, 40) > 1);
  CHECK(mean_at(cut, 59) < -0.6);
  CHECK(mean_at(cut, 60) == 0);
}
