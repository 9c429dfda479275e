// Poisson counts of known rates stand for the events: the truth is what they were drawn with.
#include "evmarker/tracking/track_health.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "evmarker/simulation/trajectory.hpp"
#include "tracking/facing_square.hpp"

using namespace evmarker;
using namespace evmarker::test;

namespace {

// A square that moves to and fro along its diagonal by `step_px` in x and y between two judgements. A pixel that an
// edge passes makes Poisson(`burst`) events times the edge's contrast, none of them where the edge is hidden; beside
// the edges lie as many as make the share of matched events `share`.
struct MovingSquare {
  TrackHealth health;
  std::mt19937 random;
  double burst = 3, share = 0.9, step_px = 1.5;
  MarkerModel square = kSquare;
  std::vector<double> contrast{1, 1, 1, 1};
  double noise_per_us = 0;  // near the edges, whatever moves
  // Of each edge, the share of events that may have either polarity.
  std::vector<double> random_polarity{0.02, 0.02, 0.02, 0.02};
  Timestamp t = 0;
  int steps = 0;
  double place = 0;

  explicit MovingSquare(unsigned seed, double false_alarm_rate = 1e-6, const MarkerModel& model = kSquare)
      : health(model, kFocalLength, {.false_alarm_rate = false_alarm_rate}), random(seed), square(model) {
    health.restart(0);
    health.judge_verification(true);
    health.judge_edges(square, square_at(0, 0), 0, kNoCounts);
  }

  int poisson(double mean) { return mean > 0 ? std::poisson_distribution<int>(mean)(random) : 0; }

  void move(Timestamp dt_us = 2000) {
    const double swept_px2 = 89 * step_px;
    std::vector<int> left(4, 0);
    int matched = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const int pixels = poisson(swept_px2);
      left[i] = poisson(pixels * burst * contrast[i]);  // clustered: the variance is burst + 1 times the mean
      matched += left[i];
    }
    int near = poisson(matched * (1 - share) / share + noise_per_us * static_cast<double>(dt_us));
    t += dt_us;
    interleave(left, near, dt_us);
    place += forth() ? step_px : -step_px;
    ++steps;
    if (health.edges_due()) health.judge_edges(square, square_at(place, place), t, kNoCounts);
  }

  bool forth() const { return (steps / 40) % 2 == 0; }
  bool polarity(std::size_t segment) {
    if (std::bernoulli_distribution(random_polarity[segment])(random)) return std::bernoulli_distribution(0.5)(random);
    return makes_on(segment, forth() ? Eigen::Vector2d(1, 1) : Eigen::Vector2d(-1, -1));
  }

  // As a tracker: judged whenever enough have come.
  void interleave(std::vector<int> left, int near, Timestamp dt_us) {
    const double total = left[0] + left[1] + left[2] + left[3] + near;
    double done = 0;
    while (left[0] + left[1] + left[2] + left[3] + near > 0) {
      const int all = left[0] + left[1] + left[2] + left[3] + near;
      int pick = std::uniform_int_distribution<int>(0, all - 1)(random);
      ++done;
      if (pick < near) {
        --near;
        health.add(MatchResult::near, 0, true);
      } else {
        pick -= near;
        int segment = 0;
        while (pick >= left[static_cast<std::size_t>(segment)]) pick -= left[static_cast<std::size_t>(segment++)];
        --left[static_cast<std::size_t>(segment)];
        health.add(MatchResult::matched, segment, polarity(static_cast<std::size_t>(segment)));
      }
      if (health.due()) {
        health.judge_matches(t - dt_us + static_cast<Timestamp>(done / total * static_cast<double>(dt_us)));
        ++blocks;
        CHECK_FALSE(std::isnan(health.probability()));
      }
    }
  }
  long blocks = 0;

  bool settle() {
    for (int i = 0; i < 200 && !health.lost(); ++i) move();
    return health.sure() && !health.lost();
  }
};

// How far a square moves at most from when `disturb` has changed it until `found`, in 50 runs [px].
template <typename Disturb, typename Found>
double farthest_px(double burst, const Disturb& disturb, const Found& found) {
  double farthest_px = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    MovingSquare scene(seed);
    scene.burst = burst;
    REQUIRE(scene.settle());
    disturb(scene);
    int moves = 0;
    while (!found(scene.health) && moves < 100) {
      scene.move();
      ++moves;
    }
    REQUIRE(found(scene.health));
    farthest_px = std::max(farthest_px, moves * scene.step_px);
  }
  MESSAGE("burst " << burst << ": at most " << farthest_px << " px");
  return farthest_px;
}

}  // namespace

