#include "evmarker/matching/segment_matcher.hpp"

#include <doctest/doctest.h>

#include <map>
#include <numbers>
#include <random>
#include <string>

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using evmarker::Correspondence;
using evmarker::make_square_marker;
using evmarker::MarkerModel;
using evmarker::MatchResult;
using evmarker::SegmentMatcher;
using evmarker::SegmentMatcherSettings;

namespace {

constexpr double kFocal = 500;

// A cube of 8 cm; the dark side of every edge lies in one of its two faces.
MarkerModel make_cube() {
  MarkerModel cube;
  for (int i = 0; i < 8; ++i)
    cube.vertices.emplace_back(i & 1 ? 0.04 : -0.04, i & 2 ? 0.04 : -0.04, i & 4 ? 0.04 : -0.04);
  for (int i = 0; i < 8; ++i)
    for (int axis = 0; axis < 3; ++axis)
      if (!(i & (1 << axis))) {
        Vector3d dark = Vector3d::Zero();
        const int other = (axis + 1) % 3;
        dark(other) = i & (1 << other) ? -1 : 1;
        cube.segments.push_back({i, i | (1 << axis), dark});
      }
  return cube;
}

Isometry3d pose(const Vector3d& rotation, const Vector3d& translation) {
  Isometry3d T = Isometry3d::Identity();
  if (rotation.norm() > 0) T.linear() = Eigen::AngleAxisd(rotation.norm(), rotation.normalized()).toRotationMatrix();
  T.translation() = translation;
  return T;
}

Vector2d pixel_of(const Vector3d& point) { return {kFocal * point.x() / point.z(), kFocal * point.y() / point.z()}; }

// Where a function with one minimum has it.
template <typename Function>
double minimum_of(const Function& f, double low, double high) {
  for (int i = 0; i < 60; ++i) {
    const double a = low + 0.382 * (high - low), b = low + 0.618 * (high - low);
    if (f(a) < f(b))
      high = b;
    else
      low = a;
  }
  return (low + high) / 2;
}

// What a search by trial finds for one segment and one event.
struct Found {
  double distance_px, beyond_px;  // from the endless edge in the image; of the foot beyond its nearer end
  Vector3d E, F;
  double a2;
};

Found search(const Vector3d& from, const Vector3d& to, const Vector2d& m) {
  Found found{};
  const Vector2d a = pixel_of(from), b = pixel_of(to), u = kFocal * m;
  const double foot = minimum_of([&](double s) { return (u - a - s * (b - a)).squaredNorm(); }, -50, 50);
  found.distance_px = (u - a - foot * (b - a)).norm();
  found.beyond_px = std::max(-foot, foot - 1) * (b - a).norm();
  // The nearest points of the line of sight and the segment.
  const Vector3d M(m.x(), m.y(), 1);
  const auto along_sight = [&](const Vector3d& E) {
    return minimum_of([&](double a1) { return (a1 * M - E).squaredNorm(); }, 0, 20);
  };
  found.a2 = minimum_of(
      [&](double a2) {
        const Vector3d E = from + a2 * (to - from);
        return (along_sight(E) * M - E).squaredNorm();
      },
      0, 1);
  found.E = from + found.a2 * (to - from);
  found.F = along_sight(found.E) * M;
  return found;
}

SegmentMatcher lone_edge(const SegmentMatcherSettings& settings = {}) {  // from (-50, 0) to (50, 0) px, dark below
  return {{{{-0.1, 0, 0}, {0.1, 0, 0}}, {{0, 1, {0, 1, 0}}}}, kFocal, settings};
}
const Isometry3d kAhead = pose({0, 0, 0}, {0, 0, 1});  // the camera's axes: y down

MarkerModel square_seen_from_everywhere() {
  MarkerModel square = make_square_marker(0.1);
  for (auto& edge : square.segments) edge.face_normal.setZero();
  return square;
}

MatchResult match_px(const SegmentMatcher& matcher, double x, double y) {
  Correspondence c;
  return matcher.match({x / kFocal, y / kFocal}, c);
}

}  // namespace

