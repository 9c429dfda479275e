#pragma once
// The times from one event to the next: the longest, and how many are longer than others.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <evmarker/events/event.hpp>
#include <numeric>

/// Counts intervals by their length, as which of them are gaps is known only at the end of a recording.
class EventGaps {
 public:
  void add(evmarker::Timestamp from, evmarker::Timestamp to) {
    if (to <= from) return;
    const std::uint64_t interval = evmarker::elapsed_us(from, to);
    ++counts_[bin_of(static_cast<double>(interval))];
    if (interval <= longest_us_) return;
    longest_us_ = interval;
    longest_from_ = from;
  }

  std::uint64_t longest_us() const { return longest_us_; }
  evmarker::Timestamp longest_from() const { return longest_from_; }

  /// Number of intervals of `us` or more, a length that is taken to 1 %.
  std::uint64_t count_from(double us) const {
    return std::accumulate(counts_.begin() + static_cast<std::ptrdiff_t>(bin_of(us)), counts_.end(), std::uint64_t{0});
  }

 private:
  static constexpr std::size_t kPerOctave = 64, kBins = 64 * kPerOctave + 1;

  static std::size_t bin_of(double us) {
    return std::min(kBins - 1, static_cast<std::size_t>(kPerOctave * std::log2(std::max(us, 1.0))));
  }

  std::array<std::uint64_t, kBins> counts_{};
  std::uint64_t longest_us_ = 0;
  evmarker::Timestamp longest_from_ = 0;
};
