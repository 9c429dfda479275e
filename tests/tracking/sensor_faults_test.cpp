// A sensor that fails for a while, and one with broken pixels, through the tracker of many markers.
#include <doctest/doctest.h>

#include <algorithm>
#include <vector>

#include "evmarker/tracking/tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "sanitized.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::seconds;
using simulated::TrueDetector;

namespace {

// What became of a recording.
struct Outcome {
  TrackerStatistics statistics;
  std::vector<LossReason> losses;
  std::size_t tracking = 0, wrong = 0;  // poses called `tracking`, and those of them that are 20 mm off
  Timestamp last_t = 0;                 // of the last one called `tracking`
};

template <typename Rule>
Outcome track(const Trajectory& motion, const std::vector<Event>& events) {
  Tracker<TrueDetector, Rule> tracker(simulated::camera, TrueDetector{motion});
  Outcome outcome;
  tracker.push(events, [&](const PoseEstimate& pose) {
    if (pose.quality.state == TrackingState::lost) outcome.losses.push_back(pose.quality.loss_reason);
    if (pose.quality.state != TrackingState::tracking) return;
    ++outcome.tracking;
    outcome.last_t = pose.t;
    const Eigen::Isometry3d truth = motion(seconds(pose.t));
    outcome.wrong += (pose.T_camera_marker.translation() - truth.translation()).norm() > 0.02;
  });
  outcome.statistics = tracker.statistics();
  return outcome;
}

}  // namespace

TEST_CASE_TEMPLATE("after an outage of the sensor no pose is that of the old place", Rule, KalmanUpdate,
                   DecoupledUpdate) {
  const Trajectory motion = simulated::near_motion(71);
  const auto events = simulated::near_events(motion, 0.5, 71);
  for (const Timestamp missing : {20000, 100000, 200000}) {
    CAPTURE(missing);
    auto left = events;
    std::erase_if(left, [&](const Event& event) { return event.t >= 150000 && event.t < 150000 + missing; });
    const Outcome outcome = track<Rule>(motion, left);
    CHECK(outcome.statistics.outages == 1);
    CHECK(outcome.losses == std::vector{LossReason::events_missing});
    CHECK(outcome.statistics.registered == 2);
    CHECK(outcome.tracking > 1000);
    CHECK(outcome.wrong == 0);
    CHECK(outcome.last_t > 490000);
  }
}

TEST_CASE("an outage in which a marker rests is bridged, as its place is predicted") {
  const Trajectory motion = trajectory::stop_and_go(simulated::near_motion(72), 0.15, 0.4);
  auto events = simulated::near_events(motion, 0.8, 72);
  std::erase_if(events, [](const Event& event) { return event.t >= 400000 && event.t < 405000; });
  const Outcome outcome = track<KalmanUpdate>(motion, events);
  CHECK(outcome.statistics.outages == 1);
  CHECK(outcome.losses.empty());
  CHECK(outcome.wrong == 0);
  CHECK(outcome.last_t > 690000);
}

TEST_CASE_TEMPLATE("where all motion stops there is no outage and no loss, with and without noise", Rule, KalmanUpdate,
                   DecoupledUpdate) {
  const Trajectory motion = trajectory::stop_and_go(simulated::near_motion(73), 0.15, 0.3);
  for (const double noise_hz_per_px : {0.0, 3.0, 0.01, 0.1, 1.0, 10.0, 20.0}) {
    if (kSanitized && noise_hz_per_px != 0 && noise_hz_per_px != 3) break;
    CAPTURE(noise_hz_per_px);
    const auto events = simulated::record(
        simulated::camera, {{.length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = motion}},
        SimulatorSettings{.duration_s = 0.6, .seed = 73, .noise_hz_per_px = noise_hz_per_px});
    const Outcome outcome = track<Rule>(motion, events);
    CHECK(outcome.statistics.outages == 0);
    CHECK(outcome.losses.empty());
    CHECK(outcome.wrong == 0);
    CHECK(outcome.last_t > 590000);
  }
}

TEST_CASE_TEMPLATE("a broken column of the sensor does not drag a marker along", Rule, KalmanUpdate, DecoupledUpdate) {
  const Trajectory motion = simulated::near_motion(74);
  auto events = simulated::near_events(motion, 0.6, 74);
  const std::size_t right = events.size();
  for (Timestamp t = 200000; t < 500000; t += 100)
    for (std::uint16_t y = 0; y < 480; ++y) events.push_back({320, y, 1, t + y % 100});
  std::ranges::stable_sort(events, {}, &Event::t);
  const Outcome outcome = track<Rule>(motion, events);
  CHECK(outcome.statistics.hot > (events.size() - right) * 3 / 4);
  CHECK(outcome.losses.empty());
  CHECK(outcome.tracking > 5000);
  CHECK(outcome.wrong == 0);
}
