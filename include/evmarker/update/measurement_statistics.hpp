#pragma once
// How far the events of a filter lie from their edges, and how they see the pose: running means.
#include <cmath>

namespace evmarker {

/// Sums over the events since the last update, and their running means.
class MeasurementStatistics {
 public:
  /// What is summed over events.
  struct Sums {
    double residual2 = 0;  ///< squared residuals [px^2]
    double lever2 = 0;     ///< |E - T| squared [m^2]
    double gradient2 = 0;  ///< of the place of E's image along the normal, squared [px^2/m^2]
    double since_us = 0;   ///< times after the last update [us]
  };

  /// The running means extend over 1000 events (of the squared residuals) and 100 events (of lever arm and gradient).
  void set_events_per_update(int events) noexcept {
    spread_share_ = 1 - std::pow(0.999, events);
    share_ = 1 - std::pow(0.99, events);
  }

  [[gnu::always_inline]] void add(const Sums& of_events) noexcept {
    sums_.residual2 += of_events.residual2;
    sums_.lever2 += of_events.lever2;
    sums_.gradient2 += of_events.gradient2;
    sums_.since_us += of_events.since_us;
  }
  void clear() noexcept { sums_ = {}; }
  const Sums& sums() const noexcept { return sums_; }

  /// Carries the sums over `count` events into the means.
  void update_means(int count) noexcept {
    const double share = known_ ? share_ : 1;
    spread_px2_ += spread_share_ * (sums_.residual2 / count - spread_px2_);
    lever2_ += share * (sums_.lever2 / count - lever2_);
    gradient2_ += share * (sums_.gradient2 / count - gradient2_);
    known_ = true;
  }

  /// Mean squared residual [px^2]; 1 at first.
  double spread_px2() const noexcept { return spread_px2_; }
  /// Mean |E - T| squared [m^2]; 0 at first.
  double lever2() const noexcept { return lever2_; }
  /// Mean squared gradient [px^2/m^2]; 0 at first.
  double gradient2() const noexcept { return gradient2_; }
  /// True once there has been an update.
  bool known() const noexcept { return known_; }
  /// Weight of an update in the means of lever arm and gradient.
  double share() const noexcept { return share_; }

 private:
  Sums sums_;
  double spread_px2_ = 1, lever2_ = 0, gradient2_ = 0;
  bool known_ = false;
  double spread_share_ = 0, share_ = 0;  // weight of the next update in the running means
};

}  // namespace evmarker
