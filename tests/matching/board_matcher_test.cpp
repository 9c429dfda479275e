#include "evmarker/matching/board_matcher.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <tuple>

#include "evmarker/base/so3.hpp"
#include "evmarker/matching/model_matcher.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/camera.hpp"
#include "matching/agreement.hpp"

using namespace evmarker;

namespace {

constexpr double kFocalLength = 533;

// Markers of different codes and sizes side by side, a little more than one cell apart.
Board random_plate(SeededNumbers& random, int columns, int rows) {
  Board board{.id = 900, .markers = {}};
  for (int i = 0; i < columns * rows; ++i) {
    BoardMarker marker{.id = i, .length = random(0.03, 0.042), .bits = random_bits(random, random.integer(3, 5))};
    marker.T_board_marker.translation() =
        0.05 * Eigen::Vector3d(i % columns - (columns - 1) / 2.0, i / columns - (rows - 1) / 2.0, 0);
    board.markers.push_back(marker);
  }
  return board;
}

// A marker on each side of a cube of 8 cm.
Board random_cube(SeededNumbers& random) {
  Board board{.id = 901, .markers = {}};
  for (int side = 0; side < 6; ++side) {
    BoardMarker marker{.id = side, .length = 0.06, .bits = random_bits(random, 4)};
    const Eigen::Vector3d turn = side < 4 ? Eigen::Vector3d(0, side * std::numbers::pi / 2, 0)
                                          : Eigen::Vector3d((side - 4.5) * std::numbers::pi, 0, 0);
    marker.T_board_marker.linear() = so3_exp(turn);
    marker.T_board_marker.translation() = 0.04 * marker.T_board_marker.linear().col(2);
    board.markers.push_back(marker);
  }
  return board;
}

struct Comparison {
  int matched = 0, near = 0, far = 0;  // as by SegmentMatcher
  int more_ambiguous = 0;              // than by SegmentMatcher
  int wrong = 0;
  int in_groups = 0;  // matched in a group
};

// An event beside a random edge.
Vec2 random_event(SeededNumbers& random, const MarkerModel& model, const Eigen::Isometry3d& T) {
  const auto& edge =
      model.segments[static_cast<std::size_t>(random.integer(0, static_cast<int>(model.segments.size()) - 1))];
  const Vec3 from = transform(T, model.vertices[static_cast<std::size_t>(edge.from)]),
             to = transform(T, model.vertices[static_cast<std::size_t>(edge.to)]);
  const double spread = (random.integer(0, 3) == 0 ? 12 : 3) / kFocalLength;
  const Vec3 place = from + random(-0.1, 1.1) * (to - from);
  return {place.x / place.z + random(-spread, spread), place.y / place.z + random(-spread, spread)};
}

// Whether a board's answer is the expected one, or it calls ambiguous what should be matched.
bool same(MatchResult result, const Correspondence& c, MatchResult expected, const Correspondence& expected_c,
          Comparison& comparison) {
  if (result == expected) return result != MatchResult::matched || agree(c, expected_c);
  const bool cautious = result == MatchResult::ambiguous && expected == MatchResult::matched;
  comparison.more_ambiguous += cautious;
  return cautious;
}

void compare(const BoardMatcher& board, const SegmentMatcher& segments, const Eigen::Isometry3d& T,
             SeededNumbers& random, Comparison& comparison) {
  EventGroup group;
  group.fill(GridMatcher::Choices::kMost, [&](std::size_t) {
    return std::tuple(Eigen::Vector2d(random_event(random, segments.model(), T)), Timestamp{7}, 1.0);
  });
  const auto first = static_cast<std::size_t>(random.integer(0, 20));
  BoardMatcher::Choices choices;
  board.choose_many(group, first, group.count() - first, choices);
  for (std::size_t i = first; i < group.count(); ++i) {
    const Vec2 m{group.x[i], group.y[i]};
    Correspondence expected, found;
    const MatchResult result = segments.match(m, expected);
    comparison.matched += result == MatchResult::matched;
    comparison.near += result == MatchResult::near;
    comparison.far += result == MatchResult::far;
    comparison.wrong += !same(board.match(m, found), found, result, expected, comparison);

    const BoardMatcher::Marker* const marker = choices.marker[i - first];
    if (marker == nullptr) {
      comparison.wrong += choices.stretch[i - first] == GridMatcher::Choices::kFar && result != MatchResult::far;
      continue;
    }
    const GridMatcher::Choice choice = marker->matcher.choice(choices.stretch[i - first], m);
    comparison.wrong += choice.result != result;
    if (choice.result != MatchResult::matched) continue;
    ++comparison.in_groups;
    comparison.wrong += marker->first_segment + choice.edge->segment != expected.segment;
  }
}

Comparison compare(const Board& design, double nearest_m, double farthest_m, unsigned seed) {
  SeededNumbers random(seed);
  const MarkerModel model = make_board_model(design);
  auto board = BoardMatcher::of(model, kFocalLength, {});
  REQUIRE(board);
  SegmentMatcher segments(model, kFocalLength);
  Comparison comparison;
  for (int pose = 0; pose < 300; ++pose) {  // one after the other, by one matcher
    const Eigen::Isometry3d T = random_pose(random, random(nearest_m, farthest_m), 1.3, random.integer(0, 7) == 0);
    const bool visible = segments.project(T);
    comparison.wrong += board->project(T) != visible;
    compare(*board, segments, T, random, comparison);
  }
  MESSAGE("matched " << comparison.matched << ", in groups " << comparison.in_groups << ", near " << comparison.near
                     << ", far " << comparison.far << ", more ambiguous " << comparison.more_ambiguous);
  return comparison;
}

}  // namespace

