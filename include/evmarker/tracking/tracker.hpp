#pragma once
// Tracks many markers from their detection on: filter, detect, register, track, verify, drop, detect again.
#include <algorithm>
#include <concepts>
#include <optional>
#include <ranges>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/tracking/tracker_core.hpp"

namespace evmarker {

/// Tracks every marker that the detector finds. Runs on one thread and is deterministic: the same events give the same
/// poses, bit for bit, however they are batched (but see README.md, rounding). Between detections it throws and
/// allocates no more than TrackerCore does. `push` throws what the detector throws; TrackerStatistics::events then says
/// how many events had been taken.
template <MarkerDetector Detector, PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class Tracker {
 public:
  using Settings = TrackerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting that is out of range
  template <CameraModel Camera>
  Tracker(const Camera& camera, Detector detector, const Settings& settings = {})
      : Tracker(camera, std::move(detector), settings, Filter(camera.sensor_size(), settings.filter_window)) {}

  /// As above, with a noise filter of your own.
  template <CameraModel Camera>
  Tracker(const Camera& camera, Detector detector, const Settings& settings, Filter filter)
      : core_(camera, settings, std::move(filter)), detector_(std::move(detector)) {
    poses_.reserve(settings.max_markers);
  }

  /// Takes one event. Returns the poses that it leads to, valid until the next push.
  template <EventLike E>
  std::span<const PoseEstimate> push(const E& event) {
    poses_.clear();
    push(std::span(&event, 1), [this](const PoseEstimate& pose) { poses_.push_back(pose); });
    return poses_;
  }

  /// Takes events and calls `use(pose)` with each pose that they lead to, valid during the call. The poses are the same
  /// as with single events, and in the same order, but take less time.
  template <std::ranges::input_range Events, typename Use>
  requires EventLike<std::ranges::range_value_t<Events>> && std::invocable<const Use&, const PoseEstimate&>
  void push(Events&& events, const Use& use) {
    for_each_block(events, [&](std::span<const Event> block) { track(block, use); });
  }

  const TrackerStatistics& statistics() const noexcept { return core_.statistics(); }
  const PolarityFrame& polarity_frame() const noexcept { return core_.polarity_frame(); }
  /// The `MarkerTracker` of every confirmed marker. Range and trackers are valid until the next push.
  MarkerRange<Rule> markers() const noexcept { return core_.markers(); }

 private:
  template <typename Use>
  void track(std::span<const Event> events, const Use& use) {
    while (!events.empty()) {
      std::optional<Timestamp> due;
      const auto stop = [&](const Event& event) {
        if (core_.detection_due(event.t) || core_.result_due(event.t)) due = event.t;
        return due.has_value();
      };
      events = events.subspan(core_.push(events, stop, use));
      if (due) run_detector(*due, use);
    }
  }

  // Runs the detector if a detection is due at time t, and takes the result if that is due: `detection_latency` later,
  // which may be at once.
  template <typename Use>
  void run_detector(Timestamp t, const Use& use) {
    if (core_.detection_due(t)) detect(core_.request_detection(t));
    if (core_.result_due(t)) core_.register_markers(result_, use);
  }

  // If the detector throws, there is no result, and the next detection comes when it is due.
  void detect(const DetectionRequest& request) {
    try {
      result_ = answer_request(detector_, core_.polarity_frame(), request);
    } catch (...) {
      core_.cancel_detection();
      throw;
    }
  }

  TrackerCore<Rule, Filter> core_;
  Detector detector_;
  DetectionResult result_;           // of the last detection
  std::vector<PoseEstimate> poses_;  // that the last single event has led to
};

}  // namespace evmarker