TEST_CASE("matches agree with a search by trial, over random poses of a square and a cube") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::map<MatchResult, int> seen;
  for (const MarkerModel& model : {square_seen_from_everywhere(), make_cube()}) {
    SegmentMatcher matcher(model, kFocal);
    for (int trial = 0; trial < 40; ++trial) {
      const Isometry3d T = pose(2 * Vector3d(unit(random), unit(random), unit(random)),
                                {0.3 * unit(random), 0.2 * unit(random), 0.7 + 0.4 * unit(random)});
      REQUIRE(matcher.project(T));
      for (int event = 0; event < 25; ++event) {
        // Near a random place of a random edge.
        const auto& edge = model.segments[random() % model.segments.size()];
        const Vector3d near_edge =
            T * model.vertices[static_cast<std::size_t>(edge.from)] +
            (0.5 + 0.52 * unit(random)) * (T.linear() * (model.vertices[static_cast<std::size_t>(edge.to)] -
                                                         model.vertices[static_cast<std::size_t>(edge.from)]));
        const Vector2d m = (pixel_of(near_edge) + 4 * Vector2d(unit(random), unit(random))) / kFocal;

        double best = 1e9, second = 1e9;
        int nearest = -1;
        Found closest{};
        bool on_a_threshold = false;
        for (std::size_t i = 0; i < model.segments.size(); ++i) {
          const Found found = search(T * model.vertices[static_cast<std::size_t>(model.segments[i].from)],
                                     T * model.vertices[static_cast<std::size_t>(model.segments[i].to)], m);
          on_a_threshold = on_a_threshold || std::abs(found.beyond_px - 0.5) < 1e-4;
          if (found.beyond_px > 0.5) continue;
          if (found.distance_px < best) {
            second = best;
            best = found.distance_px;
            nearest = static_cast<int>(i);
            closest = found;
          } else {
            second = std::min(second, found.distance_px);
          }
        }
        if (on_a_threshold || std::abs(best - 2) < 1e-4 || std::abs(best - 6) < 1e-4 ||
            std::abs(second - best - 0.2) < 1e-4)
          continue;
        const MatchResult expected = best > 6              ? MatchResult::far
                                     : best > 2            ? MatchResult::near
                                     : second - best < 0.2 ? MatchResult::ambiguous
                                                           : MatchResult::matched;
        Correspondence c;
        CAPTURE(best);
        CAPTURE(second);
        REQUIRE(matcher.match(m, c) == expected);
        ++seen[expected];
        if (expected != MatchResult::matched) continue;
        CHECK(c.segment == nearest);
        CHECK(std::abs(c.distance_px) == doctest::Approx(best).epsilon(1e-5));
        CHECK((c.M - Vector3d(m.x(), m.y(), 1)).norm() == 0);
        CHECK((c.E - closest.E).norm() < 1e-5);
        CHECK((c.F - closest.F).norm() < 1e-5);
        // F = L E, so E - F is perpendicular to the line of sight; to the segment too unless E is one of its ends.
        const Vector3d M = c.M.normalized();
        CHECK((c.F - M * M.transpose() * c.E).norm() < 1e-12);
        CHECK(std::abs((c.E - c.F).dot(M)) < 1e-12);
        const auto& segment = model.segments[static_cast<std::size_t>(nearest)];
        const Vector3d S = T.linear() * (model.vertices[static_cast<std::size_t>(segment.to)] -
                                         model.vertices[static_cast<std::size_t>(segment.from)]);
        if (closest.a2 > 1e-4 && closest.a2 < 1 - 1e-4) CHECK(std::abs((c.E - c.F).dot(S.normalized())) < 1e-12);
      }
    }
  }
  CHECK(seen[MatchResult::matched] > 400);
  CHECK(seen[MatchResult::ambiguous] > 10);
  CHECK(seen[MatchResult::near] > 100);
  CHECK(seen[MatchResult::far] > 5);
}

