#pragma once
// Our rule: coupled point-to-line Kalman filter with velocity and edge offset.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/edge_gradients.hpp"
#include "evmarker/update/edge_scatter.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/kalman_state.hpp"
#include "evmarker/update/measurement_model.hpp"
#include "evmarker/update/measurement_statistics.hpp"
#include "evmarker/update/model_misfit.hpp"
#include "evmarker/update/motion_bound.hpp"
#include "evmarker/update/polarity_agreement.hpp"
#include "evmarker/update/process_noise.hpp"
#include "evmarker/update/response_time.hpp"
#include "evmarker/update/update_rule.hpp"
#include "evmarker/update/velocity_memory.hpp"

namespace evmarker {

/// Error-state Kalman filter over [translation, rotation, velocity, angular velocity, edge offset, trail], see
/// KalmanState and MeasurementModel.
class KalmanUpdate {
 public:
  using Settings = KalmanSettings;

  /// @throws std::invalid_argument naming the setting and its value
  KalmanUpdate(const Settings& settings, int events_per_update) : settings_(settings), noise_(settings) {
    set_events_per_update(events_per_update);
    Require("kalman update")(events_per_update >= 1, "events_per_update", events_per_update);
    validate(settings);
    const double sigmas[] = {settings.initial_sigma_t_m, settings.initial_sigma_r_rad, settings.initial_sigma_v_m_s,
                             settings.initial_sigma_w_rad_s};
    for (int i = 0; i < 12; ++i) state_.P.xx(i, i) = squared(sigmas[i / 3]);
    for (std::size_t b = 0; b < kBiases; ++b) state_.P.bb[b][b] = initial_bias_variances()[b];
    model_.bias_px[kTrail] = settings.initial_trail_px;
    model_.robust_px = settings.robust_px;
    fading_.fill(1 / settings.velocity_memory_s);
  }

  void set_events_per_update(int events) noexcept { statistics_.set_events_per_update(events); }

  /// Adds the measurement of one event.
  [[gnu::always_inline]] void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 lever = Vec3(c.E) - translation(T_camera_marker);
    const EventMeasurement of_event = model_.measure(c.gradient, lever, c.distance_px, c.from_end_px2,
                                                     c.dark_side_known ? 1 : 0, c.polarity, c.contrast);
    // What is not finite would stay in the means for ever. One comparison finds it; the rotation part of the row needs
    // none of its own: |lever x gradient| is at most |lever| |gradient|.
    if (!(of_event.residual2 * (of_event.lever2 * of_event.gradient2) < kInfinity)) return;
    measurements_.add(of_event.row, of_event.weight);
    edges_.add(c.segment, of_event.row[kResidual], of_event.weight);
    polarities_.add(of_event.toward_dark_px_per_s, c.dark_side_known ? c.polarity : 0);
    if (++single_events_ % kSampleEvery == 0) sample(of_event.row, of_event.weight, c.polarity);
    statistics_.add({of_event.residual2, of_event.lever2, of_event.gradient2, us_since_update(c.t)});
  }

  /// Batch version.
  [[gnu::always_inline]] void add(const Correspondences& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 T = translation(T_camera_marker);
    const double t_us = t_us_;
    const MeasurementModel model = model_;
    alignas(64) std::array<simd::Lanes, MeasurementRows::kNumbers> rows;
    alignas(64) simd::Lanes weights, residual2, lever2, gradient2, since, finite_check, toward_dark;
    for (std::size_t i = 0; i < simd::kLanes; ++i) {
      const Vec3 lever = Vec3(c.E_x[i], c.E_y[i], c.E_z[i]) - T;
      const EventMeasurement of_event = model.measure({c.g_x[i], c.g_y[i], c.g_z[i]}, lever, c.distance_px[i],
                                                      c.from_end_px2[i], 1, c.polarity[i], c.contrast[i]);
      const double since_update_us = c.t[i] - t_us;
      residual2[i] = c.is_event[i] * of_event.residual2;
      lever2[i] = c.is_event[i] * of_event.lever2;
      gradient2[i] = c.is_event[i] * of_event.gradient2;
      finite_check[i] = residual2[i] * (lever2[i] * gradient2[i]);
      weights[i] = c.is_event[i] * of_event.weight;
      toward_dark[i] = of_event.toward_dark_px_per_s;
      since[i] = c.is_event[i] * (since_update_us > 0 ? since_update_us : 0);
#pragma GCC unroll 9
      for (std::size_t k = 0; k < MeasurementRows::kNumbers; ++k) rows[k][i] = of_event.row[k];
    }
    if (!(simd::sum(finite_check) < kInfinity)) return;  // it would never leave the running means
    measurements_.add(rows, weights, c.count);
    for (std::size_t i = 0; i < c.count; ++i) edges_.add(c.segment[i], rows[kResidual][i], weights[i]);
    polarities_.add(toward_dark, c.polarity, c.is_event);
    MeasurementRow sampled;
    for (std::size_t k = 0; k < MeasurementRows::kNumbers; ++k) sampled[k] = rows[k][0];
    sample(sampled, weights[0], c.polarity[0]);
    statistics_.add({simd::sum(residual2), simd::sum(lever2), simd::sum(gradient2), simd::sum(since)});
  }