TEST_CASE("markers that are followed are lost no oftener than stated, at any share of matched events") {
  // A loss by chance would be seen far sooner than at one in a million: at a stated rate of 1e-3, too.
  for (const double share : {0.7, 0.75, 0.8, 0.9, 0.98})
    for (const double burst : {1.0, 3.0, 10.0}) {
      CAPTURE(share);
      CAPTURE(burst);
      long blocks = 0;
      int lost = 0, unsure = 0;
      for (unsigned seed = 0; blocks < 70000; ++seed) {
        MovingSquare scene(seed + 1);
        scene.share = share;
        scene.burst = burst;
        for (int i = 0; i < 4000 && !scene.health.lost() && scene.blocks < 70000; ++i) {
          scene.move();
          unsure += i > 200 && !scene.health.sure();
        }
        blocks += scene.blocks;
        lost += scene.health.lost();
        if (scene.health.lost()) MESSAGE("lost: " << to_string(scene.health.reason()) << " after " << scene.blocks);
      }
      MESSAGE("share " << share << ", burst " << burst << ": " << lost << " lost in " << blocks << " blocks, unsure "
                       << unsure);
      CHECK(lost == 0);
    }
}

TEST_CASE("half of the edges without events are found within a few pixels of motion") {
  for (const double burst : {1.0, 3.0, 10.0}) {
    CAPTURE(burst);
    CHECK(farthest_px(
              burst,
              [](MovingSquare& scene) {
                scene.contrast = {1, 0.02, 1, 0.02};
              },
              [](const TrackHealth& health) { return health.lost() && health.reason() == LossReason::hidden; }) < 20);
  }
}

// With its pose off by 9 cm, 300 poses of a real tracker were called `tracking` at a health of 1: all events lay on
// edges, but on some of them all had the wrong polarity.
TEST_CASE("an edge whose events contradict its motion makes the marker doubtful within some pixels, but not lost") {
  for (const double burst : {1.0, 3.0, 10.0}) {
    CAPTURE(burst);
    CHECK(farthest_px(
              burst, [](MovingSquare& scene) { scene.random_polarity[0] = 1; },  // an eighth of all events contradicts
              [](const TrackHealth& health) { return health.doubtful() && !health.lost(); }) < 6);
  }
}

TEST_CASE("a marker that is doubted by its polarities alone is never lost, and trusted again once they fit") {
  MovingSquare scene(1);
  REQUIRE(scene.settle());
  scene.random_polarity[0] = 1;
  for (int i = 0; i < 200; ++i) scene.move();
  CHECK(scene.health.doubtful());
  CHECK_FALSE(scene.health.lost());
  scene.random_polarity[0] = 0.02;
  for (int i = 0; i < 4; ++i) scene.move();
  CHECK(scene.health.sure());
}

TEST_CASE("polarities as random as they always were are no evidence") {
  for (const double share : {0.0, 0.1, 0.3, 0.6, 1.0})
    for (unsigned seed = 1; seed <= 20; ++seed) {
      CAPTURE(share);
      CAPTURE(seed);
      MovingSquare scene(seed);
      std::ranges::fill(scene.random_polarity, share);
      for (int i = 0; i < 2000 && !scene.health.lost(); ++i) scene.move();
      CHECK_FALSE(scene.health.lost());
      CHECK(scene.health.sure());
    }
}

TEST_CASE("events that lie anywhere near the edges lose the marker within some hundred") {
  for (const double usual : {0.7, 0.8, 0.9, 0.98}) {
    CAPTURE(usual);
    int most = 0;
    for (unsigned seed = 1; seed <= 50; ++seed) {
      MovingSquare scene(seed);
      scene.share = usual;
      scene.burst = 1;
      REQUIRE(scene.settle());
      std::bernoulli_distribution matches(1.0 / 3);
      int events = 0;
      while (!scene.health.lost() && events < 20000) {
        scene.health.add(matches(scene.random) ? MatchResult::matched : MatchResult::near, events % 4, true);
        ++events;
        if (events % 20 == 0) ++scene.t;  // as dense as a moving marker's
        if (scene.health.due()) scene.health.judge_matches(scene.t);
      }
      REQUIRE(scene.health.lost());
      CHECK(scene.health.reason() == LossReason::inconsistent);
      most = std::max(most, events);
    }
    MESSAGE("usual share " << usual << ": at most " << most << " events");
    CHECK(most < 1000);
  }
}

// The rate of events beside the edges became 0 / 0, and such events spoke against no pose any more.
TEST_CASE("a start whose first events have one time stamp does not hide a loss") {
  TrackHealth health(kSquare, kFocalLength, {.false_alarm_rate = 1e-6});
  health.restart(0);
  health.judge_verification(true);
  Timestamp t = 0;
  const auto add = [&](int events, MatchResult match, Timestamp apart_us) {
    for (int i = 0; i < events && !health.lost(); ++i) {
      health.add(match, i % 4, true);
      t += apart_us;
      if (health.due()) health.judge_matches(t);
    }
  };
  add(640, MatchResult::matched, 0);
  REQUIRE(health.sure());
  add(5000, MatchResult::matched, 10);
  REQUIRE(health.sure());
  add(5000, MatchResult::near, 1);
  CHECK(health.lost());
}

