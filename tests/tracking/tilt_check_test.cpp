#include "evmarker/tracking/tilt_check.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::seconds;

namespace {

// Nods once a second through facing the camera, every half second, and sways.
Trajectory nodding(double distance) {
  return [distance](double t) {
    const double turn = 2 * std::numbers::pi * t;
    return facing_pose({0.05 * std::sin(2 * turn), 0.01, distance}, {0.5 * std::sin(turn), 0, 0});
  };
}

MarkerTracker<> tracker_at(const Eigen::Isometry3d& T, Timestamp t = 0, const MarkerTrackerSettings<>& settings = {}) {
  return {simulated::camera, make_code_marker(simulated::kMarkerLength, simulated::code()), T, settings, 0, t};
}

}  // namespace

TEST_CASE("a tracker that has taken a marker's turn to the wrong side changes over to the right one") {
  const Trajectory motion = nodding(1);  // 53 px wide
  // It faces the camera at 0.5 s; at 0.53 s it is tilted by 5 deg.
  constexpr Timestamp kStart = 530000;
  std::vector<Event> events = simulated::near_events(motion, 0.75, 5);
  std::erase_if(events, [](const Event& event) { return event.t < kStart; });
  for (const bool wrong_side : {false, true}) {
    CAPTURE(wrong_side);
    const Eigen::Isometry3d truth = motion(seconds(kStart));
    MarkerTracker<> tracker = tracker_at(wrong_side ? mirrored(truth) : truth, kStart);
    AccuracyMeter meter;
    int in_doubt = 0;
    double last_deg = 180;
    tracker.push(events, [&](const PoseEstimate& pose) {
      const Eigen::Isometry3d at = motion(seconds(pose.t));
      meter.add(pose, at);
      last_deg = pose_error(pose.T_camera_marker, at).rotation_deg;
      in_doubt += pose.quality.state == TrackingState::converging;
    });
    REQUIRE(meter.tracking() > 500);
    CHECK(in_doubt > 10);
    CHECK(in_doubt < 100);
    CHECK(last_deg < 1);
    CHECK(meter.wild() == 0);
    CHECK(meter.nees().mean < 2.5);
  }
}

TEST_CASE("events beyond the reach have no effect, also while both sides are followed") {
  const Trajectory motion = nodding(1);
  constexpr Timestamp kStart = 530000;
  std::vector<Event> events = simulated::record(
      simulated::camera, {{.length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = motion}},
      SimulatorSettings{.duration_s = 0.65, .seed = 5, .noise_hz_per_px = 5});
  std::erase_if(events, [](const Event& event) { return event.t < kStart; });
  const UndistortionTable lines(simulated::camera);
  MarkerTracker<> all = tracker_at(mirrored(motion(seconds(kStart))), kStart, {.start_search = std::nullopt});
  MarkerTracker<> reached = all;
  Box reach = reached.reach();
  double widest = reach.size();
  int poses = 0, differing = 0;
  for (const Event& event : events) {
    const PoseEstimate* const pose = all.push(event);
    const bool reaches = reach.contains(lines(event));
    const PoseEstimate* const same = reaches ? reached.push(event) : nullptr;
    differing += (pose == nullptr) != (same == nullptr);
    if (pose == nullptr || same == nullptr) continue;
    ++poses;
    differing += pose->T_camera_marker.matrix() != same->T_camera_marker.matrix();
    reach = reached.reach();
    widest = std::max(widest, reach.size());
  }
  REQUIRE(poses > 300);
  CHECK(differing == 0);
  CHECK(widest < 0.15);  // of 1, the distance; the marker is 0.1
}

TEST_CASE("a marker whose perspective shows its side is not in doubt") {
  const Trajectory motion = nodding(0.4);
  MarkerTracker<> tracker = tracker_at(motion(0));
  AccuracyMeter meter;
  int in_doubt = 0;
  tracker.push(simulated::near_events(motion, 1, 6), [&](const PoseEstimate& pose) {
    meter.add(pose, motion(seconds(pose.t)));
    in_doubt += meter.tracking() > 0 && pose.quality.state == TrackingState::converging;
  });
  REQUIRE(meter.tracking() > 1000);
  CHECK(in_doubt == 0);
  CHECK(meter.rotation_deg().mean < 0.5);
}

TEST_CASE("the covariance has both poses while either may be right") {
  KalmanUpdate rule({}, 10);
  const Matrix6d before = rule.covariance();
  const Vec6 to_other{{0, 0, 0.01}, {0.3, -0.1, 0}};
  rule.set_other_pose(std::sqrt(0.25) * to_other);
  const Vector6d deviation = to_other;
  CHECK(rule.covariance().isApprox(before + 0.25 * deviation * deviation.transpose(), 1e-12));
  rule.set_other_pose({});
  CHECK(rule.covariance() == before);
}

TEST_CASE("wireframes with depth and rules without a motion model are left alone") {
  const auto never_compares = [](auto follower, const Trajectory& motion) {
    TiltCheck check(follower);
    for (int i = 0; i < 1000; ++i) {
      follower.start_from(motion(i * 1e-3));
      CHECK_FALSE(check.judge(follower));
      CHECK_FALSE(check.comparing());
    }
  };
  MarkerModel roof = make_square_marker(0.1);
  roof.vertices[0].z() += 0.02;
  never_compares(EdgeFollower<KalmanUpdate>(roof, 500, nodding(1)(0), {}), nodding(1));
  never_compares(EdgeFollower<DecoupledUpdate>(make_square_marker(0.1), 500, nodding(1)(0), {}), nodding(1));
}