  /// The measurements are applied at the mean time of their events; from there, the pose is moved on to the time t of
  /// the last event.
  [[gnu::noinline]] bool update(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    // At rest t_us_ stays, so that the first update after it predicts over the whole standstill.
    if (signal_weight_ == 0) {
      forget_events();
      return true;
    }
    const double dt = 1e-6 * us_since_update(t);
    const int count = measurements_.count();
    const double mean_dt = count > 0 ? std::min(1e-6 * statistics_.sums().since_us / count, dt) : dt;
    if (count > 0) update_means(count);
    if (bound_.is_set()) moved_px_ += count / bound_.events_per_px();
    if (moved_px_ > kEvaluationSpreads * std::sqrt(statistics_.spread_px2())) evaluate_residuals();
    t_us_ = static_cast<double>(t);
    velocity_memory_.add(count, bound_.events_per_px(), dt, statistics_.share());
    if (velocity_memory_.is_due()) choose_fading();
    limit_motion(count, dt);
    // The events were linearised at the pose before the prediction. So the predicted motion is not applied to the pose
    // yet, but is the prior mean of the error state.
    const Vec6 twist_before = state_.twist, predicted_motion = predict_state(mean_dt), predicted_twist = state_.twist;
    ErrorState error;
    set_pose(error, predicted_motion);

    const double information_per_event =
        signal_weight_ / (squared(settings_.inflation) * std::max(statistics_.spread_px2(), kPixelVariance));
    const bool good = measurements_.correct(state_.P, error, information_per_event);
    forget_events();

    Vec6 step = pose(error);
    const Vec6 twist = predicted_twist + velocity(error);
    if (count > 0) {
      noise_.add(velocity(error), dt, px_per_s());
      velocity_memory_.add_step(twist_before, predicted_twist, velocity(error));
    }
    const double edge_speed = norm(twist.t) + std::sqrt(statistics_.lever2()) * norm(twist.r);
    // From the state's time, the mean of the events', to t; but no farther than the motion is bounded to.
    const double lead_s = std::min(dt - mean_dt, bound_.most_m() / edge_speed);
    const Vec6 lead = lead_s != 0 ? motion_step(lead_s, fading_).moved(twist) : Vec6();
    step = step + lead;
    const Vec2 biases{error.b[kOffset], error.b[kTrail]};
    if (!std::isfinite(squared_norm(step) + squared_norm(twist) + squared_norm(biases))) return false;

    perturb(T_camera_marker, step);
    if (steps_ % kStepsToMend == 0) {
      state_.P.symmetrize();
      measure_misfit();
    }
    state_.twist = twist;
    update_motion_of_model();
    lead_s_ = lead_s;
    lead_ = lead;
    correct_biases(error);
    return good;
  }

  /// @param weight of the events' information, from the events beside the edges since the last call: 1 if at least half
  /// of them are surely of moving edges, 0 at rest. It is more if the polarities of the events since then show more: a
  /// small marker that moves fast makes many events beside its edges itself.
  /// @param noise_per_s noise events that match edges
  void set_signal_weight(double weight, double noise_per_s) noexcept {
    signal_weight_ = std::max(weight, std::min(1.0, 2 * polarities_.least_moving_share()));
    noise_per_s_ = noise_per_s;
    polarities_.clear();
  }

  /// Switches on the bound of the motion by the number of events.
  /// @param per_px events that all edges together make while they move by a pixel
  /// @param per_passage events that one pixel makes while an edge passes over it
  void bound_motion_by_events(double per_px, double per_passage) noexcept { bound_.set(per_px, per_passage); }

