#pragma once
// How a marker moves, as far as its events show: the motion model of the Kalman filter.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "evmarker/base/vector.hpp"
#include "evmarker/update/edge_gradients.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/kalman_state.hpp"
#include "evmarker/update/measurement_statistics.hpp"
#include "evmarker/update/motion_bound.hpp"
#include "evmarker/update/motion_model.hpp"
#include "evmarker/update/process_noise.hpp"
#include "evmarker/update/velocity_memory.hpp"

namespace evmarker {

/// The parameters of MotionStep for one marker, learned online: how fast its velocity fades, see VelocityMemory, how
/// much it accelerates, see ProcessNoise, and how far its edges can have moved, see MotionBound.
class AdaptiveMotion {
 public:
  /// What a prediction does to the covariance, with the density of the white acceleration along each axis [m^2/s^3,
  /// rad^2/s^3].
  struct Step {
    MotionStep motion;
    std::array<double, 6> acceleration;
  };

  explicit AdaptiveMotion(const KalmanSettings& settings)
      : memory_s_(settings.velocity_memory_s),
        confirmed_fading_(1 / settings.confirmed_velocity_memory_s),
        noise_(settings) {
    fading_.fill(1 / memory_s_);
  }

  /// Adds an event. A fair sample of them is enough.
  /// @param px_per_s speed of its edge along the normal
  [[gnu::always_inline]] void add_sample(const EdgeGradients::Gradient& gradient, double px_per_s) noexcept {
    gradients_.add(gradient);
    velocity_memory_.add_speed(px_per_s);
  }

  /// Adds the events of a step of length dt [s], before the step is predicted.
  /// @param signal weight of the events, see MatchedBackground
  void add_events(int events, double dt, double signal, const KalmanState& state,
                  const MeasurementStatistics& statistics) noexcept {
    velocity_memory_.add(events, bound_.events_per_px(), dt, statistics.share());
    if (velocity_memory_.is_due()) choose_fading(signal, state, statistics.lever2());
  }

  /// Adds how the events of that step corrected the velocity [m/s, rad/s].
  /// @param before,predicted velocity at the begin of the step, and as predicted for its end
  void add_correction(const Vec6& before, const Vec6& predicted, const Vec6& correction, double dt,
                      const MeasurementStatistics& statistics) noexcept {
    noise_.add(correction, dt, px_per_s(predicted, statistics));
    velocity_memory_.add_step(before, predicted, correction);
  }

  /// Chooses how fast the velocity fades from now on, along each axis.
  /// @param signal weight of the events, see MatchedBackground
  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]
  void choose_fading(double signal, const KalmanState& state, double lever2) noexcept {
    constexpr double kFasterInNoise = 1.4;
    fading_ = velocity_memory_.update_fading(std::lerp(kFasterInNoise, 1.0, signal) / memory_s_, confirmed_fading_,
                                             squared_norm(state.twist.t) + lever2 * squared_norm(state.twist.r),
                                             state.speed_variance(lever2), signal);
  }

  /// Switches on the bound of the motion by the number of events, see MotionBound::set_event_rates.
  void bound_by_events(double per_px, double per_passage) noexcept { bound_.set_event_rates(per_px, per_passage); }
  /// Takes the bound away until the next `limit`.
  void lift_bound() noexcept { bound_.lift(); }
  const MotionBound& bound() const noexcept { return bound_; }

  /// Bounds the motion of the edges during the next step by its number of events: where the velocity or its standard
  /// deviation would move them farther, scales both down.
  /// @param dt length of the step [s]
  /// @param noise_per_s events that are noise
  void limit(KalmanState& state, int events, double dt, double noise_per_s,
             const MeasurementStatistics& statistics) noexcept {
    bound_.lift();
    if (!(bound_.rates_known() && statistics.known())) return;
    const double lever2 = statistics.lever2();
    bound_.measure(events, dt, noise_per_s, statistics.share(), std::sqrt(statistics.gradient2()));
    const double carried_s = carried(dt, *std::ranges::min_element(fading_));  // along the axis that fades slowest
    // A quick check first: motion of no more than most_m() in space cannot show as more than most_px() in the image.
    const double speed = EdgeSpeed::of(state.twist, lever2).all, sigma = std::sqrt(state.speed_variance(lever2));
    if (carried_s * std::max(speed, sigma) <= bound_.most_m() || !gradients_.known()) return;
    const std::array<double, 6> v = state.twist.array();
    // Squared speed of the edges along their normals, by the velocity and by its covariance.
    const double mean2 = gradients_.px2([&](std::size_t k, std::size_t i) { return v[k] * v[i]; });
    const double variance = gradients_.px2([&](std::size_t k, std::size_t i) {
      return state.P.xx(6 + static_cast<Eigen::Index>(k), 6 + static_cast<Eigen::Index>(i));
    });
    const double expected_px = carried_s * std::sqrt(std::max(mean2, variance));
    if (expected_px > bound_.most_px()) state.scale_velocity(bound_.most_px() / expected_px);
  }

