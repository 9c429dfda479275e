#pragma once
// A ring buffer of recent events, for replay after a detection and backwards for verification.
#include <bit>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// A ring buffer of the last events, oldest first; where it is full, a new event replaces the oldest. Never allocates
/// after construction, except when assigned from a history of another capacity.
class EventHistory {
 public:
  /// @param capacity number of events kept, rounded up to a power of two
  /// @throws std::invalid_argument if it is 0, or more than any memory
  explicit EventHistory(std::size_t capacity) {
    if (capacity == 0 || capacity > ring_.max_size() / 2)
      throw std::invalid_argument("event history: capacity is " + std::to_string(capacity));
    ring_.resize(std::bit_ceil(capacity));
    mask_ = ring_.size() - 1;
  }

  // Member by member: copied as a whole, an event that is in registers would have to go through memory.
  void push(const Event& event) noexcept {
    Event& place = ring_[pushed_++ & mask_];
    place.x = event.x;
    place.y = event.y;
    place.p = event.p;
    place.t = event.t;
    size_ += size_ <= mask_;
  }
  /// Forgets all events; `pushed()` stays.
  void clear() noexcept { size_ = 0; }

  std::size_t capacity() const noexcept { return mask_ + 1; }
  std::size_t size() const noexcept { return size_; }
  bool full() const noexcept { return size_ > mask_; }

  /// Event `i` of those that are kept, 0 the oldest; requires i < size().
  const Event& operator[](std::size_t i) const noexcept { return ring_[(pushed_ - size() + i) & mask_]; }

  /// How many events have been pushed since construction: the present position in the stream, see `reaches` and `at`.
  std::uint64_t pushed() const noexcept { return pushed_; }

  /// True if every event pushed since `pushed()` was `position` is kept.
  bool reaches(std::uint64_t position) const noexcept { return position >= pushed_ - size(); }

  /// The event that was pushed when `pushed()` was `position`; it must be kept, see `reaches`.
  const Event& at(std::uint64_t position) const noexcept { return ring_[position & mask_]; }

 private:
  std::vector<Event> ring_;
  std::uint64_t pushed_ = 0;
  std::size_t size_ = 0, mask_ = 0;
};

}  // namespace evmarker
