#pragma once
// How far edges can have moved, by the number of events that they made.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "evmarker/update/motion_model.hpp"

namespace evmarker {

/// Bounds the motion of the edges by the number of events: few events mean little motion.
class MotionBound {
 public:
  /// Sets how many events a motion makes; before, there is no bound.
  /// @param per_px events that all edges together make while they move by a pixel
  /// @param per_passage events that one pixel makes while an edge passes over it
  void set_event_rates(double per_px, double per_passage) noexcept {
    events_per_px_ = per_px;
    events_per_passage_ = per_passage;
  }
  bool rates_known() const noexcept { return events_per_px_ > 0; }
  double events_per_px() const noexcept { return events_per_px_; }
  double events_per_passage() const noexcept { return events_per_passage_; }
  /// How far the edges move while they make so many events [px]; 0 while it is not known.
  double px(double events) const noexcept { return rates_known() ? events / events_per_px_ : 0; }

  /// Takes the bound away until the next one is measured.
  void lift() noexcept { most_px_ = most_m_ = kInfinity; }

  /// Measures the bound over a step, the smaller of two: by its own events, which tell little if they are few, as
  /// events come in passages; and by the usual rate of events, so that the margins of many small steps do not add up.
  /// @param events of the step, noise among them
  /// @param dt length of the step [s]
  /// @param noise_per_s events that are noise
  /// @param share weight of the step in running means over 100 events
  /// @param px_per_m motion of the edges along their normals in the image per motion in space, root mean square
  void measure(int events, double dt, double noise_per_s, double share, double px_per_m) noexcept {
    constexpr double kSafety = 8;  // for hidden edges, fewer events of fast ones, and a motion that has just begun
    constexpr double kGrowth = 3;  // an interval counts as so many usual ones at most, so that a rest changes it little
    if (events > 0) {
      const double interval_s = dt / events;
      if (interval_s_ > 0)
        interval_s_ += share * (std::min(interval_s, kGrowth * interval_s_) - interval_s_);
      else
        interval_s_ = interval_s;
      events_since_rate_ += events;
      if (events_since_rate_ >= kRateEvery) measure_most_rate(noise_per_s);
    }
    double most = most_events(events - noise_per_s * dt);
    if (dt > 0) most = std::min(most, most_events_per_s_ * dt);
    most_px_ = kSafety * most / events_per_px_;
    most_m_ = most_px_ / px_per_m;
  }

  /// How far the edges have moved at most along their normals, root mean square [px], and the least motion in space
  /// that can show as that much [m]: along the line of sight it may be more. Infinite without a bound.
  double most_px() const noexcept { return most_px_; }
  double most_m() const noexcept { return most_m_; }

  /// The step with the standard deviation of its process noise of the pose limited to the bound, and to ten turns of
  /// the marker where there is none: with the variances of a pause of years, rounding would make the covariance
  /// indefinite. The noise of all axes is scaled by the factor that the first one needs, q_cross by its root: so Q
  /// stays positive semidefinite.
  /// @param acceleration density of the white acceleration of the translation [m^2/s^3]
  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]; infinite if not known
  MotionStep limited(MotionStep motion, double acceleration, double lever2) const noexcept {
    constexpr double kTenTurns = 20 * std::numbers::pi;
    const double most2 = std::min(most_m_ * most_m_, kTenTurns * kTenTurns * lever2);
    const double pose = acceleration * motion.q_pose[0];
    if (!(pose > most2)) return motion;
    const double pose_factor = most2 / pose, cross_factor = std::sqrt(pose_factor);
    for (double& q : motion.q_pose) q *= pose_factor;
    for (double& q : motion.q_cross) q *= cross_factor;
    return motion;
  }

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  // Events come in passages of c = events_per_passage, so that N of them have the variance N c. One passage is added to
  // N, which may be 0.
  double most_events(double signal_events) const noexcept {
    const double events = std::max(0.0, signal_events);
    return events + 3 * std::sqrt((events + events_per_passage_) * events_per_passage_);
  }

  // The most events a second by the usual interval between them. It changes little from event to event.
  void measure_most_rate(double noise_per_s) noexcept {
    constexpr double kTogether = 100;  // events: as many as the running mean extends over
    events_since_rate_ = 0;
    const double together_s = kTogether * interval_s_;
    most_events_per_s_ = together_s > 0 ? most_events(kTogether - noise_per_s * together_s) / together_s : kInfinity;
  }

  static constexpr int kRateEvery = 16;  // events, to save time

  double events_per_px_ = 0;  // 0: not known
  double events_per_passage_ = 1;
  double interval_s_ = 0;               // usual one between events; 0: not known
  int events_since_rate_ = kRateEvery;  // since most_events_per_s_ was measured
  double most_events_per_s_ = kInfinity;
  double most_px_ = kInfinity, most_m_ = kInfinity;
};

}  // namespace evmarker
