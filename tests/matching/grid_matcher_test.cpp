#include "evmarker/matching/grid_matcher.hpp"

#include <doctest/doctest.h>

#include <limits>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "matching/agreement.hpp"
#include "random_pose.hpp"

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using evmarker::Correspondence;
using evmarker::Correspondences;
using evmarker::EventGroup;
using evmarker::GridMatcher;
using evmarker::GridMatches;
using evmarker::make_code_marker;
using evmarker::make_square_marker;
using evmarker::MarkerModel;
using evmarker::MatchResult;
using evmarker::PinholeCamera;
using evmarker::SegmentMatcher;
using evmarker::SegmentMatcherSettings;
using evmarker::Timestamp;
using evmarker::UndistortionTable;
namespace simd = evmarker::simd;

namespace {

constexpr double kPi = std::numbers::pi;

// One in eight is seen from behind.
Isometry3d pose_from_any_side(SeededNumbers& random, double distance, double max_tilt) {
  const bool from_behind = random.integer(0, 7) == 0;
  return random_pose(random, distance, max_tilt, from_behind);
}

struct Tally {
  int matched = 0, ambiguous = 0, near = 0, far = 0, on_grid = 0, disagreements = 0;

  int events() const { return matched + ambiguous + near + far; }
  void add(MatchResult result) {
    matched += result == MatchResult::matched;
    ambiguous += result == MatchResult::ambiguous;
    near += result == MatchResult::near;
    far += result == MatchResult::far;
  }
};

int near_in_groups = 0;  // answers of that kind

// Whether the event, at a random place among others, gets the same answer, in lanes and with what it means in space.
bool same_in_group(const GridMatcher& grid, const Vector2d& m, MatchResult result, const Correspondence& expected) {
  static SeededNumbers random(3);
  const auto count = static_cast<std::size_t>(random.integer(1, EventGroup::kMost)),
             place = static_cast<std::size_t>(random.integer(0, static_cast<int>(count) - 1));
  EventGroup group;
  group.fill(count, [&](std::size_t i) {
    const Vector2d other = m + Vector2d(random(-0.02, 0.02), random(-0.02, 0.02));
    return std::tuple(i == place ? m : other, Timestamp{7}, 1.0);
  });
  const auto most = std::min(place + 1, GridMatcher::Choices::kMost),
             first = place + 1 - static_cast<std::size_t>(random.integer(1, static_cast<int>(most)));
  GridMatcher::Choices choices;
  grid.choose_many(group, first, std::min(count - first, GridMatcher::Choices::kMost), choices);
  const int stretch = choices.stretch[place - first];
  const GridMatcher::Choice careful = grid.choose(m);
  if (careful.result != result) return false;
  if (stretch == GridMatcher::Choices::kFar) return result == MatchResult::far;
  near_in_groups += stretch == GridMatcher::Choices::kNear;
  if (stretch == GridMatcher::Choices::kNear) return result == MatchResult::near;
  if (stretch != GridMatcher::Choices::kUnsure && &grid.stretch(stretch) != careful.edge) return false;
  if (result != MatchResult::matched) return stretch == GridMatcher::Choices::kUnsure;

  GridMatches matches;
  matches.count = static_cast<std::size_t>(random.integer(1, simd::kLanes));
  const auto lane = static_cast<std::size_t>(random.integer(0, static_cast<int>(matches.count) - 1));
  for (std::size_t i = 0; i < matches.count; ++i) matches.set(i, m, 7, -1, 0, 0, *careful.edge, 0.7);
  Correspondences c;
  evmarker::correspond(
      matches, [&](std::size_t) -> const auto& { return grid.projected(); }, grid.focal_length(), c);
  Correspondence found = expected;
  found.segment = careful.edge->segment;
  found.distance_px = c.distance_px[lane];
  found.M = {c.M_x[lane], c.M_y[lane], 1};
  found.F = {c.F_x[lane], c.F_y[lane], c.F_z[lane]};
  found.E = {c.E_x[lane], c.E_y[lane], c.E_z[lane]};
  found.gradient = {c.g_x[lane], c.g_y[lane], c.g_z[lane]};
  return agree(found, expected) && c.t[lane] == 7 && c.polarity[lane] == -1 && c.is_event[lane] == 1 &&
         c.contrast[lane] == 0.7 && c.count == matches.count && simd::sum(c.is_event) == static_cast<double>(c.count);
}

void compare(const GridMatcher& grid, const SegmentMatcher& segments, const Vector2d& m, Tally& tally) {
  Correspondence expected, found;
  const MatchResult result = segments.match(m, expected);
  tally.add(result);
  tally.on_grid += grid.on_grid();
  const bool same = grid.match(m, found) == result && (result != MatchResult::matched || agree(found, expected)) &&
                    (!grid.on_grid() || same_in_group(grid, m, result, expected));
  tally.disagreements += !same;
  if (same || tally.disagreements > 5) return;
  CAPTURE(result);
  CAPTURE(grid.match(m, found));
  CAPTURE(expected.segment);
  CAPTURE(found.segment);
  CAPTURE(expected.distance_px);
  CAPTURE(found.distance_px);
  CAPTURE(expected.E.transpose());
  CAPTURE(found.E.transpose());
  CHECK_MESSAGE(same, "the matchers disagree");
}

struct Trial {
  double distance_low, distance_high, max_tilt;  // [m], [m], [rad]
  int poses, events;
  SegmentMatcherSettings settings;
};

// Events at random pixels, most of them close to a random place of a random edge.
Tally run(const PinholeCamera& camera, const Trial& trial, unsigned seed) {
  SeededNumbers random(seed);
  const UndistortionTable lines(camera);
  const double focal_length = lines.focal_length();
  const auto size = lines.sensor_size();
  Tally tally;
  for (int i = 0; i < trial.poses; ++i) {
    const double length = random(0.05, 0.2);
    const int kind = random.integer(0, 5);
    const MarkerModel model =
        kind == 0 ? make_square_marker(length) : make_code_marker(length, random_bits(random, 2 + kind));
    GridMatcher grid(model, focal_length, trial.settings);
    SegmentMatcher segments(model, focal_length, trial.settings);
    const Isometry3d T = pose_from_any_side(random, random(trial.distance_low, trial.distance_high), trial.max_tilt);
    if (grid.project(T) != segments.project(T)) ++tally.disagreements;
    for (int k = 0; k < trial.events; ++k) {
      const auto& edge =
          model.segments[static_cast<std::size_t>(random.integer(0, static_cast<int>(model.segments.size()) - 1))];
      const Vector3d from = model.vertices[static_cast<std::size_t>(edge.from)],
                     to = model.vertices[static_cast<std::size_t>(edge.to)];
      const double place = random.integer(0, 2) == 0 ? random.integer(0, 1) : random(-0.1, 1.1);  // many at the ends
      const double spread = random.integer(0, 9) == 0 ? 100 : random.integer(0, 3) == 0 ? 8 : 3;
      const Vector2d pixel =
          camera.project(T * (from + place * (to - from))) + Vector2d(random(-spread, spread), random(-spread, spread));
      const Vector2d rounded(std::round(pixel.x()), std::round(pixel.y()));
      if (!(rounded.x() >= 0 && rounded.y() >= 0 && rounded.x() < size.width && rounded.y() < size.height)) continue;
      compare(grid, segments,
              lines({static_cast<std::uint16_t>(rounded.x()), static_cast<std::uint16_t>(rounded.y()), true, 0}),
              tally);
    }
  }
  MESSAGE("events ", tally.events(), ", through the grid ", tally.on_grid, ": matched ", tally.matched, ", ambiguous ",
          tally.ambiguous, ", near ", tally.near, ", far ", tally.far);
  return tally;
}

const PinholeCamera kStraight{{640, 480}, 533, 533, 319.5, 239.5};
const PinholeCamera kDistorted{{640, 480}, 420, 424,
                               310,        247, evmarker::BrownConradyDistortion{-0.32, 0.11, 0.001, -0.002, -0.02}};

}  // namespace

