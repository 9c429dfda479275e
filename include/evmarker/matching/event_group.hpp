#pragma once
// Some events as one array for each component, for loops that become vector instructions.
#include <array>
#include <cstddef>

#include "evmarker/base/vector.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/simd/lanes.hpp"

namespace evmarker {

/// Some events by their lines of sight (x, y; 1), times and polarities, followed by ones that mean nothing: whole lanes
/// may be read from any of them on.
class EventGroup {
 public:
  static constexpr std::size_t kMost = 8 * simd::kLanes;
  template <typename Number>
  using Numbers = std::array<Number, kMost + simd::kLanes>;

  // Not initialised: that would take as long as a fifth of the matching.
  EventGroup() noexcept {}

  /// Takes `count` events, the first of them with number 0. `event(i)` is the line of sight, the time and the polarity
  /// (1 ON, -1 OFF, 0 unknown) of one.
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
