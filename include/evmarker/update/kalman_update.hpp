#pragma once
// Our rule: coupled point-to-line Kalman filter with velocity and edge offset.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/pack.hpp"
#include "evmarker/update/adaptive_motion.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/kalman_state.hpp"
#include "evmarker/update/matched_background.hpp"
#include "evmarker/update/measurement_model.hpp"
#include "evmarker/update/measurement_statistics.hpp"
#include "evmarker/update/model_misfit.hpp"
#include "evmarker/update/polarity_agreement.hpp"
#include "evmarker/update/systematic_errors.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// Error-state Kalman filter over [translation, rotation, velocity, angular velocity, edge offset, trail, OFF delay]:
/// KalmanState is predicted by AdaptiveMotion and corrected by what each event measures, see MeasurementModel. Errors
/// that do not average out over events are measured beside it, see SystematicErrors.
class KalmanUpdate {
 public:
  using Settings = KalmanSettings;

  /// @throws std::invalid_argument naming the setting and its value
  KalmanUpdate(const Settings& settings, int events_per_update)
      : settings_(settings), motion_(settings), errors_(settings) {
    Require("kalman update")(events_per_update >= 1, "events_per_update", events_per_update);
    set_events_per_update(events_per_update);
    validate(settings);
    for (int i = 0; i < 12; ++i) state_.P.xx(i, i) = initial_variance(i);
    corrected_translation_m2_ = state_.translation_variance();
    for (std::size_t b = 0; b < kBiases; ++b) state_.P.bb[b][b] = initial_bias_variances()[b];
    model_.bias[kTrail] = settings.initial_trail_px;
    model_.robust_px = settings.robust_px;
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
    if (!at_rest()) errors_.add(c.segment, of_event.row[kResidual], of_event.weight);
    polarities_.add(of_event.toward_dark_px_per_s, c.dark_side_known ? c.polarity : 0);
    if (++single_events_ % kSampleEvery == 0) sample(of_event.row, of_event.weight, c.polarity);
    statistics_.add({of_event.residual2, of_event.lever2, of_event.gradient2, us_since_update(c.t)});
  }

  /// Adds the measurements of a batch, or none of them if one is not finite.
  [[gnu::always_inline]] void add(const Correspondences& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 T = translation(T_camera_marker);
    const double t_us = t_us_;
    const MeasurementModel model = model_;
    constexpr double kDarkSideKnown = 1;  // batches come from grids, which know it of every edge
    alignas(64) std::array<simd::Lanes, MeasurementRows::kNumbers> rows;
    alignas(64) simd::Lanes weights, residual2, lever2, gradient2, since, finite_check, toward_dark;
    for (std::size_t i = 0; i < simd::kLanes; ++i) {
      const Vec3 lever = Vec3(c.E_x[i], c.E_y[i], c.E_z[i]) - T;
      const EventMeasurement of_event = model.measure({c.g_x[i], c.g_y[i], c.g_z[i]}, lever, c.distance_px[i],
                                                      c.from_end_px2[i], kDarkSideKnown, c.polarity[i], c.contrast[i]);
      const double since_update_us = c.t[i] - t_us;
      residual2[i] = c.is_event[i] * of_event.residual2;
      lever2[i] = c.is_event[i] * of_event.lever2;
      gradient2[i] = c.is_event[i] * of_event.gradient2;
      finite_check[i] = residual2[i] * (lever2[i] * gradient2[i]);
      weights[i] = c.is_event[i] * of_event.weight;
      toward_dark[i] = of_event.toward_dark_px_per_s;
      since[i] = c.is_event[i] * (since_update_us > 0 ? since_update_us : 0);
#pragma GCC unroll 10
      for (std::size_t k = 0; k < MeasurementRows::kNumbers; ++k) rows[k][i] = of_event.row[k];
    }
    if (!(simd::sum(finite_check) < kInfinity)) return;  // none is added: one would never leave the running means
    measurements_.add(rows, weights, c.count);
    if (!at_rest())
      for (std::size_t i = 0; i < c.count; ++i) errors_.add(c.segment[i], rows[kResidual][i], weights[i]);
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
    if (at_rest()) {
      forget_events();
      return true;
    }
    const double dt = 1e-6 * us_since_update(t);
    const int count = measurements_.count();
    const double mean_dt = count > 0 ? std::min(1e-6 * statistics_.sums().since_us / count, dt) : dt;
    t_us_ = static_cast<double>(t);
    learn_from_events(count, dt);

    // The events were linearised at the pose before the prediction. So the predicted motion is not applied to the pose
    // yet, but is the prior mean of the error state.
    const Vec6 twist_before = state_.twist;
    ErrorState error;
    error.set_pose(predict_state(mean_dt));
    const bool good = measurements_.correct(state_.P, error, information_per_event());
    forget_events();
    if (count > 0) {
      corrected_translation_m2_ = state_.translation_variance();
      motion_.add_correction(twist_before, state_.twist, error.velocity(), dt, statistics_);
    }

    const Vec6 twist = state_.twist + error.velocity();
    const double lever2 = statistics_.lever2();
    const KalmanState::Lead lead = motion_.lead(twist, state_.speed_variance(lever2), dt - mean_dt, lever2);
    const Vec6 step = error.pose() + lead.motion;
    const Vec3 biases{error.b[kOffset], error.b[kTrail], error.b[kOffDelay]};
    if (!std::isfinite(squared_norm(step) + squared_norm(twist) + squared_norm(biases))) return false;

    perturb(T_camera_marker, step);
    if (steps_ % kStepsToMend == 0) {
      state_.P.symmetrize();
      measure_errors();  // slow, too, so as rarely
    }
    state_.twist = twist;
    state_.lead = lead;
    update_motion_of_model();
    correct_biases(error);
    return good;
  }

