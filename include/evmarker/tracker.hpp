#pragma once
// Floor 10. Many markers, found by themselves: filter, detect, register, track, verify, drop, find again.
#include <concepts>
#include <span>
#include <utility>

#include "evmarker/tracker_core.hpp"

namespace evmarker {

/// Tracks every marker that the detector finds. One thread, deterministic: the same events give the same poses, bit for
/// bit, however they are batched. Between detections nothing throws or allocates.
template <MarkerDetector Detector, PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class Tracker {
 public:
  using Settings = TrackerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting that is out of range
  template <CameraModel Camera>
  Tracker(const Camera& camera, Detector detector, const Settings& settings = {})
      : Tracker(camera, std::move(detector), settings, Filter(camera.sensor_size(), settings.filter_window)) {}

  /// The same with a filter of one's own.
  template <CameraModel Camera>
  Tracker(const Camera& camera, Detector detector, const Settings& settings, Filter filter)
      : core_(camera, settings, std::move(filter)), detector_(std::move(detector)) {}

  /// Takes one event. Returns the poses that it led to, valid until the next push.
  template <EventLike E>
  std::span<const PoseEstimate> push(const E& foreign_event) {
    const Event event = to_event(foreign_event);
    if (!core_.push(event)) return {};
    if (core_.look_due(event.t)) findings_ = answer(detector_, core_.polarity_frame(), core_.look(event.t));
    if (core_.answer_due(event.t)) core_.take(findings_);
    return core_.poses();
  }

  const TrackerStatistics& statistics() const noexcept { return core_.statistics(); }
  const PolarityFrame& polarity_frame() const noexcept { return core_.polarity_frame(); }
  /// The `MarkerTracker` of every marker that is being tracked.
  auto markers() const noexcept { return core_.markers(); }

 private:
  TrackerCore<Rule, Filter> core_;
  Detector detector_;
  Findings findings_;  // of the last look
};

}  // namespace evmarker
