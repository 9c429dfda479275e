#pragma once
// The Kalman filter's assumptions about motion and events.

namespace evmarker {

/// Noise of the motion and of the events.
struct KalmanSettings {
  /// The events that an edge makes at one pixel err together: each counts as if their measured spread about the edge
  /// was so many times larger.
  double inflation = 1.8;
  double robust_px = 1;  ///< residuals beyond this count less and less (Cauchy weights)
  /// White acceleration of the marker's edges, at rest [m^2/s^3]. In motion speed^3 / turning_distance_m is added: a
  /// hand changes its velocity within a distance, not within a time, and events come by distance too.
  double acceleration_noise = 2;
  double turning_distance_m = 0.02;
  /// A hand turns a marker less than it carries it: share of that noise in which the edges move by rotation, on top of
  /// the noise that the rotation's own speed brings.
  double rotation_share = 0.5;
  double velocity_memory_s = 0.05;  ///< without events, velocity fades with this time constant
  double offset_drift_px = 0.1;     ///< random walk of the edge offset and of the trail in a second [px]
  /// A sensor's unknown delay: shifts the pose along its motion, unseen by the filter. Enters the stated covariance
  /// only.
  double latency_sigma_s = 2e-4;
  double trail_sigma_px = 0.1;  ///< likewise in pixels: an event comes only when a whole contrast step has passed
  /// The noise above is more than there is on average, so that a sudden turn or wrong events are survived; the poses
  /// err by less. Share of the filter's own covariance that is reported.
  double covariance_scale = 0.2;
  double initial_sigma_t_m = 0.01;  ///< of the pose that tracking starts from
  double initial_sigma_r_rad = 0.1;
  double initial_sigma_v_m_s = 0.5;
  double initial_sigma_w_rad_s = 3;
  double initial_sigma_offset_px = 0.3;
  double initial_sigma_trail_px = 0.3;
};

}  // namespace evmarker
