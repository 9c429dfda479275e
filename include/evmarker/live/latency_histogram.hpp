#pragma once
// A histogram of durations, with percentiles at any time.
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace evmarker::live {

/// Percentiles of durations [us], each at most 4 %, or 1 ns, too high; all 0 if there were no durations.
struct Latency {
  std::uint64_t count = 0;  ///< number of durations
  double p50_us = 0;
  double p90_us = 0;
  double p99_us = 0;
  double max_us = 0;  ///< exact
};

/// Counts durations from 1 ns to hours, in 32 bins of equal width per octave. One thread adds while any may read.
class LatencyHistogram {
 public:
  static constexpr int kBinsPerOctave = 32;  // an octave reaches from a power of two to the next [ns]
  static constexpr std::size_t kBins = 43 * kBinsPerOctave;

  void add(std::chrono::nanoseconds duration) noexcept {
    const auto ns = static_cast<std::uint64_t>(std::max<std::int64_t>(duration.count(), 0));
    bins_[bin_of(ns)].fetch_add(1, std::memory_order_relaxed);
    if (ns > max_ns_.load(std::memory_order_relaxed)) max_ns_.store(ns, std::memory_order_relaxed);
  }

  void clear() noexcept {
    for (auto& bin : bins_) bin.store(0, std::memory_order_relaxed);
    max_ns_.store(0, std::memory_order_relaxed);
  }

  Latency summary() const noexcept {
    Latency latency;
    for (std::size_t i = 0; i < kBins; ++i) latency.count += count(i);
    latency.max_us = static_cast<double>(max_ns_.load(std::memory_order_relaxed)) * 1e-3;
    latency.p50_us = percentile_us(0.50, latency);
    latency.p90_us = percentile_us(0.90, latency);
    latency.p99_us = percentile_us(0.99, latency);
    return latency;
  }

  /// How many durations were between `low` and `high` [us], to the width of a bin.
  std::uint64_t between_us(double low, double high) const noexcept {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < kBins; ++i)
      if (upper_us(i) > low && upper_us(i) <= high) sum += count(i);
    return sum;
  }

 private:
  static std::size_t bin_of(std::uint64_t ns) noexcept {
    if (ns < kBinsPerOctave) return static_cast<std::size_t>(ns);
    const int shift = static_cast<int>(std::bit_width(ns)) - static_cast<int>(std::bit_width(unsigned{kBinsPerOctave}));
    const std::uint64_t place = static_cast<std::uint64_t>(shift) * kBinsPerOctave + (ns >> shift);
    return static_cast<std::size_t>(std::min<std::uint64_t>(place, kBins - 1));
  }

  // The upper limit of a bin [us].
  static double upper_us(std::size_t bin) noexcept {
    if (bin < kBinsPerOctave) return static_cast<double>(bin + 1) * 1e-3;
    const auto shift = static_cast<int>(bin / kBinsPerOctave) - 1;
    return std::ldexp(static_cast<double>(bin % kBinsPerOctave + kBinsPerOctave + 1), shift) * 1e-3;
  }

  std::uint64_t count(std::size_t bin) const noexcept { return bins_[bin].load(std::memory_order_relaxed); }

  double percentile_us(double share, const Latency& latency) const noexcept {
    const auto rank = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(latency.count)));
    std::uint64_t below = 0;
    for (std::size_t i = 0; i < kBins; ++i)
      if (const auto here = count(i); here > 0 && (below += here) >= rank) return std::min(upper_us(i), latency.max_us);
    return 0;
  }

  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<std::uint64_t> max_ns_{0};
};

}  // namespace evmarker::live
