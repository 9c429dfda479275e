#pragma once
// Times since the first event of a recording.
#include <cstdint>
#include <optional>
#include <string>

#include "evmarker/events/event.hpp"

namespace evmarker::io {

/// Subtracts the first time that it is given from all, if that is wanted.
class TimeShift {
 public:
  explicit TimeShift(bool wanted) : wanted_(wanted) {}

  bool wanted() const noexcept { return wanted_; }
  /// The time since the first; nothing where that does not fit into 63 bits.
  std::optional<Timestamp> operator()(Timestamp t) {
    if (!wanted_) return t;
    if (!first_) first_ = t;
    const auto since_first =
        static_cast<Timestamp>(static_cast<std::uint64_t>(t) - static_cast<std::uint64_t>(*first_));
    return (since_first < 0) == (t < *first_) ? std::optional(since_first) : std::nullopt;
  }
  /// What is wrong with a time for which there is nothing.
  std::string fault(Timestamp t) const {
    return "t is " + std::to_string(t) + " us, too far from the first time, " + std::to_string(first_.value_or(0)) +
           " us, to be shifted";
  }

 private:
  bool wanted_;
  std::optional<Timestamp> first_;
};

}  // namespace evmarker::io
