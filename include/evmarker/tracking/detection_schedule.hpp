#pragma once
// The schedule of detections in the polarity frame.
#include <chrono>
#include <cstdint>
#include <limits>

#include "evmarker/events/event.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// Schedules detections, one at a time, at the intervals of the settings in camera time. After a step back in time,
/// all intervals count as elapsed.
class DetectionSchedule {
 public:
  template <PoseUpdateRule Rule>
  explicit DetectionSchedule(const TrackerSettings<Rule>& settings) noexcept
      : detection_interval_(settings.detection_interval),
        search_interval_(settings.search_interval),
        check_interval_(settings.check_interval),
        detection_latency_(settings.detection_latency),
        min_events_(settings.min_events_per_detection) {}

  /// Counts an event that has passed the filter.
  void count_event() noexcept { ++events_; }
  /// Notes that a marker was found at time t: others may follow, so that detections are frequent for a while.
  void note_found(Timestamp t) noexcept { last_found_ = t; }

  /// Notes whether every marker that can be found is tracked, so that detections are rare.
  void note_all_tracked(bool all) noexcept { all_tracked_ = all; }

  /// True if a detection should begin now; false while one is going on.
  /// @param searching whether a marker is missing, so that detections are to be frequent
  bool due(Timestamp t, bool searching) const noexcept {
    return events_ >= min_events_ && !running_ && elapsed(interval(t, searching), began_, t);
  }
  /// Notes that a detection begins at time t.
  void begin(Timestamp t) noexcept {
    began_ = t;
    events_ = 0;
    running_ = true;
  }
  /// True while a detection is going on, from `begin` to `end`.
  bool running() const noexcept { return running_; }
  /// True if a detection is going on and `detection_latency` has passed since its begin.
  bool result_due(Timestamp t) const noexcept { return running_ && elapsed(detection_latency_, began_, t); }
  /// Notes that the detection has ended.
  void end() noexcept { running_ = false; }

 private:
  static constexpr std::chrono::milliseconds kOthers{100};  // how long detections are frequent after a marker was found

  std::chrono::microseconds interval(Timestamp t, bool searching) const noexcept {
    if (searching) return search_interval_;
    if (all_tracked_) return check_interval_;
    return elapsed(kOthers, last_found_, t) ? detection_interval_ : search_interval_;
  }

  static bool elapsed(std::chrono::microseconds time, Timestamp since, Timestamp t) noexcept {
    return t < since || elapsed_us(since, t) >= static_cast<std::uint64_t>(time.count());
  }

  std::chrono::microseconds detection_interval_, search_interval_, check_interval_, detection_latency_;
  int min_events_;
  std::int64_t events_ = 0;  // that have passed the filter since the last detection began
  bool running_ = false;
  bool all_tracked_ = false;
  Timestamp began_ = std::numeric_limits<Timestamp>::min();
  Timestamp last_found_ = std::numeric_limits<Timestamp>::min();
};

}  // namespace evmarker
