#pragma once
// A lower bound on how many events a sensor makes without a cause: if it makes fewer, it has failed.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Measures the least rate of noise events of a whole sensor, to tell an outage from a rest: where all motion stops,
/// the noise goes on; where the sensor or its transmission fails, nothing comes.
///
/// The events counted are those that no neighbour supports, see SpatiotemporalFilter: nearly all noise, but also the
/// first ones of edges. So the sensor counts as noisy as its quietest tile, in the quietest of the recent times: a
/// measured rate that is lower is believed at once, one that is higher step by step. A tile without such events, as
/// that of a sensor without noise, or outside of a region of interest, makes the bound 0.
class NoiseFloor {
 public:
  explicit NoiseFloor(SensorSize size) noexcept
      : tiles_per_px_x_(kTilesAcross * kOne / static_cast<std::uint32_t>(size.width)),
        tiles_per_px_y_(kTilesAcross * kOne / static_cast<std::uint32_t>(size.height)) {}

  /// Adds an event that no neighbour supports; it must lie on the sensor.
  void add(const Event& event) noexcept {
    ++events_[event.y * tiles_per_px_y_ / kOne * kTilesAcross + event.x * tiles_per_px_x_ / kOne];
    if (++added_ % kBetweenChecks == 0) [[unlikely]]
      check(event.t);
  }

  /// How many noise events are due, at least, from one time to a later one [us], where events came until the first.
  double expected_events(Timestamp from, Timestamp to) const noexcept {
    const double present = from > since_ ? rate(events_of_quietest() + kEnough, elapsed_us(since_, from)) : 0;
    return std::min(events_per_us_, present) * static_cast<double>(elapsed_us(from, to));
  }

 private:
  static constexpr std::uint32_t kTilesAcross = 8, kOne = 1u << 16U;  // fixed point
  static constexpr std::uint64_t kBetweenChecks = 256;                // events added
  static constexpr std::uint64_t kEnough = 16;  // events of the quietest tile: its rate is known to a quarter
  static constexpr double kMostGrowth = 1.1;    // of the bound, from one measurement to the next

  // Of the whole sensor, if all tiles had `events` in that time [1/us].
  static double rate(std::uint64_t events, std::uint64_t us) noexcept {
    return static_cast<double>(events * kTilesAcross * kTilesAcross) / static_cast<double>(us);
  }
  std::uint64_t events_of_quietest() const noexcept { return *std::ranges::min_element(events_); }

  // Ends a measurement once there are enough events in every tile. The first one begins with the first check.
  [[gnu::noinline]] void check(Timestamp t) noexcept {
    const bool first = added_ == kBetweenChecks, stepped_back = t < since_;
    if (!first && !stepped_back) {
      if (events_of_quietest() < kEnough || t == since_) return;
      const double measured = rate(events_of_quietest(), elapsed_us(since_, t));
      events_per_us_ = events_per_us_ > 0 ? std::min(measured, kMostGrowth * events_per_us_) : measured;
    }
    events_.fill(0);
    since_ = t;
  }

  std::uint32_t tiles_per_px_x_, tiles_per_px_y_;
  std::array<std::uint64_t, kTilesAcross * kTilesAcross> events_{};  // of each tile, since then:
  Timestamp since_ = 0;                                              // [us]
  std::uint64_t added_ = 0;
  double events_per_us_ = 0;
};

}  // namespace evmarker