  /// Corrects the state, the pose and twist included, by a measurement of the trail with a standard deviation of a
  /// quarter of its value. The trail follows from the edge's width, which the spread of the residuals shows. Forgets
  /// the events since the last update.
  /// @param events_per_passage events that one pixel makes while an edge passes over it
  void measure_trail(Eigen::Isometry3d& T_camera_marker, double events_per_passage) noexcept {
    forget_events();
    const double trail_px = expected_trail_px(edge_width_px(), events_per_passage),
                 sigma_px = ModelMisfit::kTrailError * trail_px;
    MeasurementRow row{};
    row[6 + kTrail] = 1;
    row[6 + kBiases] = trail_px - model_.bias_px[kTrail];
    measurements_.add(row, 1);
    response_time_ = {};  // the first events were those of a start that was off
    ErrorState error;
    if (measurements_.correct(state_.P, error, 1 / squared(sigma_px))) correct_biases(error);
    // The error is that at the state's own time; from there to the pose, the velocity's correction moves it, too.
    const Vec6 of_lead = motion_step(lead_s_, fading_).moved(velocity(error));
    perturb(T_camera_marker, pose(error) + of_lead);
    lead_ = lead_ + of_lead;
    state_.twist = state_.twist + velocity(error);
    forget_events();
  }

