#include "evmarker/tracking/edge_activity.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/simulation/trajectory.hpp"
#include "tracking/facing_square.hpp"

using namespace evmarker;
using namespace evmarker::test;

namespace {

// Moves a model between two places while every segment makes so many events, of the polarities that the motion makes;
// of every `wrong_every` one has the other.
struct Walk {
  MarkerModel model = kSquare;
  EdgeActivity activity{model, kFocalLength};
  Eigen::Vector2d place{0, 0};
  int wrong_every = 1000000;
  Timestamp t = 0;
  std::optional<EdgeActivity::Interval> interval;

  Walk() { activity.evaluate(model, square_at(0, 0), t, kNoCounts); }
  // Returns the evidence for hidden edges.
  std::optional<double> go(const Eigen::Vector2d& way, const std::vector<int>& events) {
    for (std::size_t segment = 0; segment < events.size(); ++segment)
      for (int i = 1; i <= events[segment]; ++i)
        activity.add(static_cast<int>(segment), makes_on(segment, way) == (i % wrong_every != 0));
    place += way;
    t += 1000;
    interval = activity.evaluate(model, square_at(place.x(), place.y()), t, kNoCounts);
    return interval ? std::optional(interval->markers[0].log_ratio_hidden) : std::nullopt;
  }
};

}  // namespace

TEST_CASE("the first question only says where the edges are, and too little motion says nothing") {
  EdgeActivity activity(kSquare, kFocalLength);
  CHECK_FALSE(activity.evaluate(kSquare, square_at(0, 0), 0, kNoCounts));
  CHECK_FALSE(activity.due());
  Walk walk;
  CHECK_FALSE(walk.go({0.5, 0.5}, {400, 400, 0, 400}));
  CHECK_FALSE(walk.activity.due());
  // What came before counts together with what comes after: all edges have made events over the whole way.
  const auto evidence = walk.go({2.5, 2.5}, {400, 400, 800, 400});
  REQUIRE(evidence);
  CHECK(*evidence < 0);
}

TEST_CASE("edges that all make events speak for the marker, two of four without events against it") {
  Walk seen, hidden;
  for (int i = 0; i < 5; ++i) {
    CHECK(seen.go({3, 3}, {800, 800, 800, 800}).value() < 0);
    CHECK(hidden.go({3, 3}, {800, 800, 800, 800}).value() < 0);
  }
  // 89 px by 3 px at three events per pixel.
  CHECK(seen.activity.events_per_passage() == doctest::Approx(800 / (89 * 3.0)).epsilon(0.02).scale(0));
  CHECK(hidden.go({3, 3}, {800, 0, 800, 0}).value() > 3);
}

TEST_CASE("polarities that fit the motion contradict nothing, whichever way it goes") {
  for (const Eigen::Vector2d& way : {Eigen::Vector2d(3, 3), {3, -3}, {-3, 3}, {-3, -3}}) {
    Walk walk;
    walk.go(way, {800, 800, 800, 800});
    for (int i = 0; i < 3; ++i) {
      REQUIRE(walk.go(way, {800, 800, 800, 800}));
      CHECK(walk.interval->events == 3200);
      CHECK(walk.interval->contradicting == 0);
      CHECK(walk.interval->duration_us == 1000);
    }
    walk.wrong_every = 8;
    walk.go(way, {800, 800, 800, 800});
    CHECK(walk.interval->contradicting == 400);
  }
}