TEST_CASE("the normal points where the edge goes when it moves into the dark") {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> unit(-1, 1);
  int checked = 0;
  for (const MarkerModel& model : {square_seen_from_everywhere(), make_cube()})
    for (std::size_t i = 0; i < model.segments.size(); ++i)
      for (int trial = 0; trial < 20; ++trial) {
        const auto& edge = model.segments[i];
        const Isometry3d T =
            pose(2 * Vector3d(unit(random), unit(random), unit(random)), {0.2 * unit(random), 0.2 * unit(random), 0.6});
        // The edge alone, so that nothing is ambiguous.
        SegmentMatcher matcher({model.vertices, {edge}}, kFocal);
        REQUIRE(matcher.project(T));
        const Vector3d middle =
            (model.vertices[static_cast<std::size_t>(edge.from)] + model.vertices[static_cast<std::size_t>(edge.to)]) /
            2;
        const Vector2d before = pixel_of(T * middle), after = pixel_of(T * (middle + 1e-6 * edge.dark_side));
        Correspondence c;
        REQUIRE(matcher.match(before / kFocal, c) == MatchResult::matched);
        CHECK(c.dark_side_known);
        CHECK(c.normal.norm() == doctest::Approx(1));
        const Vector2d along = (pixel_of(T * model.vertices[static_cast<std::size_t>(edge.to)]) -
                                pixel_of(T * model.vertices[static_cast<std::size_t>(edge.from)]))
                                   .normalized();
        CHECK(std::abs(c.normal.dot(along)) < 1e-9);
        const double toward_dark = c.normal.dot(after - before);
        if (toward_dark < 1e-6 && toward_dark > -1e-6) continue;  // seen edge-on: neither side is the dark one
        CHECK(toward_dark > 0);
        ++checked;
        // Signed along the normal.
        Correspondence inside, outside;
        REQUIRE(matcher.match((before + 1.25 * c.normal) / kFocal, inside) == MatchResult::matched);
        REQUIRE(matcher.match((before - 0.75 * c.normal) / kFocal, outside) == MatchResult::matched);
        CHECK(inside.distance_px == doctest::Approx(1.25));
        CHECK(outside.distance_px == doctest::Approx(-0.75));
      }
  CHECK(checked > 300);
}

TEST_CASE("an edge without a known dark side says so") {
  SegmentMatcher matcher({{{-0.1, 0, 0}, {0.1, 0, 0}}, {{0, 1, Vector3d::Zero()}}}, kFocal);
  REQUIRE(matcher.project(kAhead));
  Correspondence c;
  REQUIRE(matcher.match({0, 0.002}, c) == MatchResult::matched);
  CHECK_FALSE(c.dark_side_known);
  CHECK(std::abs(c.normal.y()) == doctest::Approx(1));
  CHECK(c.distance_px * c.normal.y() == doctest::Approx(1));  // still signed along the normal
}

TEST_CASE("a match worked by hand") {
  SegmentMatcher matcher = lone_edge();
  REQUIRE(matcher.project(kAhead));
  Correspondence c;
  REQUIRE(matcher.match({0.05, 0.003}, c) == MatchResult::matched);  // (25, 1.5) px
  CHECK(c.segment == 0);
  CHECK(c.distance_px == doctest::Approx(1.5));
  CHECK((c.normal - Vector2d(0, 1)).norm() < 1e-15);
  CHECK(c.M == Vector3d(0.05, 0.003, 1));
  // E = (x, 0, 1), F = a (0.05, 0.003, 1), E - F perpendicular to x and M: x = 0.05 a, a = (1 + 0.0025 a) / 1.002509.
  const double a = 1 / 1.000009;
  CHECK((c.E - Vector3d(0.05 * a, 0, 1)).norm() < 1e-12);
  CHECK((c.F - a * Vector3d(0.05, 0.003, 1)).norm() < 1e-12);
}

TEST_CASE("farther than 2 px is near, farther than 6 px is far") {
  SegmentMatcher matcher = lone_edge();
  REQUIRE(matcher.project(kAhead));
  for (const double side : {-1.0, 1.0}) {
    CHECK(match_px(matcher, 10, side * 1.999) == MatchResult::matched);
    CHECK(match_px(matcher, 10, side * 2.001) == MatchResult::near);
    CHECK(match_px(matcher, 10, side * 5.999) == MatchResult::near);
    CHECK(match_px(matcher, 10, side * 6.001) == MatchResult::far);
  }
  SegmentMatcher wide = lone_edge({.max_distance_px = 10});
  REQUIRE(wide.project(kAhead));
  CHECK(match_px(wide, 10, 9.99) == MatchResult::matched);
  CHECK(match_px(wide, 10, 29.9) == MatchResult::near);
  CHECK(match_px(wide, 10, 30.1) == MatchResult::far);
}

