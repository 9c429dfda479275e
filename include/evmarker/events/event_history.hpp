#pragma once
// A ring of recent events: replayed after a detection, and backwards for verification.
#include <bit>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// The last events, oldest first; a full ring forgets the oldest. Never allocates after construction, except when
/// assigned from a ring of another capacity.
class EventHistory {
 public:
  /// @param capacity number of events kept, rounded up to a power of two
  explicit EventHistory(std::size_t capacity) {
    if (capacity == 0) throw std::invalid_argument("event history: capacity is 0");
    ring_.resize(std::bit_ceil(capacity));
    mask_ = ring_.size() - 1;
  }

  // By members: an event that is in registers need not be written down to be copied as a whole.
  void push(const Event& event) noexcept {
    Event& place = ring_[pushed_++ & mask_];
    place.x = event.x;
    place.y = event.y;
    place.p = event.p;
    place.t = event.t;
    size_ += size_ <= mask_;
  }
  void clear() noexcept { size_ = 0; }

  std::size_t capacity() const noexcept { return mask_ + 1; }
  std::size_t size() const noexcept { return size_; }
  bool full() const noexcept { return size_ > mask_; }

  /// Event `i`, 0 the oldest that is kept.
  const Event& operator[](std::size_t i) const noexcept { return ring_[(pushed_ - size() + i) & mask_]; }

  /// How many events were ever pushed: a position in the stream to come back to.
  std::uint64_t pushed() const noexcept { return pushed_; }

  /// True if every event pushed since `pushed()` was `position` is still kept.
  bool reaches(std::uint64_t position) const noexcept { return position >= pushed_ - size(); }

  /// The event that was pushed when `pushed()` was `position`, if it is still kept.
  const Event& at(std::uint64_t position) const noexcept { return ring_[position & mask_]; }

 private:
  std::vector<Event> ring_;
  std::uint64_t pushed_ = 0;
  std::size_t size_ = 0, mask_ = 0;
};

}  // namespace evmarker
