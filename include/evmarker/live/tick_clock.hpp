#pragma once
// A clock that ticks at a fixed rate of camera time.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/live/event_intake.hpp"

namespace evmarker::live {

/// Ticks at the multiples of an interval of camera time. Camera time is that of the events, continued by the wall clock
/// while none come. After a jump of camera time, as when a camera is restarted, ticks go on from the new time. For use
/// by one thread.
class TickClock {
 public:
  /// @param gap a longer jump ahead of camera time is skipped without ticks
  /// @throws std::invalid_argument if the interval is not positive
  TickClock(std::chrono::microseconds interval, std::chrono::microseconds gap)
      : interval_us_(interval.count()), gap_us_(static_cast<std::uint64_t>(gap.count())) {
    if (interval.count() <= 0)
      throw std::invalid_argument("pipeline: tick_interval [us] is " + std::to_string(interval.count()));
  }

  /// Sets camera time by a block of events; to be called with every block before it is tracked.
  void begin(const EventBlock& block) noexcept {
    const Timestamp first = block.span().front().t, last = block.span().back().t;
    const bool back = first < last_t_ && elapsed_us(first, last_t_) > kDisorder_us;
    // The next tick is too far ahead, after a wrong time or a step back within a block.
    const bool lost = first < next_ && elapsed_us(first, next_) > gap_us_ + static_cast<std::uint64_t>(interval_us_);
    if (!started_ || back || lost) start(first);
    last_t_ = last;
    last_pushed_ = block.last_pushed();
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

  /// Camera time, continued by the wall clock since the last block was pushed; the earliest time before the first
  /// block.
  Timestamp now(Clock::time_point wall) const noexcept {
    return started_ ? later(last_t_, std::chrono::duration_cast<std::chrono::microseconds>(wall - last_pushed_).count())
                    : std::numeric_limits<Timestamp>::min();
  }

  /// Wall time until the next tick if no events come, at most `limit`.
  std::chrono::microseconds wait(Clock::time_point wall, std::chrono::microseconds limit) const noexcept {
    if (!started_) return limit;
    const Timestamp now = this->now(wall);
    if (now >= next_) return std::chrono::microseconds(0);
    return elapsed_us(now, next_) < static_cast<std::uint64_t>(limit.count()) ? std::chrono::microseconds(next_ - now)
                                                                              : limit;
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

  // t + us for us >= 0, limited to kNever: a wrong time may be close to the largest one.
  static Timestamp later(Timestamp t, std::int64_t us) noexcept {
    return us > 0 && t > kNever - us ? kNever : t + std::max<std::int64_t>(us, 0);
  }

  std::int64_t interval_us_;
  std::uint64_t gap_us_;
  bool started_ = false;
  Timestamp next_ = kNever;        // of the next tick
  Timestamp last_t_ = 0;           // of the last event of the last block
  Clock::time_point last_pushed_;  // when that event was pushed
};

}  // namespace evmarker::live
