#pragma once
// A block of events on its way through the queue, to which a push appends until the tracking thread has it.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>

#include "evmarker/events/event.hpp"

namespace evmarker::live {

using Clock = std::chrono::steady_clock;

/// Up to 256 events in the order in which they were pushed. Until it is closed, more may be appended.
class EventBlock {
 public:
  static constexpr std::size_t kCapacity = 256;

  /// Makes the block an empty one.
  /// @param number of the block, counted from 1 since the start
  /// @param follows_dropped events pushed right before it were dropped, as the queue had no room
  void begin(std::uint64_t number, bool follows_dropped, Clock::time_point now) noexcept {
    number_ = number;
    follows_dropped_ = follows_dropped;
    pushed_ = now;
    state_.store(0, std::memory_order_relaxed);
  }

  /// Appends events, as many as there is room for; none if the block is closed. For one thread at a time.
  /// @return how many were appended
  std::size_t append(std::span<const Event> events, Clock::time_point now) noexcept {
    std::size_t size = state_.load(std::memory_order_relaxed);
    if (size >= kCapacity) return 0;  // full, or closed
    events = events.first(std::min(events.size(), kCapacity - size));
    std::ranges::copy(events, events_.begin() + static_cast<std::ptrdiff_t>(size));
    last_pushed_.store(now, std::memory_order_relaxed);
    return state_.compare_exchange_strong(size, size + events.size(), std::memory_order_release) ? events.size() : 0;
  }

  /// Refuses further events. The events may be read by another thread than the one that appends only afterwards.
  void close() noexcept { state_.fetch_or(kClosed, std::memory_order_acquire); }

  std::span<const Event> span() const noexcept { return {events_.data(), size()}; }
  std::size_t size() const noexcept { return state_.load(std::memory_order_relaxed) & ~kClosed; }
  std::uint64_t number() const noexcept { return number_; }
  bool follows_dropped() const noexcept { return follows_dropped_; }
  /// When the first event was pushed, and the last one.
  Clock::time_point pushed() const noexcept { return pushed_; }
  Clock::time_point last_pushed() const noexcept { return last_pushed_.load(std::memory_order_relaxed); }
  /// Time of the first event [us]; of the second one where the two are so far apart that the first is taken for wrong.
  Timestamp first_t() const noexcept {
    constexpr std::uint64_t kApart_us = 10000;
    if (size() < 2) return events_[0].t;
    const auto [earlier, later] = std::minmax(events_[0].t, events_[1].t);
    return elapsed_us(earlier, later) > kApart_us ? events_[1].t : events_[0].t;
  }

 private:
  static constexpr std::size_t kClosed = std::size_t{1} << 31;

  std::uint64_t number_ = 0;
  bool follows_dropped_ = false;
  Clock::time_point pushed_;
  std::atomic<Clock::time_point> last_pushed_{};
  std::atomic<std::size_t> state_{0};  // the number of events, and kClosed
  std::array<Event, kCapacity> events_;
};

}  // namespace evmarker::live
