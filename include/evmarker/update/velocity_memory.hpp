#pragma once
// How long a filter keeps its velocity: long while the events confirm the motion that it predicts.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "evmarker/base/vector.hpp"

namespace evmarker {

/// Tells for each axis how fast the velocity fades. If a right velocity fades, the pose lags behind in steady motion,
/// most where motion hardly shows, as that toward the camera. If a wrong one is kept, noise moves the marker on, or a
/// marker that has stopped goes on. Either of two things confirms a velocity: there are as many events as edges of that
/// speed should make; or, axis by axis, the corrections by the measurements put back what has faded. Corrections of a
/// right velocity point in its own direction, those that noise makes in either. After a pause, in which the marker may
/// have stopped, the second counts less.
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
  /// @param share weight of this update in the running means; that of the speed uses kSpeedShare
  void add(int events, double events_per_px, double dt, double share) noexcept {
    if (samples_ > 0) px_per_s_ += kSpeedShare * (speeds_px_s_ / samples_ - px_per_s_);
    speeds_px_s_ = samples_ = 0;
    events_ += share * (events - events_);
    expected_ += share * (events_per_px * px_per_s_ * dt - expected_);
    const double usual_s = usual_s_ > 0 ? usual_s_ : dt, pause_s = kPause * usual_s;  // the first dt counts as usual
    trust_after_pause_ = dt > pause_s ? pause_s / dt : 1;
    usual_s_ = usual_s + share * (std::min(dt, pause_s) - usual_s);
    since_s_ += dt;
    if (!std::isfinite(expected_ + usual_s_)) *this = {};
  }

  /// Adds what a step did to the velocity.
  /// @param before,predicted velocity before the step, and faded but not corrected yet [m/s, rad/s]
  /// @param correction by the measurements
  void add_step(const Vec6& before, const Vec6& predicted, const Vec6& correction) noexcept {
    const std::array<double, 6> v = before.array(), lost = (before - predicted).array(), gained = correction.array();
    for (std::size_t k = 0; k < 6; ++k) {
      put_back_[k] += v[k] * gained[k];
      lost_[k] += v[k] * lost[k];
    }
  }

  /// True when so much time has passed that `update_fading` is worth its time.
  bool is_due() const noexcept { return since_s_ > kMemory_s / 64; }

  /// Rates at which the velocity fades along each axis [1/s]. Also lets what was lost and put back until now count less
  /// from now on.
  /// @param fastest,slowest for a velocity that nothing confirms, and for one that everything does
  /// @param velocity2,variance squared speed of the edges, and variance of their velocity, all axes together [m^2/s^2];
  /// a speed of just its own standard deviation counts half
  /// @param signal weight of the events (BackgroundShare): noise would confirm the small velocity that it makes itself
  std::array<double, 6> update_fading(double fastest, double slowest, double velocity2, double variance,
                                      double signal) noexcept {
    const double ratio = expected_ > 0 ? events_ / expected_ : 0;
    const double as_many = std::clamp((ratio - kTooFew) / (kEnough - kTooFew), 0.0, 1.0);
    const double known = as_many > 0 && velocity2 > 0 ? as_many * velocity2 / (velocity2 + variance) : 0;
    const double remembered = kMemory_s / (kMemory_s + std::exchange(since_s_, 0));
    std::array<double, 6> rates;
    for (std::size_t k = 0; k < 6; ++k) {
      put_back_[k] *= remembered;
      lost_[k] *= remembered;
      if (!std::isfinite(put_back_[k] + lost_[k])) put_back_[k] = lost_[k] = 0;
      const double put_back = put_back_[k] > 0 && lost_[k] > 0 ? std::min(1.0, put_back_[k] / lost_[k]) : 0;
      rates[k] = std::lerp(fastest, slowest, signal * std::max(known, trust_after_pause_ * put_back));
    }
    return rates;
  }

 private:
  static constexpr double kSpeedShare = 0.1;  // of an update in the mean speed
  // Shares of the expected events. In steady motion there are 0.6 to 1.1 times as many as expected: fewer while edges
  // are hidden or move along themselves.
  static constexpr double kTooFew = 0.4, kEnough = 0.7;
  static constexpr double kPause = 4;  // usual updates: in a longer one, the marker may have stopped
  // Time over which what fades and what is put back are compared: a marker that stops is noticed within it.
  static constexpr double kMemory_s = 0.05;

  double speeds_px_s_ = 0, samples_ = 0;       // sum and number of the speeds since the last update
  double px_per_s_ = 0;                        // running mean of the speeds
  double events_ = 0, expected_ = 0;           // running means by update
  double usual_s_ = 0;                         // running mean of the duration, a pause cut short; 0 at first
  double trust_after_pause_ = 1;               // 1 unless this update took much longer, then less
  double since_s_ = 0;                         // the rates were last asked for
  std::array<double, 6> put_back_{}, lost_{};  // fading sums by axis: velocity times what was put back, or was lost
};

}  // namespace evmarker
