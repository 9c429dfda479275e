#pragma once
// How much white acceleration a motion needs, learned from the corrections of its velocity.
#include <algorithm>
#include <cmath>

#include "evmarker/base/vector.hpp"

namespace evmarker {

/// Adapts the process noise of a filter with a velocity: an acceleration of the marker makes the corrections of the
/// velocity point in one direction, while those made by the noise of the events cancel. A calm motion then averages
/// over many events, and a sudden one is followed as if nothing were known.
class MotionNoise {
 public:
  /// Adds a correction of the velocity [m/s, rad/s].
  /// @param dt since the correction before [s]
  /// @param window_s time to average over [s]: long enough for the noise of the events to cancel
  void add(const Vec6& correction, double dt, double window_s) noexcept {
    acceleration_ = window_s / (window_s + dt) * (acceleration_ + 1 / window_s * correction);
    if (!(dt < window_s) || !std::isfinite(squared_norm(acceleration_))) return void(*this = {});
    window_s_ = window_s;
    known_s_ += dt;
  }

  /// Density of the white acceleration along each axis [m^2/s^3].
  /// @param usual upper limit; also the result where nothing is known: at first, and after a pause longer than the
  /// window
  double translation(double usual) const noexcept { return adapted(usual, squared_norm(acceleration_.t)); }
  /// The same for rotation [rad^2/s^3].
  double rotation(double usual) const noexcept { return adapted(usual, squared_norm(acceleration_.r)); }

 private:
  // The density of white acceleration is kGain * window * (mean acceleration)^2. Chosen on seed 9101 of nine scenarios
  // of the accuracy benchmark, where 10 to 30 make little difference.
  static constexpr double kGain = 20;
  // Of the usual noise, the lower limit; the usual one itself is the upper: a larger gain makes larger corrections, and
  // these would raise the noise again.
  static constexpr double kLeast = 0.05;
  static constexpr double kWindowsToLearn = 3;

  double adapted(double usual, double acceleration2) const noexcept {
    const double least = known_s_ < kWindowsToLearn * window_s_ ? 1 : kLeast;
    return std::clamp(kGain * window_s_ * acceleration2, least * usual, usual);
  }

  Vec6 acceleration_;  // the corrections of about the last window_s_, by time
  double window_s_ = 1, known_s_ = 0;
};

}  // namespace evmarker
