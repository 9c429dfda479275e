#pragma once
// The noise of the motion: how much acceleration a filter has to expect.
#include <algorithm>
#include <array>
#include <cmath>

#include "evmarker/base/vector.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/motion_noise.hpp"

namespace evmarker {

/// How fast a motion moves the edges of a marker [m/s].
struct EdgeSpeed {
  double by_rotation = 0, all = 0;

  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]
  static EdgeSpeed of(const Vec6& twist, double lever2) noexcept {
    const double by_rotation = std::sqrt(lever2 * squared_norm(twist.r));
    return {by_rotation, norm(twist.t) + by_rotation};
  }
};

/// White acceleration of a motion, by its speed, see KalmanSettings, and as far as it shows, see MotionNoise.
class ProcessNoise {
 public:
  explicit ProcessNoise(const KalmanSettings& settings)
      : at_rest_(settings.acceleration_noise),
        turning_distance_m_(settings.turning_distance_m),
        rotation_share_(settings.rotation_share) {}

  /// Adds a correction of the velocity [m/s, rad/s].
  /// @param dt since the correction before [s]
  /// @param px_per_s speed of the edges
  void add(const Vec6& correction, double dt, double px_per_s) noexcept {
    learned_.add(correction, dt, averaging_time(px_per_s));
  }

  /// Density of the acceleration along each axis [m^2/s^3, rad^2/s^3].
  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]
  std::array<double, 6> density(const EdgeSpeed& speed, double lever2) const noexcept {
    const double of_edges = at_rest_ + of_turning(speed.all);
    const double by_rotation = rotation_share_ * of_edges + of_turning(speed.by_rotation);
    const double translation = learned_.translation(of_edges);
    const double rotation = learned_.rotation(by_rotation / std::max(lever2, kSmallestLever2));
    return {translation, translation, translation, rotation, rotation, rotation};
  }

  static constexpr double kSmallestLever2 = 1e-8;  ///< [m^2]

 private:
  // Time over which MotionNoise averages [s]. While an edge passes over a pixel, its events lie first on one side of it
  // and then on the other: over the way of a few pixels that cancels. A hand keeps an acceleration no longer than
  // kLongest_s.
  static double averaging_time(double px_per_s) noexcept {
    constexpr double kWay_px = 4, kLongest_s = 0.05;
    return kWay_px / std::max(px_per_s, kWay_px / kLongest_s);
  }

  // Of a motion that changes its velocity within `turning_distance_m` [m^2/s^3].
  double of_turning(double speed) const noexcept { return speed * speed * speed / turning_distance_m_; }

  double at_rest_, turning_distance_m_, rotation_share_;
  MotionNoise learned_;
};

}  // namespace evmarker