TEST_CASE("every event is matched as by the search over all segments: near, tilted to 70 degrees, distorted") {
  for (const PinholeCamera& camera : {kStraight, kDistorted}) {
    const Tally tally = run(camera, {0.25, 1.0, 70 * kPi / 180, 4500, 100, {}}, 11);
    CHECK(tally.disagreements == 0);
    CHECK(tally.events() > 400000);
    CHECK(tally.on_grid > 300000);
    CHECK(tally.on_grid < tally.events());  // and poses that are left to the search
    CHECK(tally.matched > 200000);
    CHECK(tally.ambiguous > 10000);
    CHECK(tally.near > 100000);
    CHECK(tally.far > 50000);
    CHECK(near_in_groups > 10000);
  }
}

TEST_CASE("every event is matched as by the search over all segments: other margins, distances and ambiguities") {
  unsigned seed = 20;
  for (const SegmentMatcherSettings& settings :
       {SegmentMatcherSettings{.max_distance_px = 1, .end_margin_px = 0, .ambiguity_px = 1},
        SegmentMatcherSettings{.max_distance_px = 4, .end_margin_px = 3, .ambiguity_px = 0.1},
        SegmentMatcherSettings{.max_distance_px = 0.5, .end_margin_px = 2, .ambiguity_px = 5},
        SegmentMatcherSettings{.max_distance_px = 3, .end_margin_px = 0.5, .ambiguity_px = 0}}) {
    const Tally tally = run(kDistorted, {0.15, 0.8, 75 * kPi / 180, 1000, 100, settings}, ++seed);
    CHECK(tally.disagreements == 0);
    CHECK(tally.events() > 50000);
    CHECK((tally.on_grid > 0) == (settings.ambiguity_px > 0));
    CHECK(tally.matched > 1000);
  }
}