  /// Share of the events since the last `set_background` that come from moving edges, by their polarities.
  MovingShare moving_share() const noexcept { return polarities_.moving_share(); }
  /// Sets the background: its events weigh less, and do not count where the events bound the motion.
  void set_background(const MatchedBackground& background) noexcept {
    background_ = background;
    polarities_.clear();
    if (!at_rest()) errors_.add_noise_share(background.noise_share);
  }

  /// Switches on the bound of the motion by the number of events.
  /// @param per_px events that all edges together make while they move by a pixel
  /// @param per_passage events that one pixel makes while an edge passes over it
  void bound_motion_by_events(double per_px, double per_passage) noexcept {
    motion_.bound_by_events(per_px, per_passage);
  }

  /// Corrects the state, the pose and twist included, by a measurement of the trail with a standard deviation of a
  /// quarter of its value. The trail follows from the edge's width, which the spread of the residuals shows. Forgets
  /// the events since the last update.
  /// @param events_per_passage events that one pixel makes while an edge passes over it
  void measure_trail(Eigen::Isometry3d& T_camera_marker, double events_per_passage) noexcept {
    forget_events();
    const double trail_px = errors_.trail_by_width_px(statistics_.spread_px2(), px_per_s(), events_per_passage),
                 sigma_px = ModelMisfit::kTrailError * trail_px;
    MeasurementRow row{};
    row[6 + kTrail] = 1;
    row[kResidual] = trail_px - model_.bias[kTrail];
    measurements_.add(row, 1);
    errors_.forget_start();
    ErrorState error;
    if (measurements_.correct(state_.P, error, 1 / squared(sigma_px))) correct_biases(error);
    // The error is that at the state's own time; the velocity's correction also moves the pose, over the lead.
    const Vec6 of_lead = motion_.moved(error.velocity(), state_.lead.s);
    perturb(T_camera_marker, error.pose() + of_lead);
    state_.lead.motion = state_.lead.motion + of_lead;
    state_.twist = state_.twist + error.velocity();
    forget_events();
  }

