#pragma once
// Times at a fixed rate of camera time.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// The multiples of an interval of camera time, each when the events have come to it. After a jump of camera time, as
/// when a camera is restarted, they go on from the new time.
class TickTimes {
 public:
  /// @param interval positive
  /// @param gap a longer jump ahead of camera time is skipped without ticks
  TickTimes(std::chrono::microseconds interval, std::chrono::microseconds gap) noexcept
      : interval_us_(interval.count()), gap_us_(static_cast<std::uint64_t>(gap.count())) {}

  /// Sets camera time; to be called with every batch of events before it is used.
  /// @param first,last times of the first and the last event of the batch [us]
  void begin(Timestamp first, Timestamp last) noexcept {
    const bool back = first < last_t_ && elapsed_us(first, last_t_) > kDisorder_us;
    // The next tick is too far ahead, after a wrong time or a step back within a batch.
    const bool lost = first < next_ && elapsed_us(first, next_) > gap_us_ + static_cast<std::uint64_t>(interval_us_);
    if (!started_ || back || lost) start(first);
    last_t_ = last;
  }

  /// Takes the next tick that is due by a camera time: returns its time and goes on to the one after it. Null if none
  /// is due.
  std::optional<Timestamp> take_due(Timestamp now) noexcept {
    if (now >= next_ && elapsed_us(next_, now) > gap_us_) start(now);
    if (now < next_ || next_ == kNever) return std::nullopt;
    return std::exchange(next_, later(next_, interval_us_));
  }

  /// The first event of a batch, and those that follow it until the next tick is due.
  std::span<const Event> before_next(std::span<const Event> events) const noexcept {
    std::size_t count = 1;
    while (count < events.size() && (events[count].t < next_ || next_ == kNever)) ++count;
    return events.first(std::min(count, events.size()));
  }

  bool started() const noexcept { return started_; }
  /// Time of the next tick [us].
  Timestamp next() const noexcept { return next_; }
  /// Time of the last event of the last batch [us].
  Timestamp last_t() const noexcept { return last_t_; }

  /// t + us for us >= 0, limited to the largest time: a wrong time may be close to it.
  static Timestamp later(Timestamp t, std::int64_t us) noexcept {
    return us > 0 && t > kNever - us ? kNever : t + std::max<std::int64_t>(us, 0);
  }

 private:
  static constexpr Timestamp kNever = std::numeric_limits<Timestamp>::max();
  static constexpr std::uint64_t kDisorder_us = 10000;  // events of one camera may be so much out of order

  // Sets the next tick to the first one at or after t.
  void start(Timestamp t) noexcept {
    started_ = true;
    const Timestamp behind = t % interval_us_;
    next_ = behind > 0 ? later(t, interval_us_ - behind) : t - behind;
  }

  std::int64_t interval_us_;
  std::uint64_t gap_us_;
  bool started_ = false;
  Timestamp next_ = kNever;
  Timestamp last_t_ = 0;
};

}  // namespace evmarker