TEST_CASE("a matcher that goes from pose to pose, with matching distances that change, matches like one that is new") {
  SeededNumbers random(5);
  const MarkerModel model = make_code_marker(0.1, random_bits(random, 4));
  GridMatcher grid(model, 533);
  SegmentMatcher segments(model, 533);
  Tally tally;
  Isometry3d T = pose_from_any_side(random, 0.5, 0.3);
  int changes = 0;
  for (int i = 0; i < 3000; ++i) {
    // A slow motion with a jump now and then, also to where the marker is too small for the grid or behind the
    // camera.
    T.translation() += Vector3d(random(-1, 1), random(-1, 1), random(-1, 1)) * 1e-3;
    if (i % 50 == 0) T = pose_from_any_side(random, random(0.2, 2), 1.4);
    if (i % 500 == 49) T.translation() *= -1;
    if (i % 100 == 99) {
      const double distance = random(1, 4);
      grid.set_max_distance_px(distance);
      segments.set_max_distance_px(distance);
      CHECK(grid.max_distance_px() == doctest::Approx(distance).scale(0));
    }
    const bool on_grid = grid.on_grid();
    const bool visible = segments.project(T);
    REQUIRE(grid.project(T) == visible);
    changes += grid.on_grid() != on_grid;
    for (int k = 0; k < 20; ++k) {
      const Vector3d P = T * Vector3d(random(-0.055, 0.055), random(-0.055, 0.055), 0);
      compare(grid, segments, P.head<2>() / P.z(), tally);
    }
  }
  CHECK(tally.disagreements == 0);
  CHECK(tally.matched > 10000);
  CHECK(changes > 10);
}

