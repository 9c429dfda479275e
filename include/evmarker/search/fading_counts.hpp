#pragma once
// Exponentially fading counts of the events in every cell of an image region, at several time scales.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Counts of events per cell that fade exponentially, at time constants from 1 ms to 1 s: whether an edge moves at 1000
/// px/s or at 2 px/s, it moves by a pixel or two within one of them. Adding an event touches only its own cell. Times
/// of cells are kept modulo 2^32 us: a cell that is silent for 71 minutes looks as if it just had its last event.
class FadingCounts {
 public:
  static constexpr int kScales = 6;

  /// Time constant of a scale [us]; 0 is the shortest scale, each is four times as long as the one before.
  static constexpr double time_constant_us(int scale) noexcept { return 1000.0 * static_cast<double>(1 << 2 * scale); }

  /// @param cells number of cells
  explicit FadingCounts(std::size_t cells) : cells_(cells) {}

  /// Forgets all events, in constant time.
  void restart() noexcept {
    ++generation_;
    totals_.fill(0);
  }

  /// Adds an event at time t [us]. One that is up to 1 s earlier than the latest event counts as simultaneous with it;
  /// one that is even earlier clears all counts, as the clock was set back.
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

  /// Count of a cell's events, faded to the time of the latest event of any cell.
  float count(std::size_t cell, int scale) const noexcept {
    const Cell& c = cells_[cell];
    if (c.generation != generation_) return 0;
    const double ages = age_us(c) / time_constant_us(scale);
    return ages < kForgotten ? c.counts[static_cast<std::size_t>(scale)] * static_cast<float>(std::exp(-ages)) : 0.0f;
  }

  /// Count of the events of all cells, faded to the time of the latest one.
  double total(int scale) const noexcept { return totals_[static_cast<std::size_t>(scale)]; }

 private:
  static constexpr double kForgotten = 20;  // time constants after which a count is 0

  struct Cell {
    std::uint32_t t = 0;           // low 32 bits of the time of its last event
    std::uint32_t generation = 0;  // its counts are void unless this equals generation_
    std::array<float, kScales> counts{};
  };

  // Fades the counts of all scales by a time. As each scale is four times as long as the one before, one exponential is
  // enough: the factor of the next shorter scale is its fourth power.
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

  // Time from a cell's last event to the latest event.
  double age_us(const Cell& c) const noexcept { return static_cast<std::uint32_t>(now_) - c.t; }

  std::vector<Cell> cells_;
  std::array<double, kScales> totals_{};
  Timestamp now_ = 0;  // time of the latest event
  std::uint32_t generation_ = 1;
};

}  // namespace evmarker
