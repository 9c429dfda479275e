#pragma once
// Which of two poses that look alike explains the events better.
#include <cmath>

namespace evmarker {

/// Adds up how much nearer each event lies to the edges of the first pose than to those of the second, and how much
/// such sums vary. Events of one passage are alike, so that sums of many are taken for independent.
class PoseComparison {
 public:
  /// @param misfit_px2, other_px2 squared distances of one event to the edges of both poses; if alike, they say nothing
  void add(double misfit_px2, double other_px2) noexcept {
    if (misfit_px2 == other_px2) return;
    group_ += other_px2 - misfit_px2;
    if (++events_ % kTogether != 0) return;
    sum_ += group_;
    variance_ += group_ * group_;
    group_ = 0;
  }

  int events() const noexcept { return events_; }

  /// By how many standard deviations the first pose is the better one; 0 while the events are too few to say.
  double z() const noexcept { return events_ >= kFewest ? sum_ / std::sqrt(variance_ + kSmallest) : 0; }

 private:
  static constexpr int kTogether = 64, kFewest = 16 * kTogether;
  static constexpr double kSmallest = 1e-12;

  int events_ = 0;
  double group_ = 0, sum_ = 0, variance_ = 0;
};

}  // namespace evmarker
