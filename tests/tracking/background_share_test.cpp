#include "evmarker/tracking/background_share.hpp"

#include <doctest/doctest.h>

#include <random>

using evmarker::BackgroundShare;
using evmarker::MatchedBackground;
using evmarker::MovingShare;

namespace {

// Events that come at random to edges and beside them, so many a second, for so long, judged after every 10 matched.
struct Around {
  BackgroundShare share;
  MovingShare by_polarities;  // none, unless a test says so
  MatchedBackground last;
  std::mt19937 random{7};
  double t_us = 0;
  int judged = 0, still = 0, moving = 0;

  Around() { share.add(0, 0, 0); }

  void pass(double seconds, double matched_hz, double others_hz) {
    judged = still = moving = 0;
    for (const double end_us = t_us + seconds * 1e6; t_us < end_us;) {
      const double dt_us = std::gamma_distribution(10.0, 1e6 / matched_hz)(random);
      t_us += dt_us;
      const int others = std::poisson_distribution(dt_us * 1e-6 * others_hz)(random);
      const auto t = static_cast<evmarker::Timestamp>(t_us);
      share.add(10, others, t);
      if (!share.due()) continue;
      last = share.measure(t, by_polarities);
      ++judged;
      still += last.signal_weight < 0.1;
      moving += last.signal_weight > 0.99;
    }
  }
};

}  // namespace

TEST_CASE("events are of moving edges before anything is known") {
  CHECK(MatchedBackground().signal_weight == 1);
  CHECK(MatchedBackground().noise_per_s == 0);
}

TEST_CASE("the first events, which began at an unknown time, tell no rate of the background") {
  BackgroundShare share;
  share.expect_matching(1.0 / 3);
  share.add(100, 2000, 1000000);
  REQUIRE(!share.due());
  share.add(100, 10, 1001000);
  REQUIRE(share.due());
  share.measure(1001000, {});
  // Twice the usual rate at most, of which half as many match: 10 in a millisecond, not 1000 in one.
  share.add(100, 1000, 1002000);
  const MatchedBackground background = share.measure(1002000, {});
  CHECK(background.by_chance_per_s == doctest::Approx(10000).epsilon(0.01));
  CHECK(background.noise_per_s == background.by_chance_per_s);
}

TEST_CASE("at rest the events are background, whatever its rate and however crowded the edges are") {
  for (const double matching : {0.2, 1.0 / 3, 0.6})
    for (const double noise_hz : {300.0, 3000.0, 30000.0}) {
      CAPTURE(matching);
      CAPTURE(noise_hz);
      Around around;
      around.share.expect_matching(matching);
      around.pass(4e5 / noise_hz, matching * noise_hz, (1 - matching) * noise_hz);
      REQUIRE(around.judged > 1000);
      CHECK(around.still > 0.97 * around.judged);
    }
}

TEST_CASE("in motion they are of edges, at once after a rest") {
  Around around;
  around.share.expect_matching(1.0 / 3);
  around.pass(1, 1000, 2000);
  REQUIRE(around.last.signal_weight < 0.1);
  around.pass(0.01, 101000, 2000 + 5000);
  REQUIRE(around.judged > 10);
  CHECK(around.moving == around.judged);
  around.pass(1, 1000, 2000);
  CHECK(around.still > 0.95 * around.judged);
}

TEST_CASE("a pose that lags for a moment, with most events beside the edges, goes on moving") {
  Around around;
  around.share.expect_matching(1.0 / 3);
  around.pass(1, 101000, 7000);
  around.pass(0.005, 30000, 80000);
  REQUIRE(around.judged >= 2);
  CHECK(around.still == 0);
}

TEST_CASE("half of the events from moving edges move the pose half as much at least") {
  Around around;
  around.share.expect_matching(1.0 / 3);
  around.pass(5, 2000, 2000);
  REQUIRE(around.judged > 100);
  CHECK(around.still < 0.2 * around.judged);
}

TEST_CASE("a motion too slow to be told from the last events alone is told from more of them, not a rest") {
  Around around;
  around.share.expect_matching(1.0 / 3);
  around.pass(1, 1000, 2000);
  around.pass(2, 1300, 2000);
  REQUIRE(around.judged > 20);
  CHECK(around.still < 0.5 * around.judged);
  around.pass(2, 1000, 2000);
  CHECK(around.still > 0.6 * around.judged);  // it takes as long to be sure again
}

TEST_CASE("what a fast marker makes beside its edges is no background of the same marker in slow motion") {
  Around around;
  around.share.expect_matching(1.0 / 2);
  around.pass(1, 200000, 20000);
  CHECK(around.last.signal_weight == 1);
  CHECK(around.last.noise_per_s > 5000);
  around.pass(0.1, 8000, 800);
  CHECK(around.last.signal_weight == 1);
  CHECK(around.last.noise_per_s < 2000);  // of the 8000 and not the 20000 of before
}

TEST_CASE("what a small marker makes beside its edges is no noise, as its polarities show") {
  for (const double noise_hz : {0.0, 2000.0}) {
    CAPTURE(noise_hz);
    Around around;
    around.share.expect_matching(1.0 / 2);
    // Six tenths as many beside its edges as on them, all of which fit the motion, but for the noise.
    const double of_edges_hz = 200000, beside_hz = 120000, fitting = of_edges_hz / (of_edges_hz + noise_hz);
    around.by_polarities = {.likely = 0.98 * fitting, .least = 0.85 * fitting};
    around.pass(0.2, of_edges_hz + noise_hz, beside_hz + noise_hz);
    REQUIRE(around.judged > 100);
    CHECK(around.moving == around.judged);
    CHECK(around.last.by_chance_per_s > 0.4 * beside_hz);
    CHECK(around.last.noise_per_s >= noise_hz);
    CHECK(around.last.noise_per_s < noise_hz + 0.05 * of_edges_hz);
    const double matched_hz = of_edges_hz + noise_hz;
    CHECK(around.last.noise_share == doctest::Approx(around.last.noise_per_s / matched_hz).epsilon(0.05));
    // It turns back: for a moment it is slow, and its motion is not known. Its events are still no noise.
    around.by_polarities = {};
    around.pass(0.01, of_edges_hz / 4 + noise_hz, beside_hz / 4 + noise_hz);
    REQUIRE(around.judged >= 2);
    CHECK(around.still == 0);
    // It rests.
    if (noise_hz == 0) continue;
    around.pass(2, noise_hz, noise_hz);
    CHECK(around.still > 0.8 * around.judged);
    CHECK(around.last.noise_share > 0.4);
  }
}

TEST_CASE("where there were few events a moment ago, many that lie anywhere are no noise: the pose does not follow") {
  // Narrow cells: six tenths of what lies anywhere matches an edge.
  Around around;
  around.share.expect_matching(0.6);
  around.pass(0.3, 200000, 40000);
  around.pass(0.01, 20000, 4000);  // it turns back
  around.pass(0.05, 60000, 40000);
  REQUIRE(around.judged > 20);
  CHECK(around.still == 0);
  CHECK(around.last.noise_per_s < 40000);
  // Later, it is noise, as there is no end to it.
  around.pass(5, 60000, 40000);
  around.pass(1, 60000, 40000);
  CHECK(around.still > 0.97 * around.judged);
}
