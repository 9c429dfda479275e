#pragma once
// Events in vector registers: decoders make them, and see of all at once that none needs a closer look.
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "evmarker/events/event.hpp"

namespace evmarker::io {

/// An Event as it is in memory: x, y and polarity in the first number, the time in the second.
using PackedEvent [[gnu::vector_size(16)]] = std::uint64_t;
static_assert(sizeof(Event) == sizeof(PackedEvent) && offsetof(Event, x) == 0 && offsetof(Event, y) == 2 &&
              offsetof(Event, p) == 4 && offsetof(Event, t) == 8);

[[gnu::always_inline]] inline PackedEvent packed_event(const Event& event) noexcept {
  PackedEvent packed;
  std::memcpy(&packed, &event, sizeof packed);
  return packed;
}
/// @param x,y,p of at most 16 bits each
// By shifts: an Event whose members are stored one by one cannot be loaded as a whole before all of them have arrived.
[[gnu::always_inline]] inline PackedEvent packed_event(std::uint64_t x, std::uint64_t y, std::uint64_t p,
                                                       Timestamp t) noexcept {
  assert((x | y | p) <= 0xFFFF);
  if constexpr (std::endian::native == std::endian::little)
    return PackedEvent{x | y << 16U | p << 32U, static_cast<std::uint64_t>(t)};
  else
    return PackedEvent{x << 48U | y << 32U | p << 16U, static_cast<std::uint64_t>(t)};
}

/// Tells whether many events are all usual: on the sensor, of polarity 0 or 1, at times that are not negative and do
/// not step back. It keeps the smallest and the largest of each number, so that an event costs a few instructions.
class UsualEvents {
 public:
  /// @param last time before these events
  explicit UsualEvents(Timestamp last) noexcept
      : before_{0, static_cast<std::uint64_t>(last)}, smallest_(reinterpret_cast<Numbers>(before_)) {}

  [[gnu::always_inline]] void add(PackedEvent event) noexcept {
    const auto numbers = reinterpret_cast<Numbers>(event);
    smallest_ = numbers < smallest_ ? numbers : smallest_;
    largest_ = numbers > largest_ ? numbers : largest_;
    steps_ |= event - before_;  // is negative once a time steps back; no difference overflows if no time is negative
    before_ = event;
  }

  /// True only if all events are usual; may be false for usual ones on a sensor of more than 2^15 px a side.
  [[gnu::always_inline]] bool all(SensorSize size) const noexcept {
    constexpr int kX = 0, kY = 1, kP = 2, kSignOfTime = std::endian::native == std::endian::little ? 7 : 4;
    return smallest_[kX] >= 0 && largest_[kX] < size.width && smallest_[kY] >= 0 && largest_[kY] < size.height &&
           smallest_[kP] >= 0 && largest_[kP] <= 1 && smallest_[kSignOfTime] >= 0 &&
           static_cast<std::int64_t>(steps_[1]) >= 0;
  }

 private:
  using Numbers [[gnu::vector_size(16)]] = std::int16_t;  // x, y, polarity, padding, four of the time

  PackedEvent before_, steps_{};
  Numbers smallest_, largest_{};
};

/// See UsualEvents. Both halves at once: two chains of instructions, each of which waits for the one before in its own.
/// @param last time before these events
inline bool are_usual(std::span<const Event> events, Timestamp last, SensorSize size) noexcept {
  const std::size_t half = events.size() / 2;
  UsualEvents first(last), second(half > 0 ? events[half - 1].t : last);
  for (std::size_t i = 0; i < half; ++i) {
    first.add(packed_event(events[i]));
    second.add(packed_event(events[half + i]));
  }
  if (events.size() % 2 != 0) second.add(packed_event(events.back()));
  return first.all(size) && second.all(size);
}

}  // namespace evmarker::io
