#pragma once
// The evidence that the events give for an edge, in every cell of an image region.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "evmarker/search/cell_region.hpp"
#include "evmarker/search/fading_counts.hpp"

namespace evmarker {

/// For every cell of a region, the log-likelihood ratio of "an edge of the wireframe passes here" to "this is any cell
/// of the region". It is computed from counts of events row by row, so that the work can be spread over many events.
///
/// A cell is active if it and its eight neighbours together have so many events that uniform background of the region's
/// mean rate would reach that number in only one cell in 200. The ratio compares the probability of a cell's distance
/// to the nearest active cell, if an edge is there, with the share of the region's cells that have this distance: with
/// noise or clutter everywhere, a short distance means little.
class EdgeEvidence {
 public:
  /// Distances are limited to this: an active cell that is farther away is not of this edge [cells].
  static constexpr int kFar = 6;
  static constexpr double kUnit = 16;     ///< stored evidence per nat
  static constexpr double kSilent = 0.5;  ///< assumed share of edges without events: hidden, or moving along themselves

  /// @param cells largest number of cells of a region
  explicit EdgeEvidence(std::size_t cells) : counts_(cells), distances_(cells), evidence_(cells) {}

  /// Starts the computation for a region; `step` does it.
  /// @param scale which time scale of the `FadingCounts` to use
  /// @param total count of the events in all cells of the region at that scale
  void start(const CellRegion& region, int scale, double total) noexcept {
    region_ = region;
    scale_ = scale;
    least_active_count_ = static_cast<float>(least_active_count(9 * total / std::max(1, region.cells_on_sensor())));
    histogram_.fill(1);
    pass_ = row_ = 0;
  }

  /// Computes a row of one of four passes.
  /// @param counts of the region's cells
  /// @return true when all passes are complete
  bool step(const FadingCounts& counts) noexcept {
    switch (pass_) {
      case 0: copy_counts(counts, row_); break;
      case 1: measure_distances_down(row_); break;
      case 2: measure_distances_up(region_.height - 1 - row_); break;
      default: write_evidence(row_);
    }
    if (++row_ < region_.height) return false;
    row_ = 0;
    if (++pass_ == 3) compute_evidence_of_distances();
    return pass_ > 3;
  }

  /// Evidence of a cell [1 / kUnit nat]; 0 off the sensor. It is valid once `step` has returned true.
  std::int8_t operator[](std::size_t cell) const noexcept { return evidence_[cell]; }

 private:
  static constexpr int kStraight = 3, kDiagonal = 4, kFarthest = kFar * kStraight;  // steps of the chamfer distance

  std::size_t index(int x, int y) const noexcept { return static_cast<std::size_t>(y * region_.width + x); }

  // The least fading count that background of a mean count reaches in at most one cell in 200. Exponentially weighted
  // counts have a variance of half their mean, like half of a Poisson variable of twice the mean, whose quantile is
  // taken.
  static double least_active_count(double mean) noexcept {
    constexpr double kShare = 1.0 / 200, kDeviations = 2.58;  // the same quantile of the normal distribution
    const double m = 2 * mean;
    if (m > 50) return 0.5 * (m + kDeviations * std::sqrt(m)) + 0.5;
    double exactly = std::exp(-m), reached = 1 - exactly;  // probabilities of n - 1, and of n or more
    int n = 1;
    for (; reached > kShare && n < 200; ++n) {
      exactly *= m / n;
      reached -= exactly;
    }
    return 0.5 * n;
  }

  void copy_counts(const FadingCounts& counts, int y) noexcept {
    for (int x = 0; x < region_.width; ++x) counts_[index(x, y)] = counts.count(index(x, y), scale_);
  }

  // Sum of the counts of a cell and its neighbours.
  float count_with_neighbours(int x, int y) const noexcept {
    float sum = 0;
    for (int v = std::max(0, y - 1); v <= std::min(region_.height - 1, y + 1); ++v)
      for (int u = std::max(0, x - 1); u <= std::min(region_.width - 1, x + 1); ++u) sum += counts_[index(u, v)];
    return sum;
  }

  // Shortens a distance if the way over the neighbouring cell (x, y) is shorter.
  void shorten(int& distance, int x, int y, int step) const noexcept {
    if (x >= 0 && x < region_.width && y >= 0 && y < region_.height)
      distance = std::min(distance, distances_[index(x, y)] + step);
  }

  // The chamfer distance transform's first pass, from the top left: distances to active cells above and to the left.
  void measure_distances_down(int y) noexcept {
    for (int x = 0; x < region_.width; ++x) {
      int distance = kFarthest;
      if (count_with_neighbours(x, y) >= least_active_count_) distance = 0;
      shorten(distance, x - 1, y, kStraight);
      shorten(distance, x, y - 1, kStraight);
      shorten(distance, x - 1, y - 1, kDiagonal);
      shorten(distance, x + 1, y - 1, kDiagonal);
      distances_[index(x, y)] = static_cast<std::uint8_t>(distance);
    }
  }

  // Its second pass, from the bottom right, which completes the distances and enters them into the histogram.
  void measure_distances_up(int y) noexcept {
    for (int x = region_.width - 1; x >= 0; --x) {
      int distance = distances_[index(x, y)];
      shorten(distance, x + 1, y, kStraight);
      shorten(distance, x, y + 1, kStraight);
      shorten(distance, x + 1, y + 1, kDiagonal);
      shorten(distance, x - 1, y + 1, kDiagonal);
      distances_[index(x, y)] = static_cast<std::uint8_t>(distance);
      if (region_.on_sensor(x, y)) ++histogram_[static_cast<std::size_t>((distance + 1) / kStraight)];
    }
  }

  // Tabulates the evidence of every distance. At an edge that makes events, the probability of a distance falls
  // exponentially, by a factor of e per cell; at one that makes none, every distance is as frequent as in the region.
  void compute_evidence_of_distances() noexcept {
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
      evidence_of_distance_[static_cast<std::size_t>(d)] =
          static_cast<std::int8_t>(std::clamp(std::round(value), -127.0, 127.0));
    }
  }

  void write_evidence(int y) noexcept {
    for (int x = 0; x < region_.width; ++x)
      evidence_[index(x, y)] =
          region_.on_sensor(x, y) ? evidence_of_distance_[distances_[index(x, y)]] : std::int8_t{0};
  }

  std::vector<float> counts_;
  std::vector<std::uint8_t> distances_;  // to the nearest active cell [1 / kStraight cells]
  std::vector<std::int8_t> evidence_;
  std::array<double, kFar + 1> histogram_{};  // of the distances [whole cells] on the sensor, each 1 at first
  std::array<std::int8_t, kFarthest + 1> evidence_of_distance_{};  // by distance [1 / kStraight cells]
  CellRegion region_;
  int scale_ = 0, pass_ = 0, row_ = 0;
  float least_active_count_ = 0;
};

}  // namespace evmarker