// Behind a passing object its edge held a marker's pose for 0.5 s: few events beside the edges, by time, were taken for
// background, but none of those on the edges.
TEST_CASE("events that lie anywhere near the edges do not speak for the marker, however slowly they come") {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    CAPTURE(seed);
    MovingSquare scene(seed);
    REQUIRE(scene.settle());
    std::bernoulli_distribution matches(1.0 / 3);
    const auto add_anywhere = [&](Timestamp after_us) {
      scene.t += after_us;
      scene.health.add(matches(scene.random) ? MatchResult::matched : MatchResult::near, 0, true);
      if (scene.health.due()) scene.health.judge_matches(scene.t);
    };
    for (int i = 0; i < 2000 && !scene.health.doubtful(); ++i) add_anywhere(0);
    REQUIRE(scene.health.doubtful());
    double best = 0;
    for (int i = 0; i < 20000 && !scene.health.lost(); ++i) {
      add_anywhere(20);  // near ones less often than is usual here
      best = std::max(best, scene.health.probability());
    }
    CHECK(best < 0.75);
  }
}

TEST_CASE("noise at a constant rate at rest is no evidence") {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    MovingSquare scene(seed);
    scene.noise_per_us = 0.002;  // 2000 per second near the edges
    for (int i = 0; i < 1000; ++i) scene.move();
    REQUIRE(scene.health.sure());
    const double before = scene.health.probability();
    for (int i = 0; i < 5000 && !scene.health.lost(); ++i) {  // ten seconds at rest: hardly an event on an edge
      scene.t += 2000;
      scene.interleave({scene.poisson(0.1), 0, scene.poisson(0.1), 0}, scene.poisson(4), 2000);
    }
    CHECK_FALSE(scene.health.lost());
    CHECK(scene.health.probability() > 0.5);
    CHECK(before > 0.9);
  }
}

TEST_CASE("edges of very different contrast are measured by their own history") {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    CAPTURE(seed);
    // A body of which no dark side is told: its edges need not be of one ink on one paper.
    MarkerModel body = kSquare;
    for (MarkerSegment& segment : body.segments) segment.dark_side.setZero();
    MovingSquare scene(seed, 1e-6, body);
    scene.contrast = {2.4, 0.06, 0.8, 0.74};  // 1 on average
    for (int i = 0; i < 2000 && !scene.health.lost(); ++i) scene.move();
    CHECK_FALSE(scene.health.lost());
    CHECK(scene.health.sure());
  }
}

TEST_CASE("a pose that was moved without events is no evidence") {
  MovingSquare scene(1);
  REQUIRE(scene.settle());
  const double before = scene.health.probability();
  for (int i = 0; i < 20; ++i) {
    scene.place += 30;
    scene.health.restart_edges();
    scene.health.judge_edges(kSquare, square_at(scene.place, scene.place), scene.t, kNoCounts);
  }
  CHECK(scene.health.probability() == before);
  for (int i = 0; i < 100; ++i) scene.move();
  CHECK(scene.health.sure());
}

TEST_CASE("verifications and the state of things as one probability") {
  TrackHealth health(kSquare, kFocalLength, {});
  CHECK(health.probability() == 0.5);
  CHECK_FALSE(health.sure());  // no events yet
  CHECK_FALSE(health.lost());
  MovingSquare scene(3);
  REQUIRE(scene.settle());
  CHECK(scene.health.probability() > 0);
  CHECK(scene.health.probability() < 1);
  scene.health.judge_verification(true);
  CHECK(scene.health.sure());
  scene.health.restart(scene.t);
  CHECK(scene.health.probability() == 0.5);
  CHECK_FALSE(scene.health.lost());
  for (int i = 0; i < 7; ++i) scene.health.judge_verification(false);
  CHECK(scene.health.lost());
  CHECK(scene.health.reason() == LossReason::verification);
  CHECK(scene.health.probability() > 0);
}

TEST_CASE("a judgement cannot come with fewer events than are said to stay") {
  TrackHealth health(kSquare, kFocalLength, {});
  int events = 0;
  while (!health.due()) {
    for (const std::size_t more : {std::size_t{1}, std::size_t{9}, std::size_t{63}}) {
      TrackHealth later = health;
      for (std::size_t i = 0; i < more; ++i) later.add(MatchResult::near, 0, true);
      CHECK(health.not_due_within(more) == !later.due());
    }
    health.add(events % 2 == 0 ? MatchResult::matched : MatchResult::near, 0, true);
    health.add(MatchResult::far, 0, true);
    ++events;
  }
  CHECK(events == 64);
}

TEST_CASE("a rate that is none is refused by name") {
  for (const double rate : {0.0, -1.0, 0.5, std::nan("")}) {
    CAPTURE(rate);
    CHECK_THROWS_WITH(TrackHealth(kSquare, kFocalLength, {.false_alarm_rate = rate}),
                      doctest::Contains("false_alarm_rate"));
  }
}

TEST_CASE("no events are no evidence") {
  TrackHealth health(kSquare, kFocalLength, {});
  const double before = health.probability();
  health.judge_matches(10);
  CHECK(health.probability() == before);
  for (int i = 0; i < 5000 && !health.lost(); ++i) {
    health.add(MatchResult::near, 0, true);
    if (health.due()) health.judge_matches(20 + i);
  }
  CHECK(health.lost());
}
