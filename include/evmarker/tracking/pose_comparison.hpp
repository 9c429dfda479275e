#pragma once
// Compares which of two similar-looking poses explains the events better.
#include <cmath>
#include <numbers>

namespace evmarker {

/// Sums how much nearer each event lies to the edges of the first pose than to those of the second, and the variance of
/// this sum. Events of one passage of an edge err together; sums of 64 events are assumed to be independent.
class PoseComparison {
 public:
  /// Adds one event.
  /// @param squared_residual_px2,other_px2 its squared distances to the edges of the first and of the second pose; an
  /// event with equal distances does not count
  void add(double squared_residual_px2, double other_px2) noexcept {
    if (squared_residual_px2 == other_px2) return;
    group_ += other_px2 - squared_residual_px2;
    if (++events_ % kTogether != 0) return;
    sum_ += group_;
    variance_ += group_ * group_;
    group_ = 0;
  }

  /// How many events count.
  int events() const noexcept { return events_; }

  /// By how many standard deviations the first pose is better; 0 while there are too few events.
  double z() const noexcept { return events_ >= kFewest ? sum_ / std::sqrt(variance_ + kSmallest) : 0; }
  /// True once the difference is beyond chance.
  bool decided() const noexcept { return std::abs(z()) > kBeyondChance; }
  /// Probability that the second pose is the right one.
  double probability_of_second() const noexcept { return std::erfc(z() / std::numbers::sqrt2) / 2; }

 private:
  static constexpr double kBeyondChance = 4;  // standard deviations
  static constexpr int kTogether = 64, kFewest = 16 * kTogether;
  static constexpr double kSmallest = 1e-12;

  int events_ = 0;
  double group_ = 0, sum_ = 0, variance_ = 0;
};

}  // namespace evmarker
