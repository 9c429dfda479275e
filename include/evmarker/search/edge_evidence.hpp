#pragma once
// For every cell of an image region, how much the events speak for an edge there.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "evmarker/search/cell_region.hpp"
#include "evmarker/search/fading_counts.hpp"

namespace evmarker {

/// Log-likelihood ratio of "an edge of the wireframe passes here" to "any place of the region", computed from counts of
/// events row by row, so that it can be spread over many events.
///
/// A cell holds an edge if it and its neighbours have more events than uniform background would give them in one of 200
/// cells; the background's rate is at most the region's mean. The evidence is the distance to the nearest such cell,
/// against how often that distance occurs in the region: with noise or clutter everywhere, a small one means little.
class EdgeEvidence {
 public:
  static constexpr int kFar = 6;          ///< [cells] farther is as bad: there is no event of this edge
  static constexpr double kUnit = 16;     ///< of the stored ratios, to one nat
  static constexpr double kSilent = 0.5;  ///< of the edges move along themselves, are hidden or have no contrast

  explicit EdgeEvidence(std::size_t cells) : counts_(cells), distances_(cells), evidence_(cells) {}

  /// Begins to compute for a region, of whose events in all its cells `total` count at a time scale.
  void start(const CellRegion& region, int scale, double total) noexcept {
    region_ = region;
    scale_ = scale;
    least_ = static_cast<float>(least_count(9 * total / std::max(1, region.cells_on_sensor())));
    histogram_.fill(1);
    pass_ = row_ = 0;
  }

  /// Computes a row of one of four passes. True when all is done.
  bool step(const FadingCounts& counts) noexcept {
    switch (pass_) {
      case 0: copy_counts(counts, row_); break;
      case 1: measure_down(row_); break;
      case 2: measure_up(region_.height - 1 - row_); break;
      default: weigh(row_);
    }
    if (++row_ < region_.height) return false;
    row_ = 0;
    if (++pass_ == 3) compare_with_region();
    return pass_ > 3;
  }

  /// In units of 1 / kUnit nat.
  std::int8_t operator[](std::size_t cell) const noexcept { return evidence_[cell]; }

 private:
  static constexpr int kStraight = 3, kDiagonal = 4, kFarthest = kFar * kStraight;  // chamfer

  std::size_t at(int x, int y) const noexcept { return static_cast<std::size_t>(y * region_.width + x); }

  // Exponentially weighted counts of mean m have variance m / 2: half of a Poisson variable of mean 2 m.
  static double least_count(double mean) noexcept {
    constexpr double kShare = 1.0 / 200, kDeviations = 2.58;
    const double m = 2 * mean;
    if (m > 50) return 0.5 * (m + kDeviations * std::sqrt(m)) + 0.5;
    double term = std::exp(-m), reached = 1 - term;  // probability of at least one
    int n = 1;
    for (; reached > kShare && n < 200; ++n) reached -= term *= m / n;
    return 0.5 * n;
  }

  void copy_counts(const FadingCounts& counts, int y) noexcept {
    for (int x = 0; x < region_.width; ++x) counts_[at(x, y)] = counts.count(at(x, y), scale_);
  }

  float around(int x, int y) const noexcept {
    float sum = 0;
    for (int v = std::max(0, y - 1); v <= std::min(region_.height - 1, y + 1); ++v)
      for (int u = std::max(0, x - 1); u <= std::min(region_.width - 1, x + 1); ++u) sum += counts_[at(u, v)];
    return sum;
  }

  void relax(int& distance, int x, int y, int step) const noexcept {
    if (x >= 0 && x < region_.width && y >= 0 && y < region_.height)
      distance = std::min(distance, distances_[at(x, y)] + step);
  }

  void measure_down(int y) noexcept {
    for (int x = 0; x < region_.width; ++x) {
      int distance = kFarthest;
      if (around(x, y) >= least_) distance = 0;
      relax(distance, x - 1, y, kStraight);
      relax(distance, x, y - 1, kStraight);
      relax(distance, x - 1, y - 1, kDiagonal);
      relax(distance, x + 1, y - 1, kDiagonal);
      distances_[at(x, y)] = static_cast<std::uint8_t>(distance);
    }
  }

  void measure_up(int y) noexcept {
    for (int x = region_.width - 1; x >= 0; --x) {
      int distance = distances_[at(x, y)];
      relax(distance, x + 1, y, kStraight);
      relax(distance, x, y + 1, kStraight);
      relax(distance, x + 1, y + 1, kDiagonal);
      relax(distance, x - 1, y + 1, kDiagonal);
      distances_[at(x, y)] = static_cast<std::uint8_t>(distance);
      if (region_.on_sensor(x, y)) ++histogram_[static_cast<std::size_t>((distance + 1) / kStraight)];
    }
  }

  // Edges that make events have them at a distance of a cell or so.
  void compare_with_region() noexcept {
    double cells = 0;
    for (const double n : histogram_) cells += n;
    std::array<double, kFar + 1> nats{};
    for (int d = 0; d <= kFar; ++d) {
      const double edge = std::exp(-d) * (d < kFar ? 1 - std::exp(-1.0) : 1);
      nats[static_cast<std::size_t>(d)] =
          std::log(kSilent + (1 - kSilent) * edge * cells / histogram_[static_cast<std::size_t>(d)]);
    }
    for (int d = 0; d <= kFarthest; ++d) {
      const auto whole = static_cast<std::size_t>(d / kStraight), next = std::min<std::size_t>(whole + 1, kFar);
      const double part = static_cast<double>(d % kStraight) / kStraight;
      const double value = kUnit * ((1 - part) * nats[whole] + part * nats[next]);
      of_distance_[static_cast<std::size_t>(d)] =
          static_cast<std::int8_t>(std::clamp(std::round(value), -127.0, 127.0));
    }
  }

  void weigh(int y) noexcept {
    for (int x = 0; x < region_.width; ++x)
      evidence_[at(x, y)] = region_.on_sensor(x, y) ? of_distance_[distances_[at(x, y)]] : std::int8_t{0};
  }

  std::vector<float> counts_;
  std::vector<std::uint8_t> distances_;  // to the nearest cell that holds an edge [1 / kStraight cells]
  std::vector<std::int8_t> evidence_;
  std::array<double, kFar + 1> histogram_{};  // of the distances on the sensor, in whole cells
  std::array<std::int8_t, kFarthest + 1> of_distance_{};
  CellRegion region_;
  int scale_ = 0, pass_ = 0, row_ = 0;
  float least_ = 0;
};

}  // namespace evmarker
