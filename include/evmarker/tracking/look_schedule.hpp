#pragma once
// When the polarity frame is looked at for markers.
#include <chrono>
#include <cstdint>
#include <limits>

#include "evmarker/events/event.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// One look at a time, at the intervals of the settings in camera time. A step back in time does not stop it.
class LookSchedule {
 public:
  template <PoseUpdateRule Rule>
  explicit LookSchedule(const TrackerSettings<Rule>& settings) noexcept
      : detection_interval_(settings.detection_interval),
        search_interval_(settings.search_interval),
        detection_latency_(settings.detection_latency),
        min_events_(settings.min_events_per_detection) {}

  /// An event has passed the filter.
  void count_event() noexcept { ++events_; }
  /// A marker was found: others may be about to be.
  void note_found(Timestamp t) noexcept { last_found_ = t; }

  /// Whether to look now. Not while an answer is awaited.
  /// @param searching whether a marker is looked for that should be there
  bool due(Timestamp t, bool searching) const noexcept {
    const bool often = searching || !elapsed(kOthers, last_found_, t);
    return events_ >= min_events_ && !awaited_ &&
           elapsed(often ? search_interval_ : detection_interval_, last_look_, t);
  }
  void begin(Timestamp t) noexcept {
    last_look_ = t;
    events_ = 0;
    awaited_ = true;
  }
  bool answer_awaited() const noexcept { return awaited_; }
  bool answer_due(Timestamp t) const noexcept { return awaited_ && elapsed(detection_latency_, last_look_, t); }
  void end() noexcept { awaited_ = false; }

 private:
  static constexpr std::chrono::milliseconds kOthers{100};

  static bool elapsed(std::chrono::microseconds time, Timestamp since, Timestamp t) noexcept {
    return t < since || elapsed_us(since, t) >= static_cast<std::uint64_t>(time.count());
  }

  std::chrono::microseconds detection_interval_, search_interval_, detection_latency_;
  int min_events_;
  std::int64_t events_ = 0;  // through the filter since the last look
  bool awaited_ = false;
  Timestamp last_look_ = std::numeric_limits<Timestamp>::min();
  Timestamp last_found_ = std::numeric_limits<Timestamp>::min();
};

}  // namespace evmarker
