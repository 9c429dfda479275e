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

template <PoseUpdateRule Rule = KalmanUpdate>
struct PipelineSettings {
  TrackerSettings<Rule> tracker{};
  OverloadPolicy overload = OverloadPolicy::drop_oldest;
  std::size_t queue_events = 1u << 18;  ///< waiting to be tracked at most, 16 bytes each; a push takes 256 or more
  /// Tracking waits for a detector that needs more camera time than `tracker.detection_latency`: then the poses are
  /// those of `Tracker`, bit for bit. For files, with the policy `block`.
  bool wait_for_detector = false;
  /// Once all markers are tracked, the detector works where a processor is free, so that tracking never waits for it
  /// (Linux: SCHED_IDLE). It takes its share all the same once a detection has taken 0.2 s, as where other programs
  /// keep all processors busy. Without effect where tracking waits for the detector.
  bool detect_when_idle = true;
  std::chrono::microseconds gap{1000000};  ///< camera time without events that `Status` counts

  /// Called every `tick_interval` of camera time, at its multiples, with all tracked markers' poses moved on to that
  /// time: for a controller. Their covariance grows with their age, `t - quality.updated_t`. Where no events come, the
  /// wall clock runs camera time on, but not with `wait_for_detector`.
  std::function<void(Timestamp t, std::span<const PoseEstimate>)> on_tick = {};
  std::chrono::microseconds tick_interval{1000};
  /// Called with every trigger event that was pushed, in its place among the poses.
  std::function<void(const TriggerEvent&)> on_trigger = {};
};

}  // namespace evmarker::live
