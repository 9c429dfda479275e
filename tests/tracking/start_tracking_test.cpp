// Trackers that start from a rough pose: found or not, after a gap, and given up.
#include <doctest/doctest.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "search/sketch.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::kModel;
using simulated::Sketch;

TEST_CASE("starts 15 mm to a side, 45 mm in depth and 5 degrees off at 0.6 m are found, and tracked, within 50 ms") {
  int runs = 0, found = 0, found_without = 0;
  for (std::uint64_t seed = 900; seed < 920; ++seed) {
    const Trajectory motion = simulated::near_motion(seed);
    const auto events = simulated::filtered(simulated::near_events(motion, 0.05, seed));
    REQUIRE(events.size() > 5000);
    std::mt19937 random(static_cast<unsigned>(seed));
    for (int i = 0; i < 5; ++i) {
      const Eigen::Isometry3d start = simulated::off(motion(0), random, 0.015, i % 2 == 0 ? 0.045 : -0.045, 5);
      const auto locked = [&](const MarkerTrackerSettings<>& settings) {
        MarkerTracker tracker(simulated::camera, kModel, start, settings);
        CHECK(tracker.searching() == settings.start_search.has_value());
        for (const Event& event : events) tracker.push(event);
        CHECK(!tracker.searching());
        const PoseError error =
            pose_error(tracker.T_camera_marker(), motion(1e-6 * static_cast<double>(tracker.estimate().t)));
        return tracker.state() == TrackingState::tracking && error.translation_mm < 2 && error.rotation_deg < 2;
      };
      ++runs;
      found += locked({});
      found_without += locked({.start_search = std::nullopt});
    }
  }
  MESSAGE("found " << found << " of " << runs << ", without looking for the marker first " << found_without);
  CHECK(runs == 100);
  CHECK(found >= 99);
  CHECK(found_without < 50);  // or the starts were too easy
}

TEST_CASE("a tracker whose search is given up is lost") {
  const Sketch sketch{.duration_s = 0.3, .per_px = 0};
  const auto events = sketch.draw(3);
  MarkerTracker tracker(sketch.camera, kModel, sketch.T,
                        {.start_search = StartPoseSearchSettings{.longest = std::chrono::milliseconds(200)}});
  const PoseEstimate* last = nullptr;
  for (const Event& event : events) {
    CHECK(tracker.searching() == (last == nullptr));
    if (const PoseEstimate* const pose = tracker.push(event)) last = pose;
  }
  REQUIRE(last);
  CHECK(last->quality.state == TrackingState::lost);
}

TEST_CASE("events that were missed begin the search anew instead of losing the marker") {
  const Sketch sketch{.duration_s = 0.05};
  MarkerTracker tracker(sketch.camera, kModel, sketch.rough(1));
  const auto events = sketch.draw(6);
  for (std::size_t i = 0; i < 50; ++i) tracker.push(events[i]);
  REQUIRE(tracker.searching());
  CHECK(tracker.skip(std::chrono::milliseconds(100)) == nullptr);
  CHECK(tracker.state() == TrackingState::converging);
  for (std::size_t i = 50; i < events.size(); ++i) tracker.push(events[i]);
  CHECK_FALSE(tracker.searching());
  REQUIRE(tracker.start_search());
  CHECK(tracker.start_search()->evidence() > tracker.start_search()->needed_evidence());
}
