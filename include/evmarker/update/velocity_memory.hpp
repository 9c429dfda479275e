#pragma once
// How long a filter keeps its velocity: long while the events confirm the motion that it predicts.
#include <algorithm>
#include <cmath>

namespace evmarker {

/// Compares the number of events with the number that edges of the filter's velocity should make. As long as they
/// agree, the motion goes on, and the velocity holds until events say otherwise; with too few events, the marker has
/// stopped or the velocity was never right. To let a velocity fade that is right is to brake the marker in the model:
/// the pose then lags behind in steady motion.
class VelocityMemory {
 public:
  /// Adds the speed of an event's edge along its normal [px/s]. Not every event need be added, only a fair sample.
  void add_speed(double px_per_s) noexcept {
    speeds_px_s_ += std::abs(px_per_s);
    ++samples_;
  }

  /// Adds the events of an update.
  /// @param events_per_px that all edges together make while they move by a pixel
  /// @param dt since the last update [s]
  /// @param share weight of this update in the running means
  void add(int events, double events_per_px, double dt, double share) noexcept {
    if (samples_ > 0) px_per_s_ += kSpeedShare * (speeds_px_s_ / samples_ - px_per_s_);
    speeds_px_s_ = samples_ = 0;
    events_ += share * (events - events_);
    expected_ += share * (events_per_px * px_per_s_ * dt - expected_);
    if (!std::isfinite(expected_)) *this = {};
  }

  /// Time constant with which the velocity fades [s].
  /// @param shortest,longest for a velocity that nothing confirms, and for one that everything does
  /// @param velocity2,variance of the velocity, squared, and its variance, in equal units: below its own standard
  /// deviation, a velocity is not known
  double time_constant(double shortest, double longest, double velocity2, double variance) const noexcept {
    const double ratio = expected_ > 0 ? events_ / expected_ : 0;
    const double confirmed = std::clamp((ratio - kTooFew) / (kEnough - kTooFew), 0.0, 1.0);
    const double trust = confirmed * velocity2 / (velocity2 + variance);
    return trust > 0 ? 1 / std::lerp(1 / shortest, 1 / longest, trust) : shortest;
  }

 private:
  static constexpr double kSpeedShare = 0.1;  // of an update in the mean speed
  // Shares of the expected events. In steady motion there are 0.6 to 1.1 times as many as expected: fewer while edges
  // are hidden or move along themselves.
  static constexpr double kTooFew = 0.4, kEnough = 0.7;

  double speeds_px_s_ = 0, samples_ = 0;  // sum and number of the speeds since the last update
  double px_per_s_ = 0;                   // running mean of the speeds
  double events_ = 0, expected_ = 0;      // running means by update
};

}  // namespace evmarker