TEST_CASE("events contradict the motion of edges that go on, not of those that turn, lie along it, or have no side") {
  Walk walk;
  for (int i = 0; i < 3; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  walk.wrong_every = 2;
  walk.go({3, -3}, {800, 800, 800, 800});
  CHECK(walk.interval->events == 1600);
  CHECK(walk.interval->contradicting == 800);
  walk.go({3, 0}, {0, 800, 0, 800});
  CHECK(walk.interval->contradicting == 800);
  for (MarkerSegment& segment : walk.model.segments) segment.dark_side.setZero();
  walk.activity = EdgeActivity(walk.model, kFocalLength);
  for (int i = 0; i < 3; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  CHECK(walk.interval->events == 0);
}

TEST_CASE("what an edge makes while it goes back and forth on its way contradicts nothing") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  // Four times the events: three ways forth and back beside the way that is left, so that 3 of 8 contradict.
  walk.wrong_every = 3;
  walk.go({3, 3}, {3200, 3200, 3200, 3200});
  CHECK(walk.interval->contradicting < 0.03 * walk.interval->events);
}

TEST_CASE("edges that turn about a point near their middle contradict nothing, as they move to both sides") {
  Walk walk;
  Eigen::Isometry3d T = square_at(0, 0);
  for (int k = 0; k < 5; ++k) {
    T.rotate(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitZ()));
    T.pretranslate(square_at(1.2, 1.2).translation() - square_at(0, 0).translation());
    for (int i = 0; i < 1600; ++i) walk.activity.add(i % 4, i % 8 < 4);
    walk.interval = walk.activity.evaluate(walk.model, T, 1000 * (k + 1), kNoCounts);
    REQUIRE(walk.interval);
    CHECK(walk.interval->events == 0);
  }
}

TEST_CASE("edges that are not wholly in the image need no events") {
  std::vector<int> events;  // of edges wholly in the left half of the image
  for (const MarkerSegment& segment : kSquare.segments) {
    const auto is_left = [&](int vertex) {
      return (square_at(0, 0) * kSquare.vertices[static_cast<std::size_t>(vertex)]).x() < 0;
    };
    events.push_back(is_left(segment.from) && is_left(segment.to) ? 800 : 0);
  }
  REQUIRE(std::ranges::count(events, 800) == 1);
  Walk seen, beyond;
  const double far = std::numeric_limits<double>::infinity();
  beyond.activity = EdgeActivity(beyond.model, kFocalLength, Box{{-far, -far}, {0, far}});
  beyond.activity.evaluate(beyond.model, square_at(0, 0), 0, kNoCounts);
  for (Walk* walk : {&seen, &beyond}) walk->go({-3, 3}, {800, 800, 800, 800});
  CHECK(seen.go({-3, 3}, events).value() > 3);
  CHECK(beyond.go({-3, 3}, events).value() < 0);
  CHECK(beyond.activity.events_per_passage() == doctest::Approx(800 / (89 * 3.0)).epsilon(0.02).scale(0));
}

TEST_CASE("edges along the motion need no events") {
  Walk seen, hidden;
  for (int i = 0; i < 3; ++i) {
    CHECK(seen.go({4, 0}, {0, 800, 0, 800}).value() < 0);
    hidden.go({4, 0}, {0, 800, 0, 800});
  }
  CHECK(hidden.go({4, 0}, {0, 800, 0, 0}).value() > 0);
}

TEST_CASE("an edge that moved along itself amid its neighbours' events is not missed when it moves across") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  // Edges lie close together at a grazing angle: some of what a neighbour makes is matched to an edge that makes none.
  for (int i = 0; i < 20; ++i) walk.go({4, 0.01}, {400, 800, 0, 800});
  CHECK(walk.go({3, 3}, {800, 800, 800, 800}).value() < 0);
}

TEST_CASE("what a sensor's noise adds at rest is not taken for the edges' events when they move again") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  const double before = walk.activity.events_per_passage();
  for (int i = 0; i < 250; ++i) CHECK_FALSE(walk.go({0, 0}, {100, 100, 100, 100}));
  for (int i = 0; i < 3; ++i) CHECK(walk.go({1.5, 1.5}, {400, 400, 400, 400}).value() < 0);
  CHECK(walk.activity.events_per_passage() == doctest::Approx(before).epsilon(0.3).scale(0));
  CHECK(walk.go({3, 3}, {800, 0, 800, 0}).value() > 3);
}

