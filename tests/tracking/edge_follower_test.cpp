#include "evmarker/tracking/edge_follower.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "evmarker/model/board.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"

using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using evmarker::Board;
using evmarker::CodeBits;
using evmarker::Correspondence;
using evmarker::DecoupledUpdate;
using evmarker::EdgeFollower;
using evmarker::EventGroup;
using evmarker::KalmanUpdate;
using evmarker::make_board_model;
using evmarker::MarkerModel;
using evmarker::MatchResult;
using evmarker::Matrix6d;
using evmarker::Timestamp;
using evmarker::Vector6d;

namespace {

constexpr double kFocal = 500;

// A rule that counts what it is asked and does as it is told.
struct CountingRule {
  struct Settings {
    bool skip = false;
    double step_z = 0;
    double smear_px = 0;
    double blur = 1;
  };
  CountingRule(const Settings& given, int events) : settings(given), events_per_update(events) {}
  void add(const Correspondence& c, const Isometry3d& T_camera_marker) noexcept {
    ++added;
    added_at = T_camera_marker.translation();
    last_distance = c.distance_px;
    last_polarity = c.polarity;
  }
  bool update(Isometry3d& T_camera_marker, Timestamp t) noexcept {
    ++updates;
    updated_at = t;
    if (settings.skip) return false;
    T_camera_marker.translation().z() += settings.step_z;
    return true;
  }
  void set_events_per_update(int events) noexcept { events_per_update = events; }
  void extrapolate(Eigen::Isometry3d&, Timestamp) noexcept {}
  void reverse() noexcept { ++reversals; }
  Matrix6d covariance() const noexcept { return Matrix6d::Zero(); }
  Vector6d twist() const noexcept { return Vector6d::Zero(); }

  Settings settings;
  int events_per_update, added = 0, updates = 0, reversals = 0;
  Timestamp updated_at = 0;
  Vector3d added_at{0, 0, 0};
  double last_distance = 0, last_polarity = 0;
};

using CountingFollower = EdgeFollower<CountingRule>;
using Follower = EdgeFollower<DecoupledUpdate>;

// From (-50, 0) to (50, 0) px at 1 m, dark below.
MarkerModel lone_edge() { return {{{-0.1, 0, 0}, {0.1, 0, 0}}, {{0, 1, {0, 1, 0}}}}; }

Isometry3d turned_pose(const Vector3d& r, const Vector3d& translation) {
  Isometry3d T = Isometry3d::Identity();
  if (r.norm() > 0) T.linear() = Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix();
  T.translation() = translation;
  return T;
}
const Isometry3d kAhead = turned_pose({0, 0, 0}, {0, 0, 1});

Vector2d px(double x, double y) { return Vector2d(x, y) / kFocal; }

// A square of 10 cm that faces the camera, drifts and turns; its events lie exactly on its edges.
constexpr double kHalf = 0.05;
Vector3d corner(int i) { return {i % 4 == 1 || i % 4 == 2 ? kHalf : -kHalf, i % 4 < 2 ? kHalf : -kHalf, 0}; }
Isometry3d truth_at(double seconds) {
  const double w = 2 * std::numbers::pi * 0.5 * seconds;
  Isometry3d T =
      turned_pose({std::numbers::pi, 0, 0}, {0.03 * std::sin(w), 0.02 * (1 - std::cos(w)), 0.5 + 0.02 * std::sin(w)});
  T.linear() = Eigen::AngleAxisd(0.3 * std::sin(w), Vector3d(0.3, 0.5, 0.8).normalized()) * T.linear();
  return T;
}

struct SeenEvent {
  Vector2d m;
  Timestamp t;
};
std::vector<SeenEvent> square_events(int count, Timestamp duration_us) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> place(0, 1);
  std::vector<SeenEvent> events;
  for (int i = 0; i < count; ++i) {
    const Timestamp t = duration_us * i / count;
    const int edge = static_cast<int>(random() % 4);
    const double s = place(random);
    const Vector3d point = truth_at(1e-6 * static_cast<double>(t)) * ((1 - s) * corner(edge) + s * corner(edge + 1));
    events.push_back({point.head<2>() / point.z(), t});
  }
  return events;
}