TEST_CASE("no event matches without a pose, a line of sight or a marker in front of the camera") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  GridMatcher matcher(make_square_marker(0.1), 500);
  Correspondence c;
  const Vector2d on_edge(0.05 / 0.5, 0);
  CHECK(matcher.match(on_edge, c) == MatchResult::far);  // not projected yet
  Isometry3d ahead = Isometry3d::Identity();
  ahead.linear() = Eigen::AngleAxisd(kPi, Vector3d::UnitX()).toRotationMatrix();
  ahead.translation().z() = 0.5;
  REQUIRE(matcher.project(ahead));
  REQUIRE(matcher.on_grid());
  CHECK(matcher.match(on_edge, c) == MatchResult::matched);
  for (const Vector2d& m : {Vector2d(nan, nan), Vector2d(0.1, nan), Vector2d(nan, 0), Vector2d(infinity, 0)})
    CHECK(matcher.match(m, c) == MatchResult::far);
  for (const double bad : {nan, infinity, -infinity, -0.5, 0.0}) {
    Isometry3d T = ahead;
    T.translation().z() = bad;
    CHECK_FALSE(matcher.project(T));
    CHECK(matcher.match(on_edge, c) == MatchResult::far);
  }
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column) {
      Isometry3d T = ahead;
      T(row, column) = nan;
      CHECK_FALSE(matcher.project(T));
      CHECK(matcher.match(on_edge, c) == MatchResult::far);
    }
  REQUIRE(matcher.project(ahead));  // and comes back
  CHECK(matcher.match(on_edge, c) == MatchResult::matched);
}

TEST_CASE("a matcher that has hardly moved keeps its choices, and says where these edges are now") {
  SeededNumbers random(12);
  const MarkerModel model = make_code_marker(0.1, random_bits(random, 4));
  const double focal_length = 533, pixel = 0.6 / focal_length;
  Isometry3d T = random_pose(random, 0.6, 0.2, false);
  T.translation() = Vector3d(0, 0, 0.6);
  GridMatcher grid(model, focal_length);
  SegmentMatcher segments(model, focal_length);
  REQUIRE(grid.project(T));
  REQUIRE(grid.on_grid());
  const GridMatcher before = grid;
  Isometry3d moved = T;
  moved.translation() += 0.3 * pixel * Vector3d(1, -1, 0);
  REQUIRE(grid.move(moved, 0.5));
  CHECK(grid.times_edges_chosen() == before.times_edges_chosen());
  REQUIRE(segments.project(moved));
  int kept = 0, where_it_is = 0;
  for (int i = 0; i < 4000; ++i) {
    const Vector3d P = T * Vector3d(random(-0.055, 0.055), random(-0.055, 0.055), 0);
    const Vector2d m = P.head<2>() / P.z();
    Correspondence found, then, now;
    const MatchResult result = grid.match(m, found);
    REQUIRE(result == before.match(m, then));
    if (result != MatchResult::matched) continue;
    REQUIRE(found.segment == then.segment);
    ++kept;
    if (segments.match(m, now) != MatchResult::matched || now.segment != found.segment) continue;
    REQUIRE(agree(found, now));
    where_it_is += std::abs(now.distance_px - then.distance_px) > 0.1;
  }
  CHECK(kept > 500);
  CHECK(where_it_is > 500);
  moved.translation() += 0.3 * pixel * Vector3d(1, -1, 0);
  REQUIRE(grid.move(moved, 0.5));
  CHECK(grid.times_edges_chosen() == before.times_edges_chosen() + 1);
}

TEST_CASE("a wireframe without a grid is matched by the search over all segments") {
  SeededNumbers random(8);
  MarkerModel model = make_code_marker(0.1, random_bits(random, 4));
  model.cells = 0;
  GridMatcher matcher(model, 533);
  SegmentMatcher segments(model, 533);
  Tally tally;
  for (int i = 0; i < 100; ++i) {
    const Isometry3d T = pose_from_any_side(random, 0.5, 0.8);
    REQUIRE(matcher.project(T) == segments.project(T));
    for (int k = 0; k < 50; ++k) {
      const Vector3d P = T * Vector3d(random(-0.055, 0.055), random(-0.055, 0.055), 0);
      compare(matcher, segments, P.head<2>() / P.z(), tally);
    }
  }
  CHECK(tally.disagreements == 0);
  CHECK(tally.on_grid == 0);
  CHECK(tally.matched > 500);
}
