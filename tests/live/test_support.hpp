#pragma once
// What the tests of live/ share.
#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

#include "evmarker/live/pipeline.hpp"
#include "simulated.hpp"

namespace evmarker::live::test {

using Settings = PipelineSettings<>;

inline const Trajectory& motion() {
  static const Trajectory motion = simulated::near_motion(71);
  return motion;
}

/// 0.3 s of marker 0, simulated once, with three events off the sensor.
inline const std::vector<Event>& events() {
  static const std::vector<Event> events = [] {
    auto simulated = simulated::near_events(motion(), 0.3, 71);
    for (const int at : {1000, 2000, 3000})
      simulated.insert(simulated.begin() + at, Event{640, 0, 1, simulated[static_cast<std::size_t>(at)].t});
    return simulated;
  }();
  return events;
}

/// Every event is counted once.
inline void check_sum(const Status& s) {
  CHECK(s.events == s.processed + s.filtered + s.off_sensor + s.hot + s.time_faults + s.dropped + s.queue_depth);
}

inline const auto kNoPoses = [](const PoseEstimate&) {};

}  // namespace evmarker::live::test