  /// Moves the pose on to a later time with the present velocity, without a bound on the motion; its covariance grows.
  /// Forgets the events since the last update.
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    bound_.lift();
    move_to(T_camera_marker, t);
  }

  /// Moves the pose on to a time until which all events have been added: their number bounds the motion, and at rest
  /// the pose and its covariance hold until then. For copies that predict a pose, and after a gap: it moves the time of
  /// a rule at rest on, from which its next `update` would predict over the whole standstill.
  void advance_by_event_count(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    if (signal_weight_ == 0) {
      forget_events();
      t_us_ = std::max(t_us_, static_cast<double>(t));
      return;
    }
    limit_motion(measurements_.count(), 1e-6 * us_since_update(t));
    move_to(T_camera_marker, t);
  }

  /// Goes over to another pose, whose motions are J times those of the present one. Forgets the events since the last
  /// update.
  void transform(const Matrix6d& J) noexcept {
    forget_events();
    state_.transform(J);
    lead_ = Vec6(Vector6d(J * Vector6d(lead_)));
    update_motion_of_model();
  }

  /// Says that another pose may be the right one, until the next call; it is part of the covariance.
  /// @param deviation perturbation to the other pose, times the square root of its probability; zero if there is none
  void set_other_pose(const Vec6& deviation) noexcept { to_other_pose_ = deviation; }

  void reverse() noexcept {
    forget_events();
    lead_s_ = -lead_s_;  // in mirrored time, the mean time of the last events is after the pose
    state_.scale_velocity(-1);
    model_.time_direction = -model_.time_direction;
    update_motion_of_model();
  }

  /// Covariance of the pose, see PoseEstimate.
  [[gnu::noinline]] Matrix6d covariance() const noexcept {
    Matrix6d P = covariance_by_events(delay_variance_s2());
    if (squared_norm(to_other_pose_) > 0) add_other_pose(P);
    return P;
  }
  /// The covariance without the part of another pose and, by default, without that of an unknown delay.
  /// @param delay_s2 variance of an unknown delay, which shifts the pose along its twist [s^2]
  [[gnu::always_inline]] Matrix6d covariance_by_events(double delay_s2 = 0) const noexcept {
    Matrix6d P;
    for (int k = 0; k < 6; ++k)
      for (int i = 0; i < 6; ++i) P(i, k) = state_.P.xx(i, k);
    if (lead_s_ != 0) add_motion(P, lead_s_);
    // An unknown delay of variance delay_s2 shifts the pose along its twist.
    const std::array<double, 6> twist = state_.twist.array(), delayed = (delay_s2 * state_.twist).array();
    const Matrix6d& edge_covariance = edges_.covariance();
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t i = 0; i < 6; ++i) {
        double& element = P.data()[6 * k + i];
        element = settings_.covariance_scale * element + edge_factor_ * edge_covariance.data()[6 * k + i] +
                  twist[k] * delayed[i];
      }
    for (int k = 1; k < 6; ++k)  // symmetric to the last bit
      for (int i = 0; i < k; ++i) P(i, k) = P(k, i);
    return P;
  }
  Vector6d twist() const noexcept { return state_.twist; }
  /// By how much events are late, as far as it is known [s]: a pose that they show is that of so much earlier.
  double delay_s() const noexcept { return settings_.latency_s + response_time_.delay_s(); }
  /// Standard deviation [px] by which the pixels' response time spreads the events of moving edges now. Averaged over
  /// edges of all directions, the squared speed along the normal is half of the squared speed.
  double smear_px() const noexcept { return std::numbers::sqrt2 / 2 * response_time_.delay_s() * px_per_s(); }
  /// Sets within which distance of an edge events are matched; 2 at first.
  void set_max_distance_px(double distance_px) noexcept { max_distance_px_ = distance_px; }
  /// See ModelMisfit.
  bool events_fill_distance() const noexcept { return misfit_.events_fill_distance(); }
  /// Signed distance of an event from its edge, corrected for edge offset and trail [px].
  [[gnu::always_inline]] double residual_px(const Correspondence& c) const noexcept {
    return model_.residual_px(c.distance_px, c.dark_side_known ? 1 : 0, c.polarity, c.contrast);
  }
  /// How far on the dark side of an edge its events lie [px].
  double edge_offset_px() const noexcept { return model_.bias_px[kOffset]; }
  /// How far behind their moving edges events lie [px].
  double trail_px() const noexcept { return model_.bias_px[kTrail]; }

 private:
  static constexpr std::size_t kResidual = 6 + kBiases;  // in a row
  static constexpr unsigned kSampleEvery =
      simd::kLanes;  // of events added one by one; of a batch, the first is sampled
  // Motion between evaluations of the residuals, in standard deviations of the events' places: two to three times the
  // width of an edge.
  static constexpr double kEvaluationSpreads = 8;
  static constexpr double kPixelVariance = 1.0 / 12;  // of a coordinate that is rounded to whole pixels [px^2]
  static constexpr double kLeastSpeed = 1e-3, kMostSpeed = 1e6;  // [px/s]
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double squared(double x) noexcept { return x * x; }

  static Vec6 pose(const ErrorState& error) noexcept { return six_from(error, 0); }
  static Vec6 velocity(const ErrorState& error) noexcept { return six_from(error, 6); }
  static Vec6 six_from(const ErrorState& error, Eigen::Index i) noexcept {
    const auto& x = error.x;
    return {{x(i), x(i + 1), x(i + 2)}, {x(i + 3), x(i + 4), x(i + 5)}};
  }
  static void set_pose(ErrorState& error, const Vec6& pose) noexcept {
    const std::array<double, 6> all = pose.array();
    std::copy(all.begin(), all.end(), error.x.data());
  }

  void move_to(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    forget_events();
    const double dt = 1e-6 * us_since_update(t);
    t_us_ = static_cast<double>(t);
    choose_fading();
    perturb(T_camera_marker, predict_state(dt));
  }

  void forget_events() noexcept {
    measurements_.clear();
    statistics_.clear();
  }

  void correct_biases(const ErrorState& error) noexcept {
    // An edge's events lie on its dark side, within its width, and behind it, by a whole contrast step at most. An
    // offset or a trail beyond that can only come from events of something else: amid leak events, or where pixels are
    // slow, the trail would grow without end.
    model_.bias_px[kOffset] = std::clamp(model_.bias_px[kOffset] + error.b[kOffset], 0.0, max_offset_px());
    model_.bias_px[kTrail] = std::clamp(model_.bias_px[kTrail] + error.b[kTrail], 0.0, most_trail_px_);
  }

  [[gnu::always_inline]] void sample(const MeasurementRow& row, double weight, double polarity) noexcept {
    edges_.add_row({row[0], row[1], row[2], row[3], row[4], row[5], row[6]}, weight);
    gradients_.add({row[0], row[1], row[2], row[3], row[4], row[5]});
    const Vec3 by_translation{row[0], row[1], row[2]}, by_rotation{row[3], row[4], row[5]};
    const double px_per_s = dot(by_translation, state_.twist.t) + dot(by_rotation, state_.twist.r);
    // The row's trail has the sign of -s p, which is 0 where it is not known which side is dark.
    const bool fits = -row[6 + kTrail] * model_.time_direction * px_per_s >= 0;
    if (signal_weight_ == 1)  // noise at rest spreads anywhere
      response_time_.add(row[kResidual], px_per_s, fits ? polarity : 0);
    velocity_memory_.add_speed(px_per_s);
  }

  [[gnu::noinline]] void evaluate_residuals() noexcept {
    edges_.evaluate();
    response_time_.evaluate(max_distance_px_);
    moved_px_ = 0;
  }

  // Events lie evenly over the edge's width w, variance w^2 / 12, and each is known to a pixel only; slow pixels smear
  // them.
  double edge_width_px() const noexcept {
    const double of_edge = statistics_.spread_px2() - kPixelVariance - squared(smear_px());
    return std::sqrt(12 * std::max(of_edge, kPixelVariance));
  }

  // Variance of the time by which the pose is late, of which the filter itself knows nothing: motion alone cannot tell
  // it from another pose.
  double delay_variance_s2() const noexcept {
    const double px_per_s = this->px_per_s();
    const double lag_s2 = px_per_s > 0 ? misfit_.along_motion_px2() / (px_per_s * px_per_s) : 0;
    return squared(settings_.latency_sigma_s) + response_time_.delay_variance_s2() + lag_s2;
  }

  // Once in some updates, as it takes its time.
  [[gnu::noinline]] void measure_misfit() noexcept {
    if (signal_weight_ == 1) misfit_.measure_spread(statistics_.spread_px2(), max_distance_px_, smear_px());
    if (bound_.is_set()) {
      const double by_width_px = expected_trail_px(edge_width_px(), bound_.events_per_passage());
      // The width tells half a step. And what is not known of a delay looks like a trail.
      most_trail_px_ = std::max(2 * by_width_px + std::sqrt(response_time_.delay_variance_s2()) * px_per_s(),
                                settings_.initial_trail_px);
      // Where it is not known which side of an edge is dark, the filter does not correct the trail.
      misfit_.compare_trails(edges_.share_of_known_dark_sides() * model_.bias_px[kTrail], by_width_px);
    }
    edge_factor_ = edges_.covariance_factor(misfit_.of_edge_px2());
  }

  // The root mean square residual, but at least half a pixel, however sharp the edge is.
  double max_offset_px() const noexcept { return std::sqrt(std::max(statistics_.spread_px2(), 0.25)); }

  // The motion by which the model tells events of moving edges from noise.
  void update_motion_of_model() noexcept {
    model_.twist = state_.twist;
    model_.response_s = response_time_.delay_s();
    model_.noise_px_per_s = bound_.is_set() ? noise_per_s_ / bound_.events_per_px() : 0;
    const double lever2 = statistics_.lever2();
    // Of the speed along one normal: a third of the variances, which are summed over three axes.
    const double variance =
        statistics_.gradient2() * (state_.translation_variance() + lever2 * state_.rotation_variance()) / 3;
    model_.speed_deviation_px_per_s =
        std::max({kLeastSpeed, model_.noise_px_per_s, std::min(std::sqrt(variance), kMostSpeed)});
  }

  void update_means(int count) noexcept {
    statistics_.update_means(count);
    model_.spread_px2 = statistics_.spread_px2();
  }

  // Rounding takes a rotation off SO(3), and the covariance off symmetry, by 1e-16 a step: to mend that at every step
  // took longer than the step.
  static constexpr unsigned kStepsToMend = 16;
  void perturb(Eigen::Isometry3d& T, const Vec6& step) noexcept {
    set_translation(T, translation(T) + step.t);
    if (++steps_ % kStepsToMend == 0) orthonormalize(T);
    turn(T, step.r);
  }

  double us_since_update(Timestamp t) const noexcept { return std::max(0.0, static_cast<double>(t) - t_us_); }

  std::array<double, kBiases> initial_bias_variances() const noexcept {
    return {squared(settings_.initial_sigma_offset_px), squared(settings_.initial_sigma_trail_px)};
  }

  void choose_fading() noexcept {
    constexpr double kFasterInNoise = 1.4;
    const double lever2 = statistics_.lever2();
    fading_ = velocity_memory_.fading(
        std::lerp(kFasterInNoise, 1.0, signal_weight_) / settings_.velocity_memory_s,
        1 / settings_.confirmed_velocity_memory_s, squared_norm(state_.twist.t) + lever2 * squared_norm(state_.twist.r),
        state_.translation_variance() + lever2 * state_.rotation_variance(), signal_weight_);
  }

  EdgeSpeed edge_speed() const noexcept { return EdgeSpeed::of(state_.twist, statistics_.lever2()); }
  double px_per_s() const noexcept { return std::sqrt(statistics_.gradient2()) * edge_speed().all; }
  // Density of the white acceleration along each axis.
  std::array<double, 6> acceleration() const noexcept { return noise_.density(edge_speed(), statistics_.lever2()); }

  // Bounds the motion of the edges during dt by the number of events: where the velocity or its standard deviation
  // would move them farther, scales both down.
  void limit_motion(int events, double dt) noexcept {
    bound_.lift();
    if (!(bound_.is_set() && statistics_.known())) return;
    const double lever2 = statistics_.lever2();
    bound_.measure(events, dt, noise_per_s_, statistics_.share(), std::sqrt(statistics_.gradient2()));
    const double by_velocity = carried(dt, *std::ranges::min_element(fading_));
    // A quick check first: motion of no more than most_m() in space cannot show as more than most_px() in the image.
    const double sigma = std::sqrt(state_.translation_variance() + lever2 * state_.rotation_variance());
    if (by_velocity * std::max(edge_speed().all, sigma) <= bound_.most_m() || !gradients_.known()) return;
    const std::array<double, 6> v = state_.twist.array();
    const double mean2 = gradients_.px2([&](std::size_t k, std::size_t i) { return v[k] * v[i]; });
    const double variance = gradients_.px2([&](std::size_t k, std::size_t i) {
      return state_.P.xx(6 + static_cast<Eigen::Index>(k), 6 + static_cast<Eigen::Index>(i));
    });
    const double expected_px = by_velocity * std::sqrt(std::max(mean2, variance));
    if (expected_px > bound_.most_px()) state_.scale_velocity(bound_.most_px() / expected_px);
  }

  // The motion over dt, with its process noise q limited to what is possible.
  MotionStep possible_motion(double dt, const std::array<double, 6>& q) const noexcept {
    const double lever2 =
        statistics_.known() ? std::max(statistics_.lever2(), ProcessNoise::kSmallestLever2) : kInfinity;
    return bound_.limited(motion_step(dt, fading_), q[0], lever2);
  }

  // Adds to a covariance of the pose what a prediction by dt adds to it.
  void add_motion(Matrix6d& P, double dt) const noexcept {
    const std::array<double, 6> q = acceleration();
    state_.add_motion(P, possible_motion(dt, q), q);
  }

  // The second moment about this pose of two that may be right.
  void add_other_pose(Matrix6d& P) const noexcept {
    const std::array<double, 6> deviation = to_other_pose_.array();
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t i = 0; i < 6; ++i) P.data()[6 * k + i] += deviation[k] * deviation[i];
  }

  // Predicts the state from its own time, lead_s_ before the pose, to `after_pose_s` after the pose. Returns the motion
  // from the present pose to there.
  Vec6 predict_state(double after_pose_s) noexcept {
    const double dt = std::exchange(lead_s_, 0) + after_pose_s;
    const Vec6 moved_already = std::exchange(lead_, Vec6());
    // At the state's own time, as in updates at the same time or after reverse(): the state stays, and only the pose
    // goes back to it.
    if (dt == 0) return -1 * moved_already;
    const std::array<double, 6> q = acceleration();
    const MotionStep motion = possible_motion(dt, q);
    const Vec6 moved = motion.moved(state_.twist) - moved_already;
    state_.predict(motion, q);
    state_.let_biases_drift(squared(settings_.offset_drift_px) * std::abs(dt), initial_bias_variances());
    return moved;
  }

  Settings settings_;
  KalmanState state_;  // at the mean time of its last events
  double lead_s_ = 0;  // from there to the pose
  Vec6 lead_;          // by how much the pose was moved for it
  // Time of the pose [us], exact to 2^53. Infinite before the first update, so that us_since_update() is 0.
  double t_us_ = kInfinity;
  MeasurementModel model_;
  KalmanMeasurements measurements_;  // since the last update
  MeasurementStatistics statistics_;
  double signal_weight_ = 1, noise_per_s_ = 0;  // see set_signal_weight
  MotionBound bound_;
  ProcessNoise noise_;
  VelocityMemory velocity_memory_;
  PolarityAgreement polarities_;  // since the last set_signal_weight
  std::array<double, 6> fading_;  // of the velocity, along each axis [1/s]
  EdgeScatter edges_;
  EdgeGradients gradients_;
  ResponseTime response_time_;
  ModelMisfit misfit_;
  double most_trail_px_ = kInfinity;  // a whole contrast step
  double edge_factor_ = 1;            // of the covariance by the edges' errors, by the misfit
  double max_distance_px_ = 2;        // of matched events
  unsigned single_events_ = 0;        // added one by one
  double moved_px_ = 0;               // by the edges, since the residuals were evaluated
  unsigned steps_ = 0;                // of the pose
  Vec6 to_other_pose_;                // see set_other_pose
};

static_assert(MotionEstimatingRule<KalmanUpdate> && BatchUpdateRule<KalmanUpdate>);

}  // namespace evmarker
