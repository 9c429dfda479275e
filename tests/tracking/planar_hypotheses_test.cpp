#include "evmarker/tracking/planar_hypotheses.hpp"

#include <doctest/doctest.h>

#include "evmarker/evaluation/accuracy.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::seconds;

namespace {

// The pose that looks the same from infinitely far away: depths turned over.
Eigen::Isometry3d turned_over(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d sight = T.translation().normalized();
  Eigen::Isometry3d other = T;
  other.linear() = (Eigen::Matrix3d::Identity() - 2 * sight * sight.transpose()) * T.linear() *
                   Eigen::Vector3d(1, 1, -1).asDiagonal();
  return other;
}

MarkerDetection detection(const Eigen::Isometry3d& T, const Eigen::Isometry3d& other, bool right_one_first) {
  MarkerDetection found{.id = 3, .t = 0, .T_camera_marker = right_one_first ? T : other};
  found.T_camera_marker_alternative = right_one_first ? other : T;
  return found;
}

}  // namespace

TEST_CASE("of both poses the right one goes on, whichever was first") {
  const Trajectory motion = simulated::near_motion(81);
  const auto events = simulated::filtered(simulated::near_events(motion, 0.2, 81));
  const UndistortionTable lines(simulated::camera);
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  Eigen::Isometry3d tilted = motion(0);
  tilted.linear() = Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitX()).toRotationMatrix() * tilted.linear();
  for (const bool right_one_first : {true, false}) {
    CAPTURE(right_one_first);
    PlanarHypotheses<KalmanUpdate> marker(lines, model, detection(motion(0), tilted, right_one_first),
                                          {.start_search = std::nullopt});
    AccuracyMeter meter;
    Timestamp last = 0;
    int back = 0, empty = 0;
    marker.push(events, [&](const PoseEstimate& pose, const Event&) {
      back += pose.t < last;
      empty += pose.id != 3 || pose.T_camera_marker.translation().z() < 0.1;
      last = pose.t;
      meter.add(pose, motion(seconds(pose.t)));
    });
    REQUIRE(meter.tracking() > 100);
    CHECK(meter.rotation_deg().max < 20);
    CHECK(meter.rotation_deg().mean < 1);
    CHECK(back == 0);
    CHECK(empty == 0);
  }
}

TEST_CASE("far away, where both look alike, none is called tracking before the events say which one it is") {
  const UndistortionTable lines(simulated::camera);
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  for (const std::uint64_t seed : {82u, 83u, 84u, 85u}) {
    const Trajectory motion = trajectory::handheld(
        {.T_centre = facing_pose({0, 0, 1.5}), .amplitude_m = {0.25, 0.18, 0.25}, .frequency_hz = 1.3, .seed = seed});
    const auto events = simulated::near_events(motion, 0.3, seed);
    for (const bool right_one_first : {true, false}) {
      CAPTURE(seed);
      CAPTURE(right_one_first);
      PlanarHypotheses<KalmanUpdate> marker(lines, model, detection(motion(0), turned_over(motion(0)), right_one_first),
                                            {.start_search = std::nullopt});
      AccuracyMeter meter;
      Timestamp first = 0;
      marker.push(events, [&](const PoseEstimate& pose, const Event&) {
        if (pose.quality.state == TrackingState::tracking && first == 0) first = pose.t;
        meter.add(pose, motion(seconds(pose.t)));
      });
      REQUIRE(meter.tracking() > 1000);
      CHECK(first < 30000);
      CHECK(meter.rotation_deg().max < 8);
    }
  }
}

TEST_CASE("events may be missing for as long as either pose survives that") {
  const UndistortionTable lines(simulated::camera);
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  const Trajectory motion = simulated::near_motion(83);
  Eigen::Isometry3d tilted = motion(0);
  tilted.linear() = Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitX()).toRotationMatrix() * tilted.linear();
  const MarkerTrackerSettings<KalmanUpdate> settings{.start_search = std::nullopt};
  const auto events = simulated::near_events(motion, 0.002, 83);
  int one_survives = 0, none_survives = 0;
  for (const bool right_one_first : {true, false})
    for (int missing_us = 1100; missing_us < 100000; missing_us += missing_us / 16) {
      CAPTURE(missing_us);
      const auto survives = [&](const Eigen::Isometry3d& start) {
        MarkerTracker<KalmanUpdate> alone(lines, model, start, settings);
        alone.set_ambiguous(true);
        alone.push_checked(events, [](const PoseEstimate&, const Event&) {});
        return alone.skip(std::chrono::microseconds(missing_us)) == nullptr;
      };
      const bool right = survives(motion(0)), other = survives(tilted);
      PlanarHypotheses<KalmanUpdate> marker(lines, model, detection(motion(0), tilted, right_one_first), settings);
      marker.push(events, [](const PoseEstimate&, const Event&) {});
      const PoseEstimate* const last = marker.skip(std::chrono::microseconds(missing_us));
      CHECK((last == nullptr) == (right || other));
      if (last) CHECK(last->quality.state == TrackingState::lost);
      one_survives += right != other;
      none_survives += !right && !other;
    }
  CHECK(one_survives > 0);
  CHECK(none_survives > 0);
}

TEST_CASE("between two poses that lag behind a fast marker nothing is decided: not at the mirrored one") {
  // Two of eight seeds in 120 that used to end at the mirrored pose; four still do.
  const PinholeCamera camera({1280, 720}, 1300, 1300, 639.5, 359.5);
  const UndistortionTable lines(camera);
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  for (const std::uint64_t seed : {31u, 43u}) {
    Eigen::Isometry3d centre = facing_pose({0, 0, 2.6});  // 50 px wide
    centre.linear() =
        Eigen::AngleAxisd(0.8, Eigen::Vector3d(1, 0.3, 0).normalized()).toRotationMatrix() * centre.linear();
    const Trajectory motion = trajectory::handheld({.T_centre = centre,
                                                    .amplitude_m = {0.8, 0.5, 0.4},
                                                    .amplitude_rad = {0.1, 0.1, 0.3},
                                                    .frequency_hz = 3,
                                                    .seed = seed});
    const auto events = simulated::record(
        camera, {{.length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = motion}},
        SimulatorSettings{.duration_s = 0.05, .seed = seed, .light_time_constant_us = 50});
    REQUIRE(events.size() > 10000);
    for (const bool right_one_first : {true, false}) {
      CAPTURE(seed);
      CAPTURE(right_one_first);
      PlanarHypotheses<KalmanUpdate> marker(lines, model, detection(motion(0), mirrored(motion(0)), right_one_first),
                                            {.start_search = std::nullopt});
      AccuracyMeter meter;
      marker.push(events, [&](const PoseEstimate& pose, const Event&) { meter.add(pose, motion(seconds(pose.t))); });
      MESSAGE(meter.tracking() << " poses, off by at most " << meter.rotation_deg().max << " deg");
      REQUIRE(meter.tracking() > 1000);
      CHECK(meter.rotation_deg().max < 5);  // measured 1.9 to 2.3
    }
  }
}
