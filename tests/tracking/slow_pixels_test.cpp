#include <doctest/doctest.h>

#include <cstdint>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "sanitized.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::seconds;
using simulated::TrueDetector;

namespace {

constexpr Timestamp kDuration_us = 1000000;

// A marker in a hand, before a sensor in dim light.
AccuracyMeter tracked(const SimulatorSettings& sensor) {
  constexpr std::uint64_t kSeed = 1;
  const Trajectory motion = simulated::near_motion(kSeed);
  SimulatorSettings settings = sensor;
  settings.duration_s = seconds(kDuration_us);
  settings.seed = kSeed;
  const Scene scene{
      {{.id = 0, .length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = motion}}, {}, {}};
  Tracker tracker(simulated::camera, TrueDetector{motion});
  AccuracyMeter meter;
  tracker.push(simulated::record(simulated::camera, scene, settings),
               [&](const PoseEstimate& pose) { meter.add(pose, motion(seconds(pose.t))); });
  MESSAGE(meter.tracking() << " poses, cover " << meter.coverage(kDuration_us) << ", " << meter.translation_mm().mean
                           << " mm, " << meter.rotation_deg().mean << " deg, NEES " << meter.nees().mean << ", wild "
                           << meter.wild() << ", lost " << meter.lost());
  return meter;
}

}  // namespace

TEST_CASE("pixels that answer in milliseconds, dark ones later than bright ones: the covariance says what that costs") {
  if (kSanitized) return;
  for (const SimulatorSettings& sensor :
       {SimulatorSettings{.pixel_time_constant_us = 5000}, SimulatorSettings{.light_time_constant_us = 500},
        SimulatorSettings{.light_time_constant_us = 1500}}) {
    CAPTURE(sensor.pixel_time_constant_us);
    CAPTURE(sensor.light_time_constant_us);
    const AccuracyMeter meter = tracked(sensor);
    REQUIRE(meter.tracking() > 3000);
    CHECK(meter.coverage(kDuration_us) > 0.99);
    CHECK(meter.lost() == 0);
    CHECK(meter.wild() == 0);
    CHECK(meter.translation_mm().mean < 1.3);
    CHECK(meter.rotation_deg().mean < 0.9);
    CHECK(meter.nees().mean > 0.2);
    CHECK(meter.nees().mean < 1);
  }
}

TEST_CASE("while events lie anywhere near its edges, a marker is not called tracked") {
  struct Filled : KalmanUpdate {
    using KalmanUpdate::KalmanUpdate;
    bool events_fill_distance() const noexcept { return true; }
  };
  const Trajectory motion = simulated::near_motion(1);
  const auto events = simulated::near_events(motion, 0.1, 1);
  const auto called_tracked = [&](auto tracker) {
    int tracked = 0, poses = 0;
    tracker.push(events, [&](const PoseEstimate& pose) {
      ++poses;
      tracked += pose.quality.state == TrackingState::tracking;
    });
    CHECK(poses > 100);
    return tracked;
  };
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  CHECK(called_tracked(MarkerTracker<KalmanUpdate>(simulated::camera, model, motion(0))) > 100);
  CHECK(called_tracked(MarkerTracker<Filled>(simulated::camera, model, motion(0))) == 0);
}
