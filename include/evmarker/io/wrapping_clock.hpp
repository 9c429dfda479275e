#pragma once
// Times of 32 bits, which wrap around, as times that do not.
#include <cstdint>

#include "evmarker/events/event.hpp"

namespace evmarker::io {

/// Extends 32-bit times to 64 bits: each lies within 2^31 us (35.8 minutes) of the one before it. So a garbled time
/// shifts no later one.
class WrappingClock {
 public:
  /// @param first_is_signed true if times below 0 may come first
  explicit WrappingClock(bool first_is_signed) : any_(first_is_signed) {}

  Timestamp unwrap(std::uint32_t t) noexcept {
    const auto step = static_cast<std::int32_t>(t - static_cast<std::uint32_t>(last_));
    last_ = any_ ? last_ + step : t;
    any_ = true;
    return last_;
  }

 private:
  bool any_;  // or the first is taken as it is
  Timestamp last_ = 0;
};

}  // namespace evmarker::io