TEST_CASE("the foot must lie on the segment, give or take the margin") {
  for (const double end : {-1.0, 1.0}) {
    SegmentMatcher matcher = lone_edge(), strict = lone_edge({.end_margin_px = 0}),
                   lax = lone_edge({.end_margin_px = 5});
    for (SegmentMatcher* m : {&matcher, &strict, &lax}) REQUIRE(m->project(kAhead));
    CHECK(match_px(matcher, end * 50.49, 0) == MatchResult::matched);
    CHECK(match_px(matcher, end * 50.51, 0) == MatchResult::far);
    CHECK(match_px(strict, end * 49.99, 1) == MatchResult::matched);
    CHECK(match_px(strict, end * 50.01, 1) == MatchResult::far);
    CHECK(match_px(lax, end * 54.9, 1) == MatchResult::matched);
    CHECK(match_px(lax, end * 55.1, 1) == MatchResult::far);
    Correspondence c;  // in the margin the end of the segment stands for it
    REQUIRE(matcher.match({end * 50.4 / kFocal, 1 / kFocal}, c) == MatchResult::matched);
    CHECK((c.E - Vector3d(end * 0.1, 0, 1)).norm() < 1e-12);
    const Vector3d M = c.M.normalized();
    CHECK((c.F - M * M.dot(c.E)).norm() < 1e-12);
  }
}

TEST_CASE("a near tie between two segments is nobody's event") {
  // Two parallel edges 3 px apart.
  const MarkerModel pair{{{-0.1, 0, 0}, {0.1, 0, 0}, {-0.1, 0.006, 0}, {0.1, 0.006, 0}},
                         {{0, 1, {0, 1, 0}}, {2, 3, {0, -1, 0}}}};
  SegmentMatcher matcher(pair, kFocal), undecided(pair, kFocal, {.ambiguity_px = 0});
  REQUIRE(matcher.project(kAhead));
  REQUIRE(undecided.project(kAhead));
  Correspondence c;
  REQUIRE(matcher.match({0, 1.39 / kFocal}, c) == MatchResult::matched);
  CHECK(c.segment == 0);
  REQUIRE(matcher.match({0, 1.61 / kFocal}, c) == MatchResult::matched);
  CHECK(c.segment == 1);
  CHECK(c.distance_px == doctest::Approx(1.39));  // dark lies up, between them
  for (const double y : {1.41, 1.5, 1.59}) {
    CHECK(match_px(matcher, 0, y) == MatchResult::ambiguous);
    CHECK(match_px(undecided, 0, y) == MatchResult::matched);
  }
  // Where the other edge has ended there is no tie.
  const MarkerModel offset{{{-0.1, 0, 0}, {0.1, 0, 0}, {0, 0.006, 0}, {0.1, 0.006, 0}}, pair.segments};
  SegmentMatcher half(offset, kFocal);
  REQUIRE(half.project(kAhead));
  CHECK(match_px(half, 20, 1.5) == MatchResult::ambiguous);
  CHECK(match_px(half, -20, 1.5) == MatchResult::matched);
}

TEST_CASE("a segment without a rival is never ambiguous") {
  SegmentMatcher matcher = lone_edge({.ambiguity_px = 10});
  REQUIRE(matcher.project(kAhead));
  CHECK(match_px(matcher, 10, 1) == MatchResult::matched);
}

