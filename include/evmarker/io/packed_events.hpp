#pragma once
// Events in vector registers: decoders make them, and see of all at once that none needs a closer look.
#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

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
  if constexpr (std::endian::native == std::endian::little)
    return PackedEvent{x | y << 16U | p << 32U, static_cast<std::uint64_t>(t)};
  else
    return PackedEvent{x << 48U | y << 32U | p << 16U, static_cast<std::uint64_t>(t)};
}

/// Tells whether all of many events are usual: on the sensor, of polarity 0 or 1, at times that are not negative and do
/// not step back.
class UsualEvents {
 public:
  /// @param last time before these events
  UsualEvents(SensorSize size, Timestamp last) noexcept
      : limits_{largest(size.width), largest(size.height), 1, kAny, kAny, kAny, kAny, kAny},
        before_{0, static_cast<std::uint64_t>(last)},
        negative_(before_) {}

  [[gnu::always_inline]] void add(PackedEvent event) noexcept {
    beyond_ |= reinterpret_cast<Numbers>(event) > limits_;
    negative_ |= event | (event - before_);  // has the sign of either: where no time has one, no difference overflows
    before_ = event;
  }

  bool all() const noexcept {
    return (beyond_[0] | beyond_[1] | beyond_[2]) == 0 && static_cast<std::int64_t>(negative_[1]) >= 0;
  }

 private:
  using Numbers [[gnu::vector_size(16)]] = std::uint16_t;  // x, y, polarity, one without a meaning, and the time

  static constexpr std::uint16_t kAny = 0xFFFF;
  static std::uint16_t largest(int side) noexcept {
    return static_cast<std::uint16_t>(std::clamp(side - 1, 0, 0xFFFF));
  }

  Numbers limits_, beyond_{};
  PackedEvent before_, negative_;
};

}  // namespace evmarker::io
