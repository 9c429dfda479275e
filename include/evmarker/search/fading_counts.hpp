#pragma once
// How many events every cell of an image region had lately, at several time scales at once.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Counts of events that fade exponentially, each event at the price of one cell. A time scale for every speed: an edge
/// has passed by a pixel or two within one of them, be it at a thousand pixels a second or at two.
class FadingCounts {
 public:
  static constexpr int kScales = 6;

  /// Time constant of a scale [us]: 1 ms to 1 s.
  static constexpr double time_constant_us(int scale) noexcept { return 1000.0 * static_cast<double>(1 << 2 * scale); }

  explicit FadingCounts(std::size_t cells) : cells_(cells) {}

  /// Forgets all events, in constant time.
  void restart() noexcept {
    ++generation_;
    totals_.fill(0);
  }

  /// Adds an event. One from before the last one counts as of now; a clock that was set back starts anew.
  void add(std::size_t cell, Timestamp t) noexcept {
    constexpr Timestamp kDisorder_us = 1'000'000;
    if (t < now_ && elapsed_us(t, now_) > kDisorder_us) restart();
    if (t > now_ || elapsed_us(t, now_) > kDisorder_us) {
      fade(totals_, static_cast<double>(elapsed_us(now_, t)));
      now_ = t;
    }
    for (double& total : totals_) ++total;
    Cell& c = cells_[cell];
    if (c.generation != generation_) {
      c.counts.fill(0);
      c.generation = generation_;
    } else {
      fade(c.counts, age_us(c));
    }
    c.t = static_cast<std::uint32_t>(now_);
    for (float& count : c.counts) ++count;
  }

  /// Events of a cell, as of the last event.
  float count(std::size_t cell, int scale) const noexcept {
    const Cell& c = cells_[cell];
    if (c.generation != generation_) return 0;
    const double ages = age_us(c) / time_constant_us(scale);
    return ages < kForgotten ? c.counts[static_cast<std::size_t>(scale)] * static_cast<float>(std::exp(-ages)) : 0.0f;
  }

  /// Events of all cells, as of the last event.
  double total(int scale) const noexcept { return totals_[static_cast<std::size_t>(scale)]; }

 private:
  static constexpr double kForgotten = 20;  // time constants

  struct Cell {
    std::uint32_t t = 0;  // low bits of its last event's time
    std::uint32_t generation = 0;
    std::array<float, kScales> counts{};
  };

  // Each scale is four times as long as the one before: one exponential does for all.
  template <typename Counts>
  static void fade(Counts& counts, double us) noexcept {
    if (us == 0) return;
    double factor = std::exp(-std::min(us / time_constant_us(kScales - 1), kForgotten));
    for (int scale = kScales - 1; scale >= 0; --scale) {
      auto& count = counts[static_cast<std::size_t>(scale)];
      count *= static_cast<std::remove_reference_t<decltype(count)>>(factor > 1e-9 ? factor : 0);
      factor *= factor;
      factor *= factor;
    }
  }

  double age_us(const Cell& c) const noexcept { return static_cast<std::uint32_t>(now_) - c.t; }

  std::vector<Cell> cells_;
  std::array<double, kScales> totals_{};
  Timestamp now_ = 0;
  std::uint32_t generation_ = 1;
};

}  // namespace evmarker
