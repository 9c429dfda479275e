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

/// How the tracking thread competes with other threads for a processor.
enum class TrackingPriority {
  automatic,  ///< with real-time priority where that is permitted, see `Status::real_time`; on Linux, and not with
              ///< `wait_for_detector`
  normal      ///< like any other thread
};

/// Settings of a pipeline: its tracker, its queue, its detector's thread and its callbacks.
template <PoseUpdateRule Rule = KalmanUpdate>
struct PipelineSettings {
  TrackerSettings<Rule> tracker{};
  OverloadPolicy overload = OverloadPolicy::drop_oldest;
  std::size_t queue_events = 1u << 18;  ///< room in the queue, 16 bytes each
  /// Whether tracking waits for a detection that takes longer than `tracker.detection_latency` of camera time: then the
  /// poses are those of `Tracker`, as far as those are the same bit for bit. For files, with the policy `block`.
  bool wait_for_detector = false;
  TrackingPriority priority = TrackingPriority::automatic;
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
