#pragma once
// Events, and how the library reads the event types of cameras and of other libraries.
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace evmarker {

/// Camera time [us].
using Timestamp = std::int64_t;

/// Time from `from` to `to` [us], which must not be earlier; correct for any two such times, without overflow.
constexpr std::uint64_t elapsed_us(Timestamp from, Timestamp to) noexcept {
  return static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from);
}

/// The time `duration`, which must not be negative, after t, at most the last that a Timestamp can express.
constexpr Timestamp later(Timestamp t, std::chrono::microseconds duration) noexcept {
  constexpr Timestamp kLast = std::numeric_limits<Timestamp>::max();
  return t > kLast - duration.count() ? kLast : t + duration.count();
}

/// Width and height of a sensor [px].
struct SensorSize {
  static constexpr int kMaxSide = 0xFFFF;  ///< an event's x and y have 16 bits, and 65535 is off every sensor

  int width = 0;
  int height = 0;

  constexpr bool contains(int x, int y) const noexcept { return x >= 0 && x < width && y >= 0 && y < height; }
  constexpr bool operator==(const SensorSize&) const = default;
};

/// One brightness change: pixel (x right, y down), polarity (p > 0 is ON, brighter), time [us].
/// Member for member the layout of OpenEB's `EventCD`.
struct Event {
  std::uint16_t x = 0;
  std::uint16_t y = 0;
  std::int16_t p = 0;
  Timestamp t = 0;

  constexpr bool operator==(const Event&) const = default;
};

/// Polarity of an event as a number: 1 ON, -1 OFF.
// Without a branch, which would be mispredicted for every other event.
inline double polarity(const Event& event) noexcept { return std::copysign(1.0, event.p - 0.5); }

/// How the library reads a foreign event type. Works for members `x y p t` (OpenEB) and for accessors
/// `x() y() polarity() timestamp()` (dv-processing); specialise it for anything else.
template <typename E>
struct EventTraits;

template <typename E>
requires requires(const E& e) {
  { e.x } -> std::convertible_to<int>;
  { e.y } -> std::convertible_to<int>;
  { e.p } -> std::convertible_to<int>;
  { e.t } -> std::convertible_to<Timestamp>;
  requires std::integral<std::remove_cvref_t<decltype(e.t)>>;  // seconds must not become whole microseconds
}
struct EventTraits<E> {
  static constexpr int x(const E& e) noexcept { return static_cast<int>(e.x); }
  static constexpr int y(const E& e) noexcept { return static_cast<int>(e.y); }
  static constexpr bool on(const E& e) noexcept { return e.p > 0; }
  static constexpr Timestamp t(const E& e) noexcept { return static_cast<Timestamp>(e.t); }
};

template <typename E>
requires requires(const E& e) {
  { e.x() } -> std::convertible_to<int>;
  { e.y() } -> std::convertible_to<int>;
  { e.polarity() } -> std::convertible_to<int>;
  { e.timestamp() } -> std::convertible_to<Timestamp>;
  requires std::integral<std::remove_cvref_t<decltype(e.timestamp())>>;
}
struct EventTraits<E> {
  static constexpr int x(const E& e) noexcept { return static_cast<int>(e.x()); }
  static constexpr int y(const E& e) noexcept { return static_cast<int>(e.y()); }
  static constexpr bool on(const E& e) noexcept { return static_cast<int>(e.polarity()) > 0; }
  static constexpr Timestamp t(const E& e) noexcept { return static_cast<Timestamp>(e.timestamp()); }
};

/// A type that the library can read as an event.
template <typename E>
concept EventLike = requires(const E& e) {
  { EventTraits<E>::x(e) } -> std::same_as<int>;
  { EventTraits<E>::y(e) } -> std::same_as<int>;
  { EventTraits<E>::on(e) } -> std::same_as<bool>;
  { EventTraits<E>::t(e) } -> std::same_as<Timestamp>;
};

/// Converts any event-like type to `Event`. A coordinate that 16 bits cannot hold becomes 65535, which is off every
/// sensor, so that trackers discard the event and count it.
template <EventLike E>
constexpr Event to_event(const E& e) noexcept {
  if constexpr (std::same_as<E, Event>) {
    return e;
  } else {
    const auto coordinate = [](int v) { return static_cast<std::uint16_t>(v < 0 || v > 0xFFFF ? 0xFFFF : v); };
    using Traits = EventTraits<E>;
    return {coordinate(Traits::x(e)), coordinate(Traits::y(e)), static_cast<std::int16_t>(Traits::on(e) ? 1 : 0),
            Traits::t(e)};
  }
}

}  // namespace evmarker