double corner_error_px(const Isometry3d& estimate, const Isometry3d& truth) {
  double worst = 0;
  for (int i = 0; i < 4; ++i) {
    const Vector3d a = estimate * corner(i), b = truth * corner(i);
    worst = std::max(worst, kFocal * (a.head<2>() / a.z() - b.head<2>() / b.z()).norm());
  }
  return worst;
}

}  // namespace

// Without edges to choose anew, the choices in hand never ended, and no event was taken.
TEST_CASE("a group is taken to its end when a board is carried behind the camera") {
  const CodeBits bits = (CodeBits(2, 2) << 1, 0, 0, 1).finished();
  Board board{100, {{.id = 1, .length = 0.1, .bits = bits}, {.id = 2, .length = 0.1, .bits = bits}}};
  board.markers[1].T_board_marker.translation().x() = 0.15;
  const Isometry3d facing = turned_pose({std::numbers::pi, 0, 0}, {0, 0, 0.5});
  const MarkerModel model = make_board_model(board);
  for (const double step_z : {-1.0, -0.5}) {
    CAPTURE(step_z);
    CountingFollower follower(model, kFocal, facing, {.events_per_update = 32, .update = {.step_z = step_z}});
    REQUIRE(follower.accepts_groups());
    EventGroup group;
    group.fill(EventGroup::kMost, [](std::size_t i) {  // as many as an update needs on the first marker's left edge
      const Vector2d m = i < 32 ? px(-50, static_cast<double>(i)) : px(200, 200);
      return std::tuple(m, static_cast<Timestamp>(i), 1.0);
    });
    for (int again = 0; again < 4; ++again)
      for (std::size_t taken = 0; taken < group.count();) {
        const std::size_t before = taken;
        taken = follower.push(group, taken, [](auto...) { return true; });
        REQUIRE(taken > before);
      }
    CHECK(follower.rule().updates > 0);
    CHECK(!follower.in_front());
  }
}

TEST_CASE("every n matched events make one update") {
  for (const int n : {1, 2, 7, 100}) {
    CAPTURE(n);
    CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = n});
    CHECK(follower.rule().events_per_update == n);
    int matched = 0;
    for (int i = 0; i < 1000; ++i) {
      const bool on_edge = i % 3 != 2;
      const auto result = follower.push(on_edge ? px(i % 40, 1) : px(0, 4), 10 * i);
      matched += on_edge;
      REQUIRE(result.match == (on_edge ? MatchResult::matched : MatchResult::near));
      REQUIRE(result.updated == (on_edge && matched % n == 0));
      REQUIRE(follower.rule().added == matched);
      REQUIRE(follower.rule().updates == matched / n);
      if (result.updated) REQUIRE(follower.rule().updated_at == 10 * i);
    }
    CHECK(matched == 667);
  }
}

TEST_CASE("statistics, worked by hand") {
  CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = 3});
  CHECK(follower.last_update().matched == 0);
  CHECK(follower.push(px(0, 1), 1).match == MatchResult::matched);
  CHECK(follower.push(px(0, 5), 2).match == MatchResult::near);  // offered, not matched
  CHECK(follower.push(px(0, 50), 3).match == MatchResult::far);  // neither
  CHECK(follower.push(px(0, -2), 4).match == MatchResult::matched);
  CHECK(follower.push(px(0, -3), 5).match == MatchResult::near);
  CHECK(follower.rule().last_distance == doctest::Approx(-2));
  CHECK(follower.last_update().matched == 0);  // not before the update
  CHECK(follower.push(px(0, 0.5), 6).updated);
  CHECK(follower.last_update().matched == 3);
  CHECK(follower.last_update().offered == 5);
  CHECK(follower.last_update().residual_px == doctest::Approx(std::sqrt((1 + 4 + 0.25) / 3)));
  for (int i = 0; i < 3; ++i) follower.push(px(10, -1), 7 + i);
  CHECK(follower.last_update().matched == 3);  // each update begins anew
  CHECK(follower.last_update().offered == 3);
  CHECK(follower.last_update().residual_px == doctest::Approx(1));
}