TEST_CASE("a marker that is not wholly in front of the camera matches nothing") {
  SegmentMatcher matcher(make_square_marker(0.1), kFocal);
  const Isometry3d good = pose({std::numbers::pi, 0, 0}, {0, 0, 0.5});
  const Vector2d on_edge(0.05 / 0.5, 0);
  Correspondence c;
  CHECK(matcher.match(on_edge, c) == MatchResult::far);  // not projected yet
  REQUIRE(matcher.project(good));
  CHECK(matcher.match(on_edge, c) == MatchResult::matched);
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  Isometry3d tilted = pose({0, 1.5, 0}, {0, 0, 0.03});  // the right half is in front
  for (const Isometry3d& bad :
       {tilted, pose({0, 0, 0}, {0, 0, -0.5}), pose({0, 0, 0}, {0, 0, 0}), pose({0, 0, 0}, {0, 0, nan}),
        pose({0, 0, 0}, {nan, 0, 1}), pose({0, 0, 0}, {0, nan, 1}), pose({0, 0, 0}, {infinity, 0, 1}),
        pose({0, 0, 0}, {0, 0, infinity})}) {
    CAPTURE(bad.translation());
    CHECK_FALSE(matcher.project(bad));
    for (double x = -1; x <= 1; x += 0.01)
      for (double y = -1; y <= 1; y += 0.05) REQUIRE(matcher.match({x, y}, c) == MatchResult::far);
    REQUIRE(matcher.project(good));  // and comes back
    CHECK(matcher.match(on_edge, c) == MatchResult::matched);
  }
}

TEST_CASE("an event without a line of sight matches nothing") {
  SegmentMatcher matcher = lone_edge();
  REQUIRE(matcher.project(kAhead));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Correspondence c;
  for (const Vector2d& m : {Vector2d(nan, nan), Vector2d(0, nan), Vector2d(nan, 0)})
    CHECK(matcher.match(m, c) == MatchResult::far);
}

TEST_CASE("an edge that points at the camera constrains nothing") {
  for (const Vector3d& tip : {Vector3d(0, 0, 0.5), Vector3d(0.1, 0.05, 0.5)}) {
    // Two vertices on one line of sight.
    SegmentMatcher matcher({{tip, 1.4 * tip}, {{0, 1, {0, 0, 0}}}}, kFocal);
    REQUIRE(matcher.project(Isometry3d::Identity()));
    Correspondence c;
    CHECK(matcher.match(tip.head<2>() / tip.z(), c) == MatchResult::near);
    CHECK(matcher.match(tip.head<2>() / tip.z() + Vector2d(1e-4, 1e-4), c) != MatchResult::matched);
    // A little turned, it is an edge again, and every match is finite.
    REQUIRE(matcher.project(pose({0.3, 0.2, 0}, {0, 0, 0.1})));
    const Vector3d middle = pose({0.3, 0.2, 0}, {0, 0, 0.1}) * (1.2 * tip);
    REQUIRE(matcher.match(middle.head<2>() / middle.z(), c) == MatchResult::matched);
    CHECK((c.E - middle).norm() < 1e-9);
    CHECK((c.F - middle).norm() < 1e-9);
  }
}

TEST_CASE("impossible models and settings are refused with field and value") {
  const auto message_of = [](const MarkerModel& model, double focal,
                             const SegmentMatcherSettings& settings) -> std::string {
    try {
      const SegmentMatcher matcher(model, focal, settings);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  const MarkerModel square = make_square_marker(0.1);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(message_of(square, 500, {}) == "accepted");
  CHECK(message_of({}, 500, {}) == "marker model: no segments");
  CHECK(message_of(square, 0, {}) == "segment matcher: focal length is 0");
  CHECK(message_of(square, nan, {}) == "segment matcher: focal length is nan");
  CHECK(message_of(square, 500, {.max_distance_px = 0}) == "segment matcher: max_distance_px is 0");
  CHECK(message_of(square, 500, {.max_distance_px = nan}) == "segment matcher: max_distance_px is nan");
  CHECK(message_of(square, 500, {.end_margin_px = -0.5}) == "segment matcher: end_margin_px is -0.5");
  CHECK(message_of(square, 500, {.end_margin_px = nan}) == "segment matcher: end_margin_px is nan");
  CHECK(message_of(square, 500, {.ambiguity_px = -1}) == "segment matcher: ambiguity_px is -1");
  CHECK(message_of(square, 500, {.ambiguity_px = nan}) == "segment matcher: ambiguity_px is nan");
}
