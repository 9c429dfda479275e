#pragma once
// Settings of a pipeline.
#include <chrono>
#include <cstddef>
#include <functional>
#include <span>

#include "evmarker/events/trigger_event.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker::live {

/// Settings of a pipeline: its tracker, its queue, its detector's thread and its callbacks.
template <PoseUpdateRule Rule = KalmanUpdate>
struct PipelineSettings {
  TrackerSettings<Rule> tracker{};
  OverloadPolicy overload = OverloadPolicy::drop_oldest;
  std::size_t queue_events = 1u << 18;  ///< room in the queue, 16 bytes each; a push takes room for 256 or more
  /// Whether tracking waits for a detection that takes longer than `tracker.detection_latency` of camera time: then the
  /// poses are those of `Tracker`, bit for bit. For files, with the policy `block`.
  bool wait_for_detector = false;
  /// Whether the detector, once all markers are tracked, only uses free processors, so that tracking never waits for
  /// one (Linux: SCHED_IDLE). Once a detection has taken more than 0.2 s, as where other programs keep all processors
  /// busy, it competes for processors again. Has no effect with `wait_for_detector`.
  bool detect_when_idle = true;
  std::chrono::microseconds gap{1000000};  ///< camera time without events that `Status` counts

  /// Called at every multiple of `tick_interval` in camera time, with the poses of all tracked markers predicted for
  /// that time: for a controller. Their covariance grows with their age, `t - quality.updated_t`. While no events come,
  /// camera time is continued by the wall clock, but not with `wait_for_detector`.
  std::function<void(Timestamp t, std::span<const PoseEstimate>)> on_tick = {};
  std::chrono::microseconds tick_interval{1000};
  /// Called with every trigger event that was pushed, in its place among the poses.
  std::function<void(const TriggerEvent&)> on_trigger = {};
};

}  // namespace evmarker::live