  /// What is not known of a motion over dt [s], with a process noise limited to what is possible.
  Step step(double dt, const Vec6& twist, const MeasurementStatistics& statistics) const noexcept {
    const std::array<double, 6> q = noise_.density(EdgeSpeed::of(twist, statistics.lever2()), statistics.lever2());
    const double lever2_of_bound = statistics.known() ? std::max(statistics.lever2(), ProcessNoise::kSmallestLever2)
                                                      : std::numeric_limits<double>::infinity();  // limits no turn
    return {bound_.limited(motion_step(dt, uncertainty_fading()), q[0], lever2_of_bound), q};
  }

  /// How far a velocity carries in dt [s] while it fades.
  Vec6 moved(const Vec6& velocity, double dt) const noexcept {
    std::array<double, 6> way;
    for (std::size_t k = 0; k < 6; ++k) way[k] = carried(dt, fading_[k]);
    return scaled(way, velocity);
  }
  /// What is left of a velocity after dt [s], in which it carried as far as `moved(velocity, dt)`: it fades by its rate
  /// times the way.
  Vec6 faded(const Vec6& velocity, const Vec6& moved, double dt) const noexcept {
    return velocity - std::copysign(1.0, dt) * scaled(fading_, moved);
  }

  /// The lead from a state to a pose that is dt later, cut short where the motion is bounded: so that neither the
  /// velocity nor its deviation carries the edges farther.
  /// @param speed_variance of the edges, see KalmanState::speed_variance
  KalmanState::Lead lead(const Vec6& twist, double speed_variance, double dt, double lever2) const noexcept {
    if (dt == 0) return {};  // as with one event an update
    const double edge_speed = norm(twist.t) + std::sqrt(lever2) * norm(twist.r),
                 sigma = std::sqrt(std::max(0.0, speed_variance));
    const double s = std::min(dt, bound_.most_m() / std::max(edge_speed, sigma));
    return {s, s != 0 ? moved(twist, s) : Vec6()};
  }

  /// Upper estimate of the speed of the edges in the image, in any direction [px/s]: the speeds by translation and
  /// rotation are added, and motion along the line of sight counts as much as across it.
  static double px_per_s(const Vec6& twist, const MeasurementStatistics& statistics) noexcept {
    return std::sqrt(statistics.gradient2()) * EdgeSpeed::of(twist, statistics.lever2()).all;
  }

 private:
  // A velocity fades because nothing confirms it, not because the marker is known to have stopped. So what is not known
  // of a translation lasts as long as a confirmed velocity. Otherwise a small marker that comes nearer, whose edges
  // hardly move, would soon be sure to stand still, and lag behind by many standard deviations. Not so for rotation: by
  // measurement, slow motion was then followed less smoothly, and none was followed better.
  std::array<double, 6> uncertainty_fading() const noexcept {
    std::array<double, 6> rates = fading_;
    for (std::size_t k = 0; k < 3; ++k) rates[k] = std::min(rates[k], confirmed_fading_);
    return rates;
  }

  double memory_s_, confirmed_fading_;  // see KalmanSettings::velocity_memory_s; the second as a rate [1/s]
  ProcessNoise noise_;
  VelocityMemory velocity_memory_;
  std::array<double, 6> fading_;  // of the velocity, along each axis [1/s]
  MotionBound bound_;
  EdgeGradients gradients_;
};

}  // namespace evmarker
