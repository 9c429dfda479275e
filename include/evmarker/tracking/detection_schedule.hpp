#pragma once
// When a detector gets the polarity frame.
#include <chrono>
#include <cstdint>
#include <limits>

#include "evmarker/events/event.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// One detection at a time, at the intervals of the settings in camera time. A step back in time does not stop it.
class DetectionSchedule {
 public:
  template <PoseUpdateRule Rule>
  explicit DetectionSchedule(const TrackerSettings<Rule>& settings) noexcept
      : detection_interval_(settings.detection_interval),
        search_interval_(settings.search_interval),
        detection_latency_(settings.detection_latency),
        min_events_(settings.min_events_per_detection) {}

  /// Counts an event that has passed the filter.
  void count_event() noexcept { ++events_; }
  /// A marker was found: others may be about to be.
  void note_found(Timestamp t) noexcept { last_found_ = t; }

  /// True if a detection should begin now; false while one is going on.
  /// @param searching whether a marker that should be there has not been found
  bool due(Timestamp t, bool searching) const noexcept {
    const bool often = searching || !elapsed(kOthers, last_found_, t);
    return events_ >= min_events_ && !running_ && elapsed(often ? search_interval_ : detection_interval_, began_, t);
  }
  void begin(Timestamp t) noexcept {
    began_ = t;
    events_ = 0;
    running_ = true;
  }
  /// True from the begin of a detection to its end.
  bool running() const noexcept { return running_; }
  /// True if the detection that is going on has lasted as long as the settings say that it takes.
  bool result_due(Timestamp t) const noexcept { return running_ && elapsed(detection_latency_, began_, t); }
  void end() noexcept { running_ = false; }

 private:
  static constexpr std::chrono::milliseconds kOthers{100};

  static bool elapsed(std::chrono::microseconds time, Timestamp since, Timestamp t) noexcept {
    return t < since || elapsed_us(since, t) >= static_cast<std::uint64_t>(time.count());
  }

  std::chrono::microseconds detection_interval_, search_interval_, detection_latency_;
  int min_events_;
  std::int64_t events_ = 0;  // through the filter since the last detection began
  bool running_ = false;
  Timestamp began_ = std::numeric_limits<Timestamp>::min();
  Timestamp last_found_ = std::numeric_limits<Timestamp>::min();
};

}  // namespace evmarker