TEST_CASE("ambiguous events are offered, not matched") {
  const MarkerModel pair{{{-0.1, 0, 0}, {0.1, 0, 0}, {-0.1, 0.006, 0}, {0.1, 0.006, 0}},
                         {{0, 1, {0, 1, 0}}, {2, 3, {0, -1, 0}}}};
  CountingFollower follower(pair, kFocal, kAhead, {.events_per_update = 1});
  CHECK(follower.push(px(0, 1.5), 0).match == MatchResult::ambiguous);
  CHECK(follower.rule().added == 0);
  CHECK(follower.push(px(0, 0), 1).updated);
  CHECK(follower.last_update().offered == 2);
  CHECK(follower.last_update().matched == 1);
}

TEST_CASE("after an update events are matched at the new pose") {
  CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = 1, .update = {.step_z = 1}});
  CHECK(follower.push(px(40, 0), 0).match == MatchResult::matched);
  CHECK(follower.T_camera_marker().translation().z() == 2);
  CHECK(follower.push(px(40, 0), 1).match == MatchResult::far);  // at 2 m the edge ends at 25 px
  CHECK(follower.push(px(20, 0), 2).match == MatchResult::matched);
  CHECK(follower.rule().added_at.z() == 2);
}

TEST_CASE("a skipped update is counted and changes nothing") {
  CountingFollower follower(lone_edge(), kFocal, kAhead,
                            {.events_per_update = 2, .update = {.skip = true, .step_z = 1}});
  for (int i = 0; i < 10; ++i) CHECK_FALSE(follower.push(px(0, 0), i).updated);
  CHECK(follower.rule().updates == 5);
  CHECK(follower.skipped_updates() == 5);
  CHECK(follower.T_camera_marker().matrix() == kAhead.matrix());
  CHECK(follower.in_front());
}

TEST_CASE("a marker moved behind the camera matches nothing any more") {
  CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = 1, .update = {.step_z = -2}});
  CHECK(follower.in_front());
  CHECK(follower.push(px(0, 0), 0).updated);
  CHECK_FALSE(follower.in_front());
  for (int i = 0; i < 10; ++i) CHECK(follower.push(px(0, 0), i).match == MatchResult::far);
  CHECK(follower.rule().updates == 1);
}

TEST_CASE("reversing starts a new collection and tells the rule") {
  CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = 3});
  follower.push(px(0, 2), 0);
  follower.push(px(0, 2), 1);
  follower.reverse();
  CHECK(follower.rule().reversals == 1);
  CHECK_FALSE(follower.push(px(0, 1), 2).updated);
  CHECK_FALSE(follower.push(px(0, 1), 3).updated);
  CHECK(follower.push(px(0, 1), 4).updated);
  CHECK(follower.last_update().offered == 3);
  CHECK(follower.last_update().residual_px == doctest::Approx(1));
}

TEST_CASE("an event without a line of sight is far") {
  CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = 1});
  CHECK(follower.push(Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()), 0).match == MatchResult::far);
  CHECK(follower.rule().added == 0);
}

TEST_CASE("a slowly moving square is followed to a fraction of a pixel") {
  const auto events = square_events(400000, 2'000'000);  // one whole period
  for (const int n : {1, 5, 20, 100}) {
    CAPTURE(n);
    Follower follower(evmarker::make_square_marker(2 * kHalf), kFocal, truth_at(0), {.events_per_update = n});
    double worst_px = 0, worst_m = 0, farthest_px = 0;
    int updates = 0, matched = 0;
    for (const SeenEvent& event : events) {
      const auto result = follower.push(event.m, event.t);
      matched += result.match == MatchResult::matched;
      if (!result.updated) continue;
      ++updates;
      const Isometry3d truth = truth_at(1e-6 * static_cast<double>(event.t));
      worst_px = std::max(worst_px, corner_error_px(follower.T_camera_marker(), truth));
      worst_m = std::max(worst_m, (follower.T_camera_marker().translation() - truth.translation()).norm());
      farthest_px = std::max(farthest_px, corner_error_px(truth, truth_at(0)));
      REQUIRE(follower.last_update().matched == n);
      REQUIRE(follower.last_update().residual_px < 1);
    }
    MESSAGE("n = " << n << ": " << worst_px << " px, " << 1e3 * worst_m << " mm at worst");
    CHECK(farthest_px > 40);                                     // so there was something to follow
    CHECK(matched > 0.95 * static_cast<double>(events.size()));  // the corners are ambiguous
    CHECK(updates == matched / n);
    CHECK(worst_px < 0.5);
    CHECK(worst_m < 3e-3);
    CHECK(follower.skipped_updates() == 0);
  }
}

