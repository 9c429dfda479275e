#pragma once
// Many markers, found by themselves: filter, detect, register, track, verify, drop, find again.
#include <algorithm>
#include <array>
#include <concepts>
#include <ranges>
#include <span>
#include <utility>

#include "evmarker/tracking/tracker_core.hpp"

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
    core_.push(to_event(foreign_event), [this](const Event& event) { look_after(event.t); });
    return core_.poses();
  }

  /// Takes many events and calls `use(pose)` with each pose that they led to, in order of time: the same as one by one,
  /// and faster.
  template <std::ranges::contiguous_range Events, std::invocable<const PoseEstimate&> Use>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push(const Events& events, const Use& use) {
    if constexpr (std::same_as<std::ranges::range_value_t<Events>, Event>) {
      push_own(std::span<const Event>(events), use);
    } else {
      std::array<Event, 256> own;
      for (std::span<const std::ranges::range_value_t<Events>> left(events); !left.empty();) {
        const std::size_t count = std::min(left.size(), own.size());
        std::ranges::transform(left.first(count), own.begin(), [](const auto& event) { return to_event(event); });
        push_own(std::span<const Event>(own).first(count), use);
        left = left.subspan(count);
      }
    }
  }

  const TrackerStatistics& statistics() const noexcept { return core_.statistics(); }
  const PolarityFrame& polarity_frame() const noexcept { return core_.polarity_frame(); }
  /// The `MarkerTracker` of every marker that is being tracked.
  MarkerRange<Rule> markers() const noexcept { return core_.markers(); }

 private:
  template <typename Use>
  void push_own(std::span<const Event> events, const Use& use) {
    while (!events.empty()) {
      bool due = false;
      Timestamp t = 0;
      const auto stop = [&](const Event& event) {
        t = event.t;
        return due = core_.look_due(t) || core_.answer_due(t);
      };
      const std::size_t taken = core_.push(events, stop, use);
      if (due) look_after(t);
      std::ranges::for_each(core_.poses(), use);
      events = events.subspan(taken);
    }
  }

  // Looks at the polarity frame, or takes what was found, if it is time for that.
  void look_after(Timestamp t) {
    if (core_.look_due(t)) findings_ = answer(detector_, core_.polarity_frame(), core_.look(t));
    if (core_.answer_due(t)) core_.take(findings_);
  }

  TrackerCore<Rule, Filter> core_;
  Detector detector_;
  Findings findings_;  // of the last look
};

}  // namespace evmarker