  /// Moves the pose on to a later time with the present velocity, without a bound on the motion; its covariance grows.
  /// Forgets the events since the last update.
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    motion_.lift_bound();
    move_to(T_camera_marker, t);
  }

  /// Moves the pose on to a time until which all events have been added: their number bounds the motion, and at rest
  /// the pose and its covariance hold until then. Only for copies that predict a pose, and after a gap: at rest it
  /// moves the rule's time on, and a rule that goes on has to predict over the whole standstill at its next `update`.
  void advance_by_event_count(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    if (at_rest()) {
      forget_events();
      t_us_ = std::max(t_us_, static_cast<double>(t));
      return;
    }
    motion_.limit(state_, measurements_.count(), 1e-6 * us_since_update(t), background_.noise_per_s, statistics_);
    move_to(T_camera_marker, t);
  }

  /// Goes over to another pose, whose motions are J times those of the present one. It is trusted no more than a start
  /// pose: the initial variances are added. Forgets the events since the last update.
  void transform(const Matrix6d& J) noexcept {
    forget_events();
    state_.transform(J);
    for (int i = 0; i < 6; ++i) state_.P.xx(i, i) += initial_variance(i);
    corrected_translation_m2_ = state_.translation_variance();
    errors_.restart_motion();
    update_motion_of_model();
  }

  /// Says that another pose may be the right one, until the next call; it is part of the covariance.
  /// @param deviation perturbation to the other pose, times the square root of its probability; zero if there is none
  void set_other_pose(const Vec6& deviation) noexcept { to_other_pose_ = deviation; }

  void reverse() noexcept {
    forget_events();
    state_.reverse();
    model_.time_direction = -model_.time_direction;
    update_motion_of_model();
  }

  /// Covariance of the pose, see PoseEstimate.
  [[gnu::noinline]] Matrix6d covariance() const noexcept {
    Matrix6d P = covariance_by_events(errors_.delay_variance_s2(px_per_s()), errors_.misfit_px2());
    if (squared_norm(to_other_pose_) > 0) add_other_pose(P);
    return P;
  }
  /// The covariance without the part of another pose and, by default, without those of an unknown delay and of what the
  /// model does not explain.
  /// @param delay_s2 variance of an unknown delay, which shifts the pose along its twist [s^2]
  /// @param misfit_px2 see SystematicErrors
  [[gnu::always_inline]] Matrix6d covariance_by_events(double delay_s2 = 0, double misfit_px2 = 0) const noexcept {
    // By packs: the compiler would compute one element after the other, as P might overlap what it is computed from.
    using Column = simd::Pack<6, 128>;
    Matrix6d P;
    for (Eigen::Index k = 0; k < 6; ++k) Column(&state_.P.xx(0, k)).store(&P(0, k));
    if (const double lead_s = state_.lead.s; lead_s != 0) {  // from the state's own time to the pose's
      const auto [motion, q] = motion_.step(lead_s, state_.twist, statistics_);
      state_.add_motion(P, motion, q);
    }
    const std::array<double, 6> twist = state_.twist.array();
    const Column delayed((delay_s2 * state_.twist).array().data());
    const double scale = true_share_of_covariance(P.topLeftCorner<3, 3>().trace()),
                 edge_px2 = errors_.edge_variance_px2() + misfit_px2;
    for (Eigen::Index k = 0; k < 6; ++k) {
      Column column(&P(0, k));
      column.scale(scale);
      column.add(edge_px2, Column(&errors_.covariance_per_edge_px2()(0, k)));
      column.add(twist[static_cast<std::size_t>(k)], delayed);
      column.store(&P(0, k));
    }
    for (int k = 1; k < 6; ++k)  // symmetric to the last bit
      for (int i = 0; i < k; ++i) P(i, k) = P(k, i);
    return P;
  }
  Vector6d twist() const noexcept { return state_.twist; }
  /// How late events are, as far as is known [s]: the pose that they show was the marker's this long ago.
  double delay_s() const noexcept { return errors_.delay_s(); }
  /// Standard deviation [px] by which the pixels' response time spreads the events of moving edges now.
  double smear_px() const noexcept { return errors_.smear_px(px_per_s()); }
  /// By how much wider edges are than those of a focused sensor, see EdgeBlur.
  double blur() const noexcept { return errors_.blur(); }
  /// Sets within which distance of an edge events are matched; 2 at first.
  void set_max_distance_px(double distance_px) noexcept { errors_.set_max_distance_px(distance_px); }
  /// True once the edges have moved by their width since the start or `transform`: then the velocity is known. Until
  /// then the pose lags behind the marker.
  bool follows_motion() const noexcept { return errors_.edges_have_moved(); }
  /// See ModelMisfit.
  bool events_fill_distance() const noexcept { return errors_.events_fill_distance(); }
  /// Signed distance of an event from its edge, corrected for edge offset, trail and OFF delay [px].
  double residual_px(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) const noexcept {
    return model_.residual_px(c, Vec3(c.E) - translation(T_camera_marker));
  }
  /// How far on the dark side of an edge its events lie [px].
  double edge_offset_px() const noexcept { return model_.bias[kOffset]; }
  /// How far behind their moving edges events lie [px].
  double trail_px() const noexcept { return model_.bias[kTrail]; }
  /// How much later OFF events come than ON events [s].
  double off_delay_s() const noexcept { return 1e-3 * model_.bias[kOffDelay]; }

 private:
  static constexpr std::size_t kResidual = 6 + kBiases;   // in a row
  static constexpr unsigned kSampleEvery = simd::kLanes;  // of single events; of a batch, the first is sampled
  static constexpr double kLeastDeviation = 1e-3, kMostDeviation = 1e6;  // of a speed [px/s]: positive, and finite
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double squared(double x) noexcept { return x * x; }

  // All events are noise, whose residuals would tell of errors that the edges do not have.
  bool at_rest() const noexcept { return background_.signal_weight == 0; }

  [[gnu::always_inline]] void sample(const MeasurementRow& row, double weight, double polarity) noexcept {
    const Vec3 by_translation{row[0], row[1], row[2]}, by_rotation{row[3], row[4], row[5]};
    const double along_normal_px_per_s = dot(by_translation, state_.twist.t) + dot(by_rotation, state_.twist.r);
    if (!at_rest()) errors_.add_sample(row, weight);
    motion_.add_sample({row[0], row[1], row[2], row[3], row[4], row[5]}, along_normal_px_per_s);
    if (background_.signal_weight != 1) return;  // not surely events of moving edges: noise lies anywhere
    // Whether the polarity is the one that the motion makes. The row's trail has the sign of -s p, see
    // MeasurementModel; where it is 0, the dark side or the polarity is not known, and the event is taken to fit.
    const bool fits_motion = -row[6 + kTrail] * model_.time_direction * along_normal_px_per_s >= 0;
    errors_.add_moving_sample(row[kResidual], along_normal_px_per_s, fits_motion ? polarity : 0);
  }

  // Learns from the events of a step of length dt, and bounds its motion by their number.
  void learn_from_events(int count, double dt) noexcept {
    if (count > 0) {
      statistics_.update_means(count);
      model_.spread_px2 = statistics_.spread_px2();
      // By the number of events or, until it is known how many a passage has, by the velocity.
      const MotionBound& bound = motion_.bound();
      errors_.add_motion(bound.rates_known() ? bound.px(count) : px_per_s() * dt, statistics_.spread_px2());
    }
    motion_.add_events(count, dt, background_.signal_weight, state_, statistics_);
    motion_.limit(state_, count, dt, background_.noise_per_s, statistics_);
  }

  // Predicts the state from its own time, which is not the pose's, see KalmanState::Lead, to `after_pose_s` after the
  // pose. Returns the motion from the present pose to there.
  Vec6 predict_state(double after_pose_s) noexcept {
    const KalmanState::Lead lead = std::exchange(state_.lead, {});
    const double dt = lead.s + after_pose_s;
    // At the state's own time, as in updates at the same time or after reverse(): the state stays, and only the pose
    // goes back to it.
    if (dt == 0) return -1 * lead.motion;
    const auto [uncertainty, q] = motion_.step(dt, state_.twist, statistics_);
    const Vec6 moved = motion_.moved(state_.twist, dt);
    state_.predict(motion_.faded(state_.twist, moved, dt), uncertainty, q);
    state_.let_biases_drift(squared(settings_.offset_drift_px) * std::abs(dt), initial_bias_variances());
    return moved - lead.motion;
  }

  void move_to(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    forget_events();
    const double dt = 1e-6 * us_since_update(t);
    t_us_ = static_cast<double>(t);
    motion_.choose_fading(background_.signal_weight, state_, statistics_.lever2());
    perturb(T_camera_marker, predict_state(dt));
  }

  double information_per_event() const noexcept {
    constexpr double kPixelVariance = SystematicErrors::kPixelVariance;
    return background_.signal_weight /
           (squared(settings_.inflation) * std::max(statistics_.spread_px2(), kPixelVariance));
  }

  // By which the filter's covariance is multiplied. Its noises are larger than those of the events and of the motion,
  // so that sudden turns and wrong events do no harm. In the steady state of a filter with a velocity, three quarters
  // of the variance come from the events, whose noise has been measured, and a quarter from the motion. What has been
  // added since events last corrected it is of the motion alone.
  // @param translation_m2 variance of the translation
  double true_share_of_covariance(double translation_m2) const noexcept {
    constexpr double kByEvents = 0.75;
    constexpr double kOfMotion = 0.08;  // how much of the assumed noise there is on average, in simulated motions
    const double by_events = kByEvents * std::min(1.0, corrected_translation_m2_ / translation_m2);
    return by_events * errors_.event_noise() / squared(settings_.inflation) + (1 - by_events) * kOfMotion;
  }

  void forget_events() noexcept {
    measurements_.clear();
    statistics_.clear();
  }

  // An edge's events lie on its dark side, within its width, and behind it, by a whole contrast step at most. An offset
  // or a trail beyond that can only come from events of something else: amid leak events, or where pixels are slow, the
  // trail would grow without end.
  void correct_biases(const ErrorState& error) noexcept {
    // The root mean square residual, but at least half a pixel, however sharp the edge is.
    const double most_offset_px = std::sqrt(std::max(statistics_.spread_px2(), 0.25));
    model_.bias[kOffset] = std::clamp(model_.bias[kOffset] + error.b[kOffset], 0.0, most_offset_px);
    model_.bias[kTrail] = std::clamp(model_.bias[kTrail] + error.b[kTrail], 0.0, errors_.most_trail_px());
    constexpr double kMostSigmas = 5;  // no sensor's delays differ by more
    const double most_ms = kMostSigmas * 1e3 * settings_.initial_sigma_off_delay_s;
    model_.bias[kOffDelay] = std::clamp(model_.bias[kOffDelay] + error.b[kOffDelay], -most_ms, most_ms);
  }

  void measure_errors() noexcept {
    const MotionBound& bound = motion_.bound();
    errors_.measure(statistics_.spread_px2(), px_per_s(), background_.signal_weight == 1,
                    bound.rates_known() ? bound.events_per_passage() : 0, model_.bias[kTrail]);
    follow_blur();
  }

  // Residuals count within a distance that follows the edges' width. Where their events lie on average was learned of
  // those within the distance before, and may be off by as much as the edges turned out to be wider.
  void follow_blur() noexcept {
    const double robust_px = errors_.blur() * settings_.robust_px;
    if (robust_px == model_.robust_px) return;
    const double wider_px = EdgeBlur::kSharp_px * (robust_px - model_.robust_px) / settings_.robust_px;
    state_.let_biases_drift(squared(wider_px), initial_bias_variances());
    model_.robust_px = robust_px;
  }

  // Gives the model the motion: by it, it tells events of moving edges from noise, and where late ones lie.
  void update_motion_of_model() noexcept {
    model_.twist = state_.twist;
    model_.response_s = errors_.response_s();
    model_.by_chance_px_per_s =
        motion_.bound().px(background_.by_chance_per_s);  // events a second make pixels a second
    // Of the speed along one normal: a third of the variances, which are summed over three axes. At least the speed at
    // which an edge makes as many events as match it by chance: slower motion is not told from rest.
    const double variance = statistics_.gradient2() * state_.speed_variance(statistics_.lever2()) / 3;
    model_.speed_deviation_px_per_s =
        std::max({kLeastDeviation, model_.by_chance_px_per_s, std::min(std::sqrt(variance), kMostDeviation)});
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

  // Of element i of pose and velocity.
  double initial_variance(int i) const noexcept {
    const double sigmas[] = {settings_.initial_sigma_t_m, settings_.initial_sigma_r_rad, settings_.initial_sigma_v_m_s,
                             settings_.initial_sigma_w_rad_s};
    return squared(sigmas[i / 3]);
  }

  std::array<double, kBiases> initial_bias_variances() const noexcept {
    return {squared(settings_.initial_sigma_offset_px), squared(settings_.initial_sigma_trail_px),
            squared(1e3 * settings_.initial_sigma_off_delay_s)};
  }

  // In any direction, see AdaptiveMotion::px_per_s.
  double px_per_s() const noexcept { return motion_.px_per_s(state_.twist, statistics_); }

  // The second moment about this pose of two that may be right.
  void add_other_pose(Matrix6d& P) const noexcept {
    const std::array<double, 6> deviation = to_other_pose_.array();
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t i = 0; i < 6; ++i) P.data()[6 * k + i] += deviation[k] * deviation[i];
  }

  Settings settings_;
  KalmanState state_;
  // Since the last update. Next to the state: where both are 4 KiB apart, a processor takes loads of one for loads of
  // what it has just stored of the other, and waits: 7 % of the time with ten events an update.
  KalmanMeasurements measurements_;
  AdaptiveMotion motion_;
  MeasurementModel model_;
  SystematicErrors errors_;
  MeasurementStatistics statistics_;
  PolarityAgreement polarities_;  // since the last set_background
  // Time of the pose [us], exact to 2^53. Infinite before the first update, so that us_since_update() is 0.
  double t_us_ = kInfinity;
  MatchedBackground background_;
  unsigned single_events_ = 0;           // added one by one
  unsigned steps_ = 0;                   // of the pose
  Vec6 to_other_pose_;                   // see set_other_pose
  double corrected_translation_m2_ = 0;  // its variance, when the state was last corrected, or set
};

static_assert(BatchUpdateRule<KalmanUpdate> && NoiseAwareRule<KalmanUpdate> && MotionBoundingRule<KalmanUpdate> &&
              SensorEstimatingRule<KalmanUpdate> && MirrorableRule<KalmanUpdate>);

}  // namespace evmarker