TEST_CASE("a pixel that makes more events than it used to does so from the first pixel of a slow motion") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  const double before = walk.activity.events_per_passage();
  for (int i = 0; i < 100; ++i) walk.go({0.25, 0.25}, {600, 600, 600, 600});
  CHECK(walk.activity.events_per_passage() == doctest::Approx(9 * before).epsilon(0.1).scale(0));
}

TEST_CASE("rates that were too high come down again, so that hidden edges are found") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {8000, 8000, 8000, 8000});
  for (int i = 0; i < 40; ++i) CHECK(walk.go({3, 3}, {800, 800, 800, 800}).value_or(0) < 1);
  CHECK(walk.go({3, 3}, {800, 0, 800, 0}).value() > 3);
}

TEST_CASE("an edge on a side that is turned away is not missed") {
  Walk walk;
  walk.model.segments[3].face_normal = -Eigen::Vector3d::UnitZ();
  walk.activity = EdgeActivity(walk.model, kFocalLength);
  walk.go({0, 0}, {});
  for (int i = 0; i < 5; ++i) CHECK(walk.go({3, 3}, {800, 800, 800, 0}).value() < 0);
}

TEST_CASE("events of a side that is seen at a grazing angle are no events of the sides in full sight") {
  // The square is the front of a body. Its other side is nearly turned away, and makes as many events.
  Walk walk;
  const Eigen::Vector3d grazing(0.98, 0, 0.199);
  for (int i = 0; i < 4; ++i) {
    MarkerSegment segment = walk.model.segments[static_cast<std::size_t>(i)];
    segment.face_normal = grazing;
    walk.model.segments.push_back(segment);
  }
  walk.activity = EdgeActivity(walk.model, kFocalLength);
  walk.go({0, 0}, {});
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800, 800, 800, 800, 800});
  CHECK(walk.activity.events_per_passage() == doctest::Approx(800 / (89 * 3.0)).epsilon(0.02).scale(0));
}

TEST_CASE(
    "a marker that is seen at a grazing angle says nothing, and its events are counted again when it turns back") {
  Walk walk;
  for (auto& segment : walk.model.segments) segment.face_normal = Eigen::Vector3d::UnitZ();
  walk.activity = EdgeActivity(walk.model, kFocalLength);
  walk.go({0, 0}, {});
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  const double before = walk.activity.events_per_passage();
  for (const double x : {20.0, 25.0, 30.0}) {
    for (int i = 0; i < 1000; ++i) walk.activity.add(i % 4, true);
    Eigen::Isometry3d grazing = square_at(x, 20);
    grazing.rotate(Eigen::AngleAxisd(1.4, Eigen::Vector3d::UnitY()));
    CHECK_FALSE(walk.activity.evaluate(walk.model, grazing, walk.t, kNoCounts));
    CHECK_FALSE(walk.activity.due());
    CHECK(walk.activity.events_per_passage() == before);
  }
  CHECK_FALSE(walk.go({40, 40}, {800, 800, 800, 800}));  // the way back is not known
  CHECK(walk.go({3, 3}, {800, 800, 800, 800}).value() < 0);
  CHECK(walk.activity.events_per_passage() == doctest::Approx(before).epsilon(0.01).scale(0));
}

TEST_CASE("a pose that moved without events says nothing, for no edge confirms the motion") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  CHECK(std::abs(walk.go({3, 3}, {0, 0, 0, 0}).value_or(0)) < 0.1);
  // Forgotten on request: what came before the jump is not compared with the way after it.
  walk.activity.restart();
  CHECK_FALSE(walk.go({50, 50}, {}));
  CHECK(walk.go({3, 3}, {800, 800, 800, 800}).value() < 0);
}

TEST_CASE("a pose that is no pose says nothing and leaves nothing behind") {
  Walk walk;
  for (int i = 0; i < 5; ++i) walk.go({3, 3}, {800, 800, 800, 800});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double before = walk.activity.events_per_passage();
  CHECK_FALSE(walk.activity.evaluate(kSquare, square_at(nan, 0), walk.t, kNoCounts));
  CHECK(walk.activity.events_per_passage() == before);
}