TEST_CASE("a displaced start is captured") {
  const auto events = square_events(100000, 500'000);
  Isometry3d start = truth_at(0);
  start.translation() += Vector3d(0.001, -0.0012, 0.003);
  REQUIRE(corner_error_px(start, truth_at(0)) > 1.2);
  Follower follower(evmarker::make_square_marker(2 * kHalf), kFocal, start, {.events_per_update = 20});
  for (const SeenEvent& event : events) follower.push(event.m, event.t);
  CHECK(corner_error_px(follower.T_camera_marker(), truth_at(0.5)) < 0.5);
}

TEST_CASE("the same events give the same poses, and copies go their own ways") {
  const auto events = square_events(20000, 100'000);
  Follower first(evmarker::make_square_marker(2 * kHalf), kFocal, truth_at(0), {.events_per_update = 7});
  Follower second = first;
  for (const SeenEvent& event : events) {
    const auto a = first.push(event.m, event.t), b = second.push(event.m, event.t);
    REQUIRE(a.updated == b.updated);
  }
  CHECK(first.T_camera_marker().matrix() == second.T_camera_marker().matrix());  // bit for bit
  CHECK(first.T_camera_marker().matrix() != truth_at(0).matrix());
  const Isometry3d kept = first.T_camera_marker();
  Follower branch = first;
  branch.reverse();
  for (std::size_t i = events.size(); i-- > 0;) branch.push(events[i].m, 200'000 - events[i].t);
  CHECK(first.T_camera_marker().matrix() == kept.matrix());
  CHECK(branch.T_camera_marker().matrix() != kept.matrix());
  CHECK(corner_error_px(branch.T_camera_marker(), truth_at(0)) < 0.5);  // back where it came from
  for (const SeenEvent& event : square_events(30000, 150'000))
    if (event.t >= 100'000) {
      first.push(event.m, event.t);
      second.push(event.m, event.t);
    }
  CHECK(first.T_camera_marker().matrix() == second.T_camera_marker().matrix());
}

TEST_CASE("a rule that takes any number of events still gets one at least") {
  CHECK_THROWS_WITH_AS(CountingFollower(lone_edge(), kFocal, kAhead, {.events_per_update = -1}),
                       "edge follower: events_per_update is -1", std::invalid_argument);
}

TEST_CASE("automatic: as many events as the edges make while they move by a tenth of a pixel") {
  // The lone edge is 0.2 m long: 100 px at 1 m. A rule that does not know how many events that makes: one per px^2.
  for (const auto& expected : {std::pair{20.0, 1},
                               {10.0, 1},
                               {4.0, 2},
                               {2.0, 5},
                               {1.0, 10},
                               {0.5, 20},
                               {0.125, 80},
                               {0.1, 100},
                               {0.05, 100}}) {
    CAPTURE(expected.first);
    const auto [distance_m, events] = expected;
    CountingFollower follower(lone_edge(), kFocal, turned_pose({0, 0, 0}, {0, 0, distance_m}), {});
    CHECK(follower.events_per_update() == events);
    CHECK(follower.rule().events_per_update == events);
    CHECK(follower.until_update() == static_cast<std::size_t>(events));
    int updates = 0;
    for (int i = 0; i < 3 * events; ++i) updates += follower.push(px(0, 0), i).updated;
    CHECK(updates == 3);
    CHECK(follower.last_update().matched == events);
  }
  CountingFollower follower(lone_edge(), kFocal, kAhead, {});
  follower.start_from(turned_pose({0, 0, 0}, {0, 0, 1.05}));
  CHECK(follower.events_per_update() == 10);  // not for every small change
  follower.start_from(turned_pose({0, 0, 0}, {0, 0, 0.5}));
  CHECK(follower.events_per_update() == 20);
  CHECK(follower.rule().events_per_update == 20);
  follower.set_events_per_passage(3);  // of no use to this rule
  CHECK(follower.events_per_update() == 20);
}

TEST_CASE("automatic: more where a pixel makes more events, and a number stays that number") {
  const auto square = [](double distance_m, int n) {  // its edges are 200 px long at 1 m
    return EdgeFollower<KalmanUpdate>(evmarker::make_square_marker(0.1), kFocal,
                                      turned_pose({std::numbers::pi, 0, 0}, {0, 0, distance_m}),
                                      {.events_per_update = n});
  };
  for (const auto& expected :
       {std::tuple{1.0, 3.0, 60}, {1.0, 30.0, 100}, {1.0, 0.2, 20}, {4.0, 1.6, 8}, {100.0, 2.0, 1}}) {
    CAPTURE(std::get<0>(expected));
    CAPTURE(std::get<1>(expected));
    const auto [distance_m, per_px2, events] = expected;
    EdgeFollower<KalmanUpdate> follower = square(distance_m, evmarker::kAutomatic), fixed = square(distance_m, 7);
    follower.set_events_per_passage(per_px2);
    fixed.set_events_per_passage(per_px2);
    CHECK(follower.events_per_update() == events);
    CHECK(fixed.events_per_update() == 7);
    fixed.start_from(turned_pose({std::numbers::pi, 0, 0}, {0, 0, 0.3}));
    CHECK(fixed.events_per_update() == 7);
    CHECK(fixed.rule().trail_px() > 0);  // it was told
  }
}

TEST_CASE("the matching distance follows blur and smear, not across a cell, and no other wireframe's") {
  struct Slow : CountingRule {  // tells how far its pixels smear edges
    using CountingRule::CountingRule;
    double smear_px() const noexcept { return settings.smear_px; }
    double blur() const noexcept { return settings.blur; }
    void set_max_distance_px(double distance_px) noexcept { told_px = distance_px; }
    double told_px = 0;
  };
  const CodeBits bits = CodeBits::Identity(4, 4);
  const Isometry3d near = turned_pose({std::numbers::pi, 0, 0}, {0, 0, 0.5});  // cells of 16.7 px
  const auto distance_px = [&](const MarkerModel& model, const Isometry3d& T, double smear_px, double blur = 1) {
    EdgeFollower<Slow> follower(model, kFocal, T,
                                {.events_per_update = 1, .update = {.smear_px = smear_px, .blur = blur}});
    CHECK(follower.rule().told_px == follower.matcher().max_distance_px());
    return follower.matcher().max_distance_px();
  };
  const MarkerModel marker = evmarker::make_code_marker(0.1, bits);
  CHECK(distance_px(marker, near, 0) == doctest::Approx(2).scale(0));
  CHECK(distance_px(marker, near, 1) == doctest::Approx(std::hypot(2, 3)).scale(0));
  CHECK(distance_px(marker, near, 0, 1.5) == doctest::Approx(3).scale(0));
  CHECK(distance_px(marker, near, 1, 1.5) == doctest::Approx(std::hypot(3, 3)).scale(0));
  const double widest = distance_px(marker, near, 100);
  CHECK(widest > 0.25 * 16.7);
  CHECK(widest <= 0.3 * 16.7);
  CHECK(distance_px(marker, turned_pose({std::numbers::pi, 0, 0}, {0, 0, 1.5}), 100) == doctest::Approx(2).scale(0));
  CHECK(distance_px(lone_edge(), kAhead, 100) == doctest::Approx(2).scale(0));
  const Board board{1, {{1, 0.1, bits, Isometry3d::Identity()}}};
  CHECK(distance_px(make_board_model(board), near, 1) == doctest::Approx(std::hypot(2, 3)).scale(0));
}

TEST_CASE("the rule is told the polarity of each event") {
  CountingFollower follower(lone_edge(), kFocal, kAhead, {.events_per_update = 1});
  for (const double polarity : {1.0, -1.0, 0.0}) {
    follower.push(px(0, 1), 1, polarity);
    CHECK(follower.rule().last_polarity == polarity);
  }
  follower.push(px(0, 1), 1, 1);
  follower.push(px(0, 1), 1);
  CHECK(follower.rule().last_polarity == 0);
}

TEST_CASE("impossible settings and poses are refused with field and value") {
  const auto message_of = [](const Isometry3d& T, const Follower::Settings& settings) -> std::string {
    try {
      const Follower follower(evmarker::make_square_marker(0.1), kFocal, T, settings);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  const Isometry3d facing = turned_pose({std::numbers::pi, 0, 0}, {0, 0, 1});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(message_of(facing, {}) == "accepted");
  CHECK(message_of(facing, {.events_per_update = -1}) == "decoupled update: events_per_update is -1");
  CHECK(message_of(facing, {.events_per_update = -100}) == "decoupled update: events_per_update is -100");
  CHECK(message_of(facing, {.matching = {.max_distance_px = -2}}) == "segment matcher: max_distance_px is -2");
  CHECK(message_of(facing, {.update = {.rotation_gain = -1}}) == "decoupled update: rotation_gain is -1");
  CHECK(message_of(kAhead, {}) == "T_camera_marker does not put the marker in front of the camera");  // from behind
  for (const Vector3d& t : {Vector3d(0, 0, -1), Vector3d(0, 0, 0)})
    CHECK(message_of(turned_pose({std::numbers::pi, 0, 0}, t), {}) ==
          "T_camera_marker does not put the marker in front of the camera");
  for (const Vector3d& t : {Vector3d(nan, 0, 1), Vector3d(0, 0, nan)})
    CHECK(message_of(turned_pose({std::numbers::pi, 0, 0}, t), {}) == "T_camera_marker is no rotation and translation");
}

namespace {

constexpr double kOn = 1, kOff = -1;

// Moves on straight at 400 px/s while it turns, and turns back on the spot every 50 ms.
Isometry3d zigzag(double seconds) {
  const double cycle = seconds / 0.1 - std::floor(seconds / 0.1);
  const double way = 0.05 * (cycle < 0.5 ? 2 * cycle : 2 - 2 * cycle);  // [s]
  Isometry3d T = turned_pose({std::numbers::pi, 0, 0}, Vector3d(-0.01, -0.01, 0.5) + way * Vector3d(0.35, 0.2, 0.3));
  T.linear() = Eigen::AngleAxisd(1.5 * way, Vector3d(0.4, 0.2, 0.9).normalized()) * T.linear();
  return T;
}

struct PolarSight {
  Vector2d m;
  Timestamp t;
  double polarity;
};
// Exact events of the dark square: where an edge moves toward the square's inside, the light outside grows.
std::vector<PolarSight> zigzag_events(Timestamp duration_us) {
  std::mt19937 random(12);
  std::uniform_real_distribution<double> place(0, 1);
  const auto image = [](const Vector3d& p) -> Vector2d { return p.head<2>() / p.z(); };
  std::vector<PolarSight> events;
  for (Timestamp t = 5; t < duration_us; t += 5) {
    const double seconds = 1e-6 * static_cast<double>(t), before = seconds - 1e-6;
    const int edge = static_cast<int>(random() % 4);
    const double s = place(random);
    const Vector3d point = (1 - s) * corner(edge) + s * corner(edge + 1);
    const Vector2d m = image(zigzag(seconds) * point);
    const Vector2d along = image(zigzag(seconds) * corner(edge + 1)) - image(zigzag(seconds) * corner(edge));
    Vector2d inside(-along.y(), along.x());
    if (inside.dot(image(zigzag(seconds) * Vector3d(0, 0, 0)) - m) < 0) inside = -inside;
    events.push_back({m, t, inside.dot(m - image(zigzag(before) * point)) > 0 ? kOn : kOff});
  }
  return events;
}

}  // namespace

TEST_CASE("a marker that turns back on the spot is followed, there and back in time, whatever is told of polarity") {
  const auto events = zigzag_events(400'000);
  const auto follow = [&](EdgeFollower<KalmanUpdate>& follower, bool polarity_is_told) {
    double worst_px = 0;
    int updates = 0;
    for (const PolarSight& event : events) {
      if (!follower.push(event.m, event.t, polarity_is_told ? event.polarity : 0).updated) continue;
      const Isometry3d truth = zigzag(1e-6 * static_cast<double>(event.t));
      worst_px = std::max(worst_px, corner_error_px(follower.T_camera_marker(), truth));
      ++updates;
    }
    REQUIRE(updates > 200);
    return worst_px;
  };
  REQUIRE(corner_error_px(zigzag(0), zigzag(0.05)) > 15);
  for (const int n : {1, 10, 100})
    for (const bool polarity_is_told : {true, false}) {
      CAPTURE(n);
      CAPTURE(polarity_is_told);
      EdgeFollower<KalmanUpdate> follower(
          evmarker::make_square_marker(2 * kHalf), kFocal, zigzag(0),
          {.events_per_update = n,
           .update = {.offset_drift_px = 1e-3, .initial_sigma_offset_px = 1e-3, .initial_sigma_trail_px = 1e-3}});
      const double worst_px = follow(follower, polarity_is_told);
      follower.reverse();
      for (auto event = events.rbegin(); event != events.rend(); ++event)
        follower.push(event->m, 800'000 - event->t, polarity_is_told ? event->polarity : 0);
      const double back_px = corner_error_px(follower.T_camera_marker(), zigzag(0));
      MESSAGE("n = " << n << ": worst " << worst_px << " px; back at the start " << back_px << " px");
      CHECK(worst_px < 0.75);  // it turns with an infinite acceleration
      CHECK(back_px < 0.15);
    }
}

TEST_CASE_TEMPLATE("events in groups of any size lead to the poses that they lead to one by one, bit for bit", Rule,
                   DecoupledUpdate, KalmanUpdate) {
  const auto events = zigzag_events(100'000);
  for (const int n : {1, 2, 4, 5, 10, 100}) {
    CAPTURE(n);
    const EdgeFollower<Rule> start(evmarker::make_square_marker(2 * kHalf), kFocal, zigzag(0),
                                   {.events_per_update = n});
    REQUIRE(start.accepts_groups());
    const auto of_known_polarity = [](std::size_t event) { return event % 5 != 0; };
    EdgeFollower<Rule> one_by_one = start, grouped = start;
    std::mt19937 random(static_cast<unsigned>(n));
    std::size_t next = 0;
    int updates = 0, groups = 0;
    while (next < events.size()) {
      EventGroup group;
      const auto most = std::min({EventGroup::kMost, events.size() - next, std::size_t{1} + random() % 100});
      group.fill(most, [&](std::size_t i) {
        const PolarSight& event = events[next + i];
        return std::tuple(event.m, event.t, of_known_polarity(next + i) ? event.polarity : 0.0);
      });
      std::size_t first = 0;
      do {
        std::size_t told = first;
        first = grouped.push(group, first, [&](std::size_t i, const auto& result) {
          REQUIRE(i == told++);
          const PolarSight& event = events[next + i];
          const auto expected = one_by_one.push(event.m, event.t, of_known_polarity(next + i) ? event.polarity : 0.0);
          REQUIRE(result.match == expected.match);
          REQUIRE(result.updated == expected.updated);
          REQUIRE(result.segment == expected.segment);
          if (result.updated) REQUIRE(grouped.T_camera_marker().matrix() == one_by_one.T_camera_marker().matrix());
          updates += result.updated;
          return i != 17;  // enough for now
        });
        REQUIRE(told == first);
        ++groups;
      } while (first < most && random() % 8 != 0);
      next += first;
    }
    CHECK(updates > 0.5 * static_cast<double>(events.size()) / n);
    CHECK(groups < static_cast<int>(events.size()) / 3);
  }
}

TEST_CASE("at rest in noise, a rule that knows no motion stays where it is") {
  constexpr double kNoise_hz_px = 5;
  const MarkerModel square = evmarker::make_square_marker(0.1);
  const Isometry3d here = turned_pose({std::numbers::pi, 0, 0}, {0, 0, 0.6});
  const auto drift_m = [&](int n, bool rest) {
    EdgeFollower<DecoupledUpdate> follower(square, kFocal, here,
                                           {.events_per_update = n, .update = {.hold_at_rest = rest}});
    follower.enable_rest_detection();
    std::mt19937 random(3);
    std::uniform_real_distribution<double> anywhere(-0.2, 0.2);
    const double period_us = 1e6 / (kNoise_hz_px * 0.4 * 0.4 * kFocal * kFocal);
    double worst = 0;
    for (double t_us = 0; t_us < 3e6; t_us += period_us) {
      const double x = anywhere(random), y = anywhere(random);
      follower.push({x, y}, static_cast<Timestamp>(t_us), random() % 2 == 0 ? 1 : -1);
      worst = std::max(worst, (follower.T_camera_marker().translation() - here.translation()).norm());
    }
    return worst;
  };
  for (const int n : {1, 10, 100}) {
    CAPTURE(n);
    REQUIRE(drift_m(n, false) > 0.05);
    CHECK(drift_m(n, true) < 0.02);
  }
}
