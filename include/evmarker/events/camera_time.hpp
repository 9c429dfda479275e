#pragma once
// How much camera time passes while events come, some of them in disorder.
#include <cstdint>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Adds up camera time from event to event. A step back by up to 1 s is disorder: neither it nor the way from there to
/// the latest time counts. After a longer one, as of a clock that was set back, time goes on from there.
class CameraTime {
 public:
  /// Moves on to an event's time.
  /// @return time since the latest event before it [us]; 0 for the first event
  std::uint64_t advance(Timestamp t) noexcept {
    constexpr std::uint64_t kDisorder_us = 1000000;
    const bool ahead = begun_ && t > latest_;
    const std::uint64_t passed_us = ahead ? elapsed_us(latest_, t) : 0;
    if (!begun_ || ahead || elapsed_us(t, latest_) > kDisorder_us) latest_ = t;
    begun_ = true;
    return passed_us;
  }

 private:
  bool begun_ = false;
  Timestamp latest_ = 0;
};

}  // namespace evmarker
