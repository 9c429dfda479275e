#pragma once
// A group of events with one array for each component, for loops that the compiler vectorises.
#include <array>
#include <cstddef>

#include "evmarker/base/vector.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/simd/lanes.hpp"

namespace evmarker {

/// A group of events: lines of sight (x, y; 1), times and polarities. Eight more lines of sight, which mean nothing,
/// follow the last one, so that eight may be read from any event on.
class EventGroup {
 public:
  static constexpr std::size_t kMost = 8 * simd::kLanes;  ///< events
  template <typename Number>
  using Numbers = std::array<Number, kMost + simd::kLanes>;

  // The arrays are not initialised: that would take a fifth as long as the matching.
  EventGroup() noexcept {}

  /// Replaces the group by `count` events, at most kMost. `event(i)` returns the line of sight, the time [us] and the
  /// polarity (1 ON, -1 OFF, 0 unknown) of event i, counted from 0.
  template <typename EventOf>
  [[gnu::always_inline]] void fill(std::size_t count, const EventOf& event) noexcept {
    count_ = count;
    for (std::size_t i = 0; i < count; ++i) {
      const auto& [m, time, sign] = event(i);
      const Vec2 line = m;
      x[i] = line.x;
      y[i] = line.y;
      t[i] = time;
      polarity[i] = sign;
    }
    for (std::size_t i = count; i < count + simd::kLanes; ++i) x[i] = y[i] = 0;
  }

  std::size_t count() const noexcept { return count_; }

  alignas(64) Numbers<double> x, y;
  Numbers<Timestamp> t;
  Numbers<double> polarity;

 private:
  std::size_t count_ = 0;
};

}  // namespace evmarker
