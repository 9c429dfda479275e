#pragma once
// A recording that can be played again and again, as its ends meet.
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "scenarios.hpp"
#include "tracker_methods.hpp"

namespace evmarker::bench {

/// One period of a motion that repeats itself.
class PeriodicRecording {
 public:
  /// @param situation its motion repeats itself after `period_us`, its duration is not used
  PeriodicRecording(Situation situation, Timestamp period_us)
      : situation_(std::move(situation)), period_us_(period_us) {
    situation_.simulator.duration_s = 2e-6 * static_cast<double>(period_us);
    for (Event event : simulate(situation_)) {
      if (event.t < period_us) continue;  // in the first period, pixels see their first edge
      event.t -= period_us;
      events_.push_back(event);
    }
  }

  const Situation& situation() const noexcept { return situation_; }
  Timestamp period_us() const noexcept { return period_us_; }
  std::span<const Event> events() const noexcept { return events_; }

  /// Writes the events with their times moved on to a period that begins at `begin`.
  void move_to(Timestamp begin, std::vector<Event>& moved) const {
    moved = events_;
    for (Event& event : moved) event.t += begin;
  }

  /// The true pose at a time after the begin of any period.
  Eigen::Isometry3d truth(Timestamp elapsed, std::size_t marker = 0) const {
    return situation_.truth(marker, elapsed % period_us_);
  }

 private:
  Situation situation_;
  Timestamp period_us_;
  std::vector<Event> events_;
};

}  // namespace evmarker::bench
