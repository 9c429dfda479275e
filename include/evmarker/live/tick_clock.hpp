#pragma once
// A clock that ticks at a fixed rate of camera time.
#include <chrono>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

#include "evmarker/events/event.hpp"
#include "evmarker/events/tick_times.hpp"
#include "evmarker/live/event_intake.hpp"

namespace evmarker::live {

/// Ticks at the multiples of an interval of camera time, see TickTimes. Camera time is that of the events, continued by
/// the wall clock while none come. For use by one thread.
class TickClock {
 public:
  /// @param gap a longer jump ahead of camera time is skipped without ticks
  /// @throws std::invalid_argument if the interval is not positive
  TickClock(std::chrono::microseconds interval, std::chrono::microseconds gap) : ticks_(interval, gap) {
    if (interval.count() <= 0)
      throw std::invalid_argument("pipeline: tick_interval [us] is " + std::to_string(interval.count()));
  }

  /// Sets camera time by a block of events; to be called with every block before it is tracked.
  void begin(const EventBlock& block) noexcept {
    ticks_.begin(block.span().front().t, block.span().back().t);
    last_pushed_ = block.last_pushed();
  }

  /// See TickTimes.
  std::optional<Timestamp> take_due(Timestamp now) noexcept { return ticks_.take_due(now); }
  /// See TickTimes.
  std::span<const Event> before_next(std::span<const Event> events) const noexcept {
    return ticks_.before_next(events);
  }

  /// Camera time, continued by the wall clock since the last block was pushed; the earliest time before the first
  /// block.
  Timestamp now(Clock::time_point wall) const noexcept {
    if (!ticks_.started()) return std::numeric_limits<Timestamp>::min();
    const auto since = std::chrono::duration_cast<std::chrono::microseconds>(wall - last_pushed_);
    return TickTimes::later(ticks_.last_t(), since.count());
  }

  /// Wall time until the next tick if no events come, at most `limit`.
  std::chrono::microseconds wait(Clock::time_point wall, std::chrono::microseconds limit) const noexcept {
    if (!ticks_.started()) return limit;
    const Timestamp now = this->now(wall), next = ticks_.next();
    if (now >= next) return std::chrono::microseconds(0);
    return elapsed_us(now, next) < static_cast<std::uint64_t>(limit.count()) ? std::chrono::microseconds(next - now)
                                                                             : limit;
  }

 private:
  TickTimes ticks_;
  Clock::time_point last_pushed_;  // when the last event of the last block was pushed
};

}  // namespace evmarker::live
