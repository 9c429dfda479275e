#pragma once
// The Kalman filter's assumptions about motion and events.

#include "evmarker/base/require.hpp"

namespace evmarker {

/// Settings of `KalmanUpdate`: the noise of the motion and of the events.
struct KalmanSettings {
  /// Factor on the measured spread of the events about their edges, for the noise of a single event: the events that an
  /// edge makes at one pixel err together, so that each is worth less. The reported covariance has the noise that is
  /// measured in its place, see EdgeScatter::event_noise.
  double inflation = 1.8;
  /// Residuals beyond this count less and less (Cauchy weights); on a blurred sensor in proportion more, see EdgeBlur.
  double robust_px = 1;
  /// White acceleration of the marker's edges at rest [m^2/s^3]. In motion, speed^3 / turning_distance_m is added: a
  /// hand changes its velocity within a distance, not within a time, and the number of events grows with distance, too.
  /// This is what is assumed at first; then the noise is learned, see MotionNoise.
  double acceleration_noise = 2;
  double turning_distance_m = 0.02;
  /// Share of that noise with which rotation moves the edges: a hand rotates a marker less than it carries it. The
  /// noise that comes with the speed of the rotation itself is added.
  double rotation_share = 0.5;
  /// Time constants with which the velocity fades along an axis: where nothing confirms it, and where all does, see
  /// VelocityMemory. It fades somewhat faster while noise has a share in the events.
  double velocity_memory_s = 0.07, confirmed_velocity_memory_s = 1;
  /// Random walk of edge offset and trail [px per square root of s], and of the OFF delay [ms per square root of s].
  double offset_drift_px = 0.025;
  /// Known delay of the camera's events [s], beside the response time that they show, see ResponseTime. Reported poses
  /// are moved forward by both, to be those at their time `t`.
  double latency_s = 0;
  /// Standard deviation of the camera's delay that no event tells [s]: it shifts the pose along its motion. Used in the
  /// reported covariance only, beside the response time that is measured, see ResponseTime.
  double latency_sigma_s = 1e-4;
  // Standard deviations at the start: translation, rotation, velocity, angular velocity, edge offset, trail, OFF delay.
  double initial_sigma_t_m = 0.01;
  double initial_sigma_r_rad = 0.1;
  double initial_sigma_v_m_s = 0.5;
  double initial_sigma_w_rad_s = 3;
  double initial_sigma_offset_px = 0.3;
  double initial_sigma_trail_px = 0.3;
  double initial_sigma_off_delay_s = 2e-4;
  double initial_trail_px = 0;  ///< where it is known, with a small `initial_sigma_trail_px`
};

/// @throws std::invalid_argument naming the setting and its value
inline void validate(const KalmanSettings& settings) {
  const Require require("kalman update");
  require.positive(settings.inflation, "inflation");
  require.positive(settings.robust_px, "robust_px");
  require.positive(settings.acceleration_noise, "acceleration_noise");
  require.positive(settings.turning_distance_m, "turning_distance_m");
  require.positive(settings.rotation_share, "rotation_share");
  require.positive(settings.velocity_memory_s, "velocity_memory_s");
  require.positive(settings.confirmed_velocity_memory_s, "confirmed_velocity_memory_s");
  require.positive(settings.offset_drift_px, "offset_drift_px");
  require.not_negative(settings.latency_s, "latency_s");
  require.positive(settings.latency_sigma_s, "latency_sigma_s");
  require.positive(settings.initial_sigma_t_m, "initial_sigma_t_m");
  require.positive(settings.initial_sigma_r_rad, "initial_sigma_r_rad");
  require.positive(settings.initial_sigma_v_m_s, "initial_sigma_v_m_s");
  require.positive(settings.initial_sigma_w_rad_s, "initial_sigma_w_rad_s");
  require.positive(settings.initial_sigma_offset_px, "initial_sigma_offset_px");
  require.positive(settings.initial_sigma_trail_px, "initial_sigma_trail_px");
  require.positive(settings.initial_sigma_off_delay_s, "initial_sigma_off_delay_s");
  require.not_negative(settings.initial_trail_px, "initial_trail_px");
}

}  // namespace evmarker