TEST_CASE("every event on a board is matched as by the search over all segments, but for a few between markers") {
  SeededNumbers random(5);
  for (const Board& board : {random_plate(random, 4, 3), random_plate(random, 10, 7), random_cube(random)}) {
    const Comparison comparison = compare(board, 0.2, 0.5, 6);
    CHECK(comparison.matched > 2000);
    CHECK(comparison.in_groups > comparison.matched / 3);
    CHECK(comparison.near > 100);
    CHECK(comparison.far > 100);
    CHECK(comparison.wrong == 0);
    CHECK(comparison.more_ambiguous < comparison.matched / 50);
  }
}

TEST_CASE("a board that is too far for its grids is matched as by the search over all segments, too") {
  SeededNumbers random(7);
  const Comparison comparison = compare(random_plate(random, 4, 3), 1.5, 3, 8);
  CHECK(comparison.matched > 2000);
  CHECK(comparison.wrong == 0);
  CHECK(comparison.more_ambiguous < comparison.matched / 10);
}

TEST_CASE("a board out of sight matches nothing, and is matched again when it is back") {
  SeededNumbers random(9);
  const MarkerModel model = make_board_model(random_plate(random, 2, 2));
  ModelMatcher matcher(model, kFocalLength);
  REQUIRE(matcher.board() != nullptr);
  Eigen::Isometry3d ahead = Eigen::Isometry3d::Identity();
  ahead.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  ahead.translation().z() = 0.5;
  Correspondence c;
  const Vec3 corner = transform(ahead, (model.vertices[0] + model.vertices[1]) / 2);
  const Vec2 m{corner.x / corner.z, corner.y / corner.z};
  REQUIRE(matcher.project(ahead));
  CHECK(matcher.match(m, c) == MatchResult::matched);
  CHECK(matcher.reach().contains(m));
  Eigen::Isometry3d behind = ahead;
  behind.translation().z() = -0.5;
  Eigen::Isometry3d nowhere = ahead;
  nowhere.translation().x() = std::numeric_limits<double>::quiet_NaN();
  for (const Eigen::Isometry3d& T : {behind, nowhere}) {
    CHECK_FALSE(matcher.move(T, 0.1));
    CHECK(matcher.match(m, c) == MatchResult::far);
    CHECK(matcher.reach().empty());
    CHECK(matcher.move(ahead, 0.1));
    CHECK(matcher.match(m, c) == MatchResult::matched);
  }
}

TEST_CASE("a wireframe that only says that it is a board is matched by the search over all segments") {
  SeededNumbers random(10);
  const MarkerModel model = make_board_model(random_plate(random, 2, 1));
  CHECK(ModelMatcher(model, kFocalLength).board() != nullptr);
  MarkerModel changed = model;
  changed.vertices[3].x() += 1e-6;
  CHECK(ModelMatcher(changed, kFocalLength).board() == nullptr);
  changed = model;
  changed.segments.pop_back();
  CHECK(ModelMatcher(changed, kFocalLength).board() == nullptr);
  changed = model;
  changed.codes.pop_back();
  CHECK(ModelMatcher(changed, kFocalLength).board() == nullptr);
  CHECK(ModelMatcher(make_square_marker(0.1), kFocalLength).board() == nullptr);
}
