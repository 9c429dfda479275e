#include "evmarker/tracking/occlusion.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "random_pose.hpp"
#include "simulated.hpp"

using namespace evmarker;
using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

TEST_CASE("a code marker's paper reaches a cell beyond its square, and its depth is known on every line of sight") {
  SeededNumbers random(12);
  constexpr double kLength = 0.06, kFocalLength = 533, kReach_px = 2;
  GridMatcher matcher(make_code_marker(kLength, simulated::code()), kFocalLength);
  int on = 0, beside = 0, far = 0;
  for (int i = 0; i < 200; ++i) {
    const Isometry3d T = random_pose(random, 0.4, 0.8);
    if (!matcher.project(T) || !matcher.on_grid()) continue;
    const Box reach = matcher.reach(kQuietZone);
    for (int k = 0; k < 50; ++k) {
      const Vector3d point(kLength * random(-1.5, 1.5), kLength * random(-1.5, 1.5), 0), seen = T * point;
      if (!(seen.z() > 0)) continue;
      const Vector2d m = seen.head<2>() / seen.z();
      CHECK(inverse_depth(matcher, m) == doctest::Approx(1 / seen.z()));
      const double half_paper = kLength / 2 * 8 / 6, off = point.cwiseAbs().maxCoeff() - half_paper;
      if (off <= 0) {
        CHECK(on_sheet(matcher, m));
        CHECK(reach.contains(m));
        ++(point.cwiseAbs().maxCoeff() > kLength / 2 ? beside : on);
      } else if (off > 3 * kReach_px * seen.z() / kFocalLength / std::cos(0.8)) {
        CHECK_FALSE(on_sheet(matcher, m));
        ++far;
      }
    }
  }
  REQUIRE(std::min({on, beside, far}) > 500);
  GridMatcher outline(make_square_marker(kLength), kFocalLength);
  Isometry3d facing = Isometry3d::Identity();
  facing.linear() = Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX()).toRotationMatrix();
  facing.translation() = Vector3d(0, 0, 0.4);
  REQUIRE(outline.project(facing));
  CHECK(on_sheet(outline, {0.07, 0}));  // an outline's paper is its square, 0.075 to each side
  CHECK_FALSE(on_sheet(outline, {0.09, 0}));
}

TEST_CASE("a marker's paper hides what is farther away, once the marker is tracked") {
  const Trajectory motion = simulated::near_motion(43);
  const auto events = simulated::filtered(simulated::near_events(motion, 0.1, 43));
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  MarkerTracker tracker(simulated::camera, model, motion(0), {.start_search = std::nullopt});
  const MarkerTracker behind(simulated::camera, model, facing_pose({0, 0, 0.9})),
      before(simulated::camera, model, facing_pose({0, 0, 0.3}));
  const auto centre = [&]() -> Eigen::Vector2d { return tracker.T_camera_marker().translation().hnormalized(); };
  REQUIRE(tracker.state() == TrackingState::converging);
  CHECK(sheet_inverse_depth(tracker, centre()) == 0);
  for (const Event& event : events) tracker.push(event);
  REQUIRE(tracker.state() == TrackingState::tracking);
  const double near = sheet_inverse_depth(tracker, centre());
  CHECK(near == doctest::Approx(1 / tracker.T_camera_marker().translation().z()));
  CHECK(sheet_inverse_depth(tracker, {0.5, 0.4}) == 0);
  CHECK(hidden_by(near, behind, centre()));
  CHECK_FALSE(hidden_by(near, before, centre()));
  CHECK_FALSE(hidden_by(near, tracker, centre()));
  CHECK_FALSE(hidden_by(0, behind, centre()));
  tracker.lose(LossReason::hidden);
  CHECK(sheet_inverse_depth(tracker, centre()) == 0);
}
