#pragma once
// Our rule: coupled point-to-line Kalman filter with velocity and edge offset.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/edge_scatter.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/motion_noise.hpp"
#include "evmarker/update/response_time.hpp"
#include "evmarker/update/update_rule.hpp"
#include "evmarker/update/velocity_memory.hpp"

namespace evmarker {

/// Error-state Kalman filter over [translation, rotation, velocity, angular velocity, edge offset, trail].
/// Perturbations act on the left, in the camera frame, rotations about the marker's origin.
///
/// Edge offset: how far [px] events lie on average toward the dark side of their edge. Pixels fire at equal steps of
/// the logarithm of light, and across a blurred edge most of these lie on the dark side. Ignored, it makes the marker
/// seem smaller and farther away. Trail: how far [px] events lie behind their moving edge, as a pixel fires only after
/// a whole contrast step. ON events come from edges that move toward the dark: they lie one trail toward the bright
/// side, OFF events one trail toward the dark side, whatever the motion. Ignored, it makes the pose lag behind the
/// marker.
class KalmanUpdate {
 public:
  using Settings = KalmanSettings;

  /// @throws std::invalid_argument naming the setting and its value
  KalmanUpdate(const Settings& settings, int events_per_update) : settings_(settings) {
    set_events_per_update(events_per_update);
    Require("kalman update")(events_per_update >= 1, "events_per_update", events_per_update);
    validate(settings);
    const double sigmas[] = {settings.initial_sigma_t_m, settings.initial_sigma_r_rad, settings.initial_sigma_v_m_s,
                             settings.initial_sigma_w_rad_s};
    for (int i = 0; i < 12; ++i) P_.xx(i, i) = squared(sigmas[i / 3]);
    for (std::size_t b = 0; b < kBiases; ++b) P_.bb[b][b] = initial_bias_variance(b);
    bias_px_[kTrail] = settings.initial_trail_px;
  }

  // The running means extend over 1000 events (spread2_px_, of the squared residuals) and 100 events (scales_, of lever
  // arm and gradient).
  void set_events_per_update(int events) noexcept {
    spread_share_ = 1 - std::pow(0.999, events);
    scales_share_ = 1 - std::pow(0.99, events);
  }

  /// Adds the measurement of one event.
  [[gnu::always_inline]] void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 lever = Vec3(c.E) - translation(T_camera_marker);
    const Measurement of_event =
        measurement(c.gradient, lever, c.distance_px, c.from_end_px2, c.dark_side_known ? 1 : 0, c.polarity);
    // What is not finite would stay in the means for ever. One comparison finds it; the rotation part of the row needs
    // none of its own: |lever x gradient| is at most |lever| |gradient|.
    if (!(of_event.residual2 * (of_event.lever2 * of_event.gradient2) < kInfinity)) return;
    measurements_.add(of_event.row, of_event.weight);
    edges_.add(c.segment, of_event.row[kResidual], of_event.weight);
    if (++sampled_ % kSampled == 0) sample(of_event.row, of_event.weight);
    sums_.residual2 += of_event.residual2;
    sums_.lever2 += of_event.lever2;
    sums_.gradient2 += of_event.gradient2;
    sums_.since_us += us_since_update(c.t);
  }

  /// Batch version.
  [[gnu::always_inline]] void add(const Correspondences& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 T = translation(T_camera_marker);
    const double t_us = t_us_;
    alignas(64) std::array<simd::Lanes, MeasurementRows::kNumbers> rows;
    alignas(64) simd::Lanes weights, residual2, lever2, gradient2, since, finite_check;
    for (std::size_t i = 0; i < simd::kLanes; ++i) {
      const Vec3 lever = Vec3(c.E_x[i], c.E_y[i], c.E_z[i]) - T;
      const Measurement of_event =
          measurement({c.g_x[i], c.g_y[i], c.g_z[i]}, lever, c.distance_px[i], c.from_end_px2[i], 1, c.polarity[i]);
      const double since_update_us = c.t[i] - t_us;
      residual2[i] = c.is_event[i] * of_event.residual2;
      lever2[i] = c.is_event[i] * of_event.lever2;
      gradient2[i] = c.is_event[i] * of_event.gradient2;
      finite_check[i] = residual2[i] * (lever2[i] * gradient2[i]);
      weights[i] = c.is_event[i] * of_event.weight;
      since[i] = c.is_event[i] * (since_update_us > 0 ? since_update_us : 0);
#pragma GCC unroll 9
      for (std::size_t k = 0; k < MeasurementRows::kNumbers; ++k) rows[k][i] = of_event.row[k];
    }
    if (!(simd::sum(finite_check) < kInfinity)) return;  // it would never leave the running means
    measurements_.add(rows, weights, c.count);
    for (std::size_t i = 0; i < c.count; ++i) edges_.add(c.segment[i], rows[kResidual][i], weights[i]);
    MeasurementRow sampled;
    for (std::size_t k = 0; k < MeasurementRows::kNumbers; ++k) sampled[k] = rows[k][0];
    sample(sampled, weights[0]);
    sums_.residual2 += simd::sum(residual2);
    sums_.lever2 += simd::sum(lever2);
    sums_.gradient2 += simd::sum(gradient2);
    sums_.since_us += simd::sum(since);
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
    const double mean_dt = count > 0 ? std::min(1e-6 * sums_.since_us / count, dt) : dt;
    if (count > 0) update_running_means(count);
    if (events_per_px_ > 0) moved_px_ += count / events_per_px_;
    if (moved_px_ > kEvaluationSpreads * std::sqrt(spread2_px_)) evaluate_residuals();
    t_us_ = static_cast<double>(t);
    choose_velocity_memory(count, dt);
    limit_motion(count, dt);
    // The events were linearised at the pose before the prediction. So the predicted motion is not applied to the pose
    // yet, but is the prior mean of the error state.
    const Vec6 predicted_motion = predict_state(mean_dt);
    ErrorState error;
    set_pose(error, predicted_motion);

    const double information_per_event =
        signal_weight_ / (squared(settings_.inflation) * std::max(spread2_px_, kPixelVariance));
    const bool good = measurements_.correct(P_, error, information_per_event);
    forget_events();

    Vec6 step = pose(error);
    const Vec6 twist = twist_ + velocity(error);
    if (count > 0) motion_noise_.add(velocity(error), dt, averaging_time());
    const double edge_speed = norm(twist.t) + std::sqrt(scales_.lever2) * norm(twist.r);
    // From the state's time, the mean of the events', to t; but no farther than the motion is bounded to.
    const double lead_s = std::min(dt - mean_dt, most_motion_m_ / edge_speed);
    if (lead_s != 0) step = step + motion(lead_s).pose_by_velocity * twist;
    const Vec2 biases{error.b[kOffset], error.b[kTrail]};
    if (!std::isfinite(squared_norm(step) + squared_norm(twist) + squared_norm(biases))) return false;

    perturb(T_camera_marker, step);
    if (steps_ % kStepsToMend == 0) P_.symmetrize();
    twist_ = twist;
    lead_s_ = lead_s;
    correct_biases(error);
    return good;
  }

  /// @param weight of the events' information: 1 if at least half of them are surely of moving edges, 0 at rest
  void set_signal_weight(double weight) noexcept { signal_weight_ = weight; }

  /// Switches on the bound of the motion by the number of events.
  /// @param per_px events that all edges together make while they move by a pixel
  /// @param per_passage events that one pixel makes while an edge passes over it
  void bound_motion_by_events(double per_px, double per_passage) noexcept {
    events_per_px_ = per_px;
    events_per_passage_ = per_passage;
  }

  /// Corrects the state, the pose and twist included, by a measurement of the trail with a standard deviation of a
  /// quarter of its value. The trail follows from the edge's width, which the spread of the residuals shows. Forgets
  /// the events since the last update.
  /// @param events_per_passage events that one pixel makes while an edge passes over it
  void measure_trail(Eigen::Isometry3d& T_camera_marker, double events_per_passage) noexcept {
    forget_events();
    const double trail_px = expected_trail_px(edge_width_px(), events_per_passage), sigma_px = kTrailError * trail_px;
    MeasurementRow row{};
    row[6 + kTrail] = 1;
    row[6 + kBiases] = trail_px - bias_px_[kTrail];
    measurements_.add(row, 1);
    ErrorState error;
    if (measurements_.correct(P_, error, 1 / squared(sigma_px))) correct_biases(error);
    perturb(T_camera_marker, pose(error));
    twist_ = twist_ + velocity(error);
    forget_events();
  }

  /// Moves the pose on to a later time with the present velocity, without a bound on the motion; its covariance grows.
  /// Forgets the events since the last update.
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    most_motion_m_ = kInfinity;
    move_to(T_camera_marker, t);
  }

  /// Moves the pose on to a time until which all events have been added: their number bounds the motion, and at rest
  /// the pose and its covariance hold until then. Only for copies that predict a pose: it moves the time of a rule at
  /// rest, which its next `update` needs to predict over the whole standstill.
  void advance_by_event_count(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    if (signal_weight_ == 0) {
      forget_events();
      t_us_ = std::max(t_us_, static_cast<double>(t));
      return;
    }
    limit_motion(measurements_.count(), 1e-6 * us_since_update(t));
    move_to(T_camera_marker, t);
  }

  void reverse() noexcept {
    forget_events();
    lead_s_ = -lead_s_;  // in mirrored time, the mean time of the last events is after the pose
    scale_velocity(-1);
  }

  /// Covariance of the pose, see PoseEstimate.
  [[gnu::noinline]] Matrix6d covariance() const noexcept {
    Matrix6d P;
    for (int k = 0; k < 6; ++k)
      for (int i = 0; i < 6; ++i) P(i, k) = P_.xx(i, k);
    if (lead_s_ != 0) add_motion(P, lead_s_);
    // An unknown delay of variance delay_s2 shifts the pose along its twist.
    const double delay_s2 = delay_variance_s2();
    const std::array<double, 6> twist = twist_.array(), delayed = (delay_s2 * twist_).array();
    const Matrix6d& edge_covariance = edges_.covariance();
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t i = 0; i < 6; ++i) {
        double& element = P.data()[6 * k + i];
        element = settings_.covariance_scale * element + edge_covariance.data()[6 * k + i] + twist[k] * delayed[i];
      }
    for (int k = 1; k < 6; ++k)  // symmetric to the last bit
      for (int i = 0; i < k; ++i) P(i, k) = P(k, i);
    return P;
  }
  Vector6d twist() const noexcept { return twist_; }
  /// By how much events are late, as far as it is known [s]: a pose that they show is that of so much earlier.
  double delay_s() const noexcept { return settings_.latency_s + response_time_.delay_s(); }
  /// Signed distance of an event from its edge, corrected for edge offset and trail [px].
  [[gnu::always_inline]] double residual_px(const Correspondence& c) const noexcept {
    return residual_px(c.distance_px, c.dark_side_known ? 1 : 0, c.polarity);
  }
  /// How far on the dark side of an edge its events lie [px].
  double edge_offset_px() const noexcept { return bias_px_[kOffset]; }
  /// How far behind their moving edges events lie [px].
  double trail_px() const noexcept { return bias_px_[kTrail]; }

 private:
  static constexpr std::size_t kOffset = 0, kTrail = 1;  // biases
  static constexpr std::size_t kResidual = 6 + kBiases;  // in a row
  static constexpr unsigned kSampled = simd::kLanes;     // one of so many events is sampled
  // Motion between evaluations of the residuals, in standard deviations of the events' places: two to three times the
  // width of an edge.
  static constexpr double kEvaluationSpreads = 8;
  static constexpr double kPixelVariance = 1.0 / 12;  // of a coordinate that is rounded to whole pixels [px^2]
  static constexpr double kTrailError = 0.25;         // relative, of the trail that the edge's width tells
  static constexpr double kSmallestLever2 = 1e-8;     // [m^2]
  // How far a blurred corner is round, three times the spread of the events, squared; and what an event there counts: a
  // fifth is enough to estimate the trail from edges that move along their own direction.
  static constexpr double kCornerSpreads2 = 9, kCornerWeight = 0.2;
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double squared(double x) noexcept { return x * x; }

  struct Measurement {
    MeasurementRow row;
    double weight, residual2, lever2, gradient2;
  };

  // One event's row [J; d] of d = J [pose; biases]: J = [g, (E - T) x g, s, -s p], with a Cauchy weight.
  // g = d(n.u) / dE, u the image of E, n the edge's normal [px/m]; s: 1 if it is known on which side the edge is
  // dark; p: polarity. Blur rounds the corners at an edge's ends: there, events lie up to half a pixel farther inside
  // of the corner. If they counted like others, markers would seem nearer than they are.
  [[gnu::always_inline]] Measurement measurement(Vec3 g, Vec3 lever, double distance_px, double from_end_px2, double s,
                                                 double p) const noexcept {
    const Vec3 by_rotation = cross(lever, g);
    const double residual = residual_px(distance_px, s, p), residual2 = residual * residual;
    const double robust2 = settings_.robust_px * settings_.robust_px, corner2 = kCornerSpreads2 * spread2_px_;
    return {{g.x, g.y, g.z, by_rotation.x, by_rotation.y, by_rotation.z, s, -s * p, residual},
            (from_end_px2 < corner2 ? kCornerWeight : 1) * robust2 / (robust2 + residual2),
            residual2,
            squared_norm(lever),
            squared_norm(g)};
  }

  [[gnu::always_inline]] double residual_px(double distance_px, double s, double p) const noexcept {
    return distance_px - s * bias_px_[kOffset] + s * p * bias_px_[kTrail];
  }

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
    perturb(T_camera_marker, predict_state(dt));
  }

  void forget_events() noexcept {
    measurements_.clear();
    sums_ = {};
  }

  void correct_biases(const ErrorState& error) noexcept {
    // An edge's events lie on its dark side, within its width, and behind it. A bias outside of these limits would come
    // from other events.
    bias_px_[kOffset] = std::clamp(bias_px_[kOffset] + error.b[kOffset], 0.0, max_offset_px());
    bias_px_[kTrail] = std::max(0.0, bias_px_[kTrail] + error.b[kTrail]);
  }

  [[gnu::always_inline]] void sample(const MeasurementRow& row, double weight) noexcept {
    edges_.add_row({row[0], row[1], row[2], row[3], row[4], row[5], row[6]}, weight);
    const Vec3 by_translation{row[0], row[1], row[2]}, by_rotation{row[3], row[4], row[5]};
    const double px_per_s = dot(by_translation, twist_.t) + dot(by_rotation, twist_.r);
    if (signal_weight_ == 1) response_time_.add(row[kResidual], px_per_s);  // noise at rest spreads anywhere
    velocity_memory_.add_speed(px_per_s);
  }

  [[gnu::noinline]] void evaluate_residuals() noexcept {
    edges_.evaluate();
    response_time_.evaluate();
    moved_px_ = 0;
  }

  // Events lie evenly over the edge's width w, variance w^2 / 12, and each is known to a pixel only.
  double edge_width_px() const noexcept {
    return std::sqrt(12 * std::max(spread2_px_ - kPixelVariance, kPixelVariance));
  }

  // Variance of the time by which the pose is late, of which the filter itself knows nothing: motion alone cannot tell
  // it from another pose.
  double delay_variance_s2() const noexcept {
    const double px_per_s = std::sqrt(scales_.gradient2) * speed(rotation_speed());
    const double trail_s2 = px_per_s > 0 ? trail_variance_px2() / (px_per_s * px_per_s) : 0;
    return squared(settings_.latency_sigma_s) + response_time_.delay_variance_s2() + trail_s2;
  }

  // The trail is estimated twice, by the filter and by the edges' width: what is not known of it shows in the
  // difference. Where it is not known which side of an edge is dark, the filter does not correct it.
  double trail_variance_px2() const noexcept {
    if (!(events_per_px_ > 0)) return 0;  // before it is measured, the filter's own covariance has it
    const double expected_px = expected_trail_px(edge_width_px(), events_per_passage_);
    return squared(kTrailError * expected_px) +
           squared(edges_.share_of_known_dark_sides() * bias_px_[kTrail] - expected_px);
  }

  // The root mean square residual, but at least half a pixel, however sharp the edge is.
  double max_offset_px() const noexcept { return std::sqrt(std::max(spread2_px_, 0.25)); }

  void update_running_means(int count) noexcept {
    const double share = scales_known_ ? scales_share_ : 1;
    spread2_px_ += spread_share_ * (sums_.residual2 / count - spread2_px_);
    scales_.lever2 += share * (sums_.lever2 / count - scales_.lever2);
    scales_.gradient2 += share * (sums_.gradient2 / count - scales_.gradient2);
    scales_known_ = true;
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

  double initial_bias_variance(std::size_t bias) const noexcept {
    return squared(bias == kOffset ? settings_.initial_sigma_offset_px : settings_.initial_sigma_trail_px);
  }

  MotionStep motion(double dt) const noexcept { return dt != 0 ? motion_step(dt, velocity_memory_s_) : MotionStep(); }

  void choose_velocity_memory(int events, double dt) noexcept {
    velocity_memory_.add(events, events_per_px_, dt, scales_share_);
    velocity_memory_s_ = settings_.velocity_memory_s;
    if (signal_weight_ < 1) return;  // noise would confirm the small velocity that it makes itself
    const double lever2 = scales_.lever2, of_translation = P_.xx(6, 6) + P_.xx(7, 7) + P_.xx(8, 8),
                 of_rotation = P_.xx(9, 9) + P_.xx(10, 10) + P_.xx(11, 11);
    velocity_memory_s_ = velocity_memory_.time_constant(
        settings_.velocity_memory_s, settings_.confirmed_velocity_memory_s,
        squared_norm(twist_.t) + lever2 * squared_norm(twist_.r), of_translation + lever2 * of_rotation);
  }

  // How fast rotation moves the edges, and how fast they move altogether [m/s].
  double rotation_speed() const noexcept { return std::sqrt(scales_.lever2 * squared_norm(twist_.r)); }
  double speed(double rotation_speed) const noexcept { return norm(twist_.t) + rotation_speed; }
  // Time over which MotionNoise averages [s]. While an edge passes over a pixel, its events lie first on one side of it
  // and then on the other: over the way of a few pixels that cancels. A hand keeps an acceleration no longer than
  // kLongest_s.
  double averaging_time() const noexcept {
    constexpr double kWay_px = 4, kLongest_s = 0.05;
    const double px_per_s = std::sqrt(scales_.gradient2) * speed(rotation_speed());
    return kWay_px / std::max(px_per_s, kWay_px / kLongest_s);
  }
  // White acceleration of a motion that changes its velocity within `turning_distance_m` [m^2/s^3].
  double turning_noise(double speed) const noexcept { return speed * speed * speed / settings_.turning_distance_m; }

  // Density of the white acceleration along each axis, see KalmanSettings.
  std::array<double, 6> acceleration() const noexcept {
    const double rotation_speed = this->rotation_speed();
    const double of_edges = settings_.acceleration_noise + turning_noise(speed(rotation_speed));
    const double by_rotation = settings_.rotation_share * of_edges + turning_noise(rotation_speed);
    const double translation = motion_noise_.translation(of_edges);
    const double rotation = motion_noise_.rotation(by_rotation / std::max(scales_.lever2, kSmallestLever2));
    return {translation, translation, translation, rotation, rotation, rotation};
  }

  // Bounds the motion of the edges during dt by the number of events, noise among them: few events mean little motion.
  // If the velocity takes the edges beyond the bound, or the standard deviation of its translational part does, twist
  // and the velocity's covariance are scaled down to it.
  void limit_motion(int events, double dt) noexcept {
    most_motion_m_ = kInfinity;
    if (!(events_per_px_ > 0 && scales_known_)) return;
    constexpr double kSafety = 6;  // for edges parallel to the motion, hidden ones, and fewer events of fast ones
    // Events come in passages of c = events_per_passage_, so their number N has the variance N c. One passage is added
    // to N, which may be 0.
    const double deviation = std::sqrt((events + events_per_passage_) * events_per_passage_);
    most_motion_m_ = kSafety * (events + 3 * deviation) / (events_per_px_ * std::sqrt(scales_.gradient2));
    const double velocity_sigma = std::sqrt(P_.xx(6, 6) + P_.xx(7, 7) + P_.xx(8, 8));
    const double expected = motion(dt).pose_by_velocity * std::max(speed(rotation_speed()), velocity_sigma);
    if (expected > most_motion_m_) scale_velocity(most_motion_m_ / expected);
  }

  void scale_velocity(double factor) noexcept {
    twist_ = factor * twist_;
    for (int k = 0; k < 6; ++k)
      for (int i = 0; i < 6; ++i) {
        P_.xx(i, 6 + k) *= factor;
        P_.xx(6 + k, i) *= factor;
        P_.xx(6 + i, 6 + k) *= factor * factor;
      }
    for (Vector12d& column : P_.xb)
      for (int i = 6; i < 12; ++i) column(i) *= factor;
  }

  // The process noise of a step, limited to the bound of `limit_motion` and to ten turns of the marker: then nothing is
  // known any more, and beside the larger variances of a pause of years rounding would leave a covariance that is not
  // definite.
  MotionStep bounded(MotionStep motion, double acceleration) const noexcept {
    constexpr double kTenTurns = 20 * std::numbers::pi;
    const double lever2 = scales_known_ ? std::max(scales_.lever2, kSmallestLever2) : kInfinity;
    const double most2 = std::min(most_motion_m_ * most_motion_m_, kTenTurns * kTenTurns * lever2);
    const double pose = acceleration * motion.q_pose;
    if (!(pose > most2)) return motion;
    motion.q_pose *= most2 / pose;
    motion.q_cross *= std::sqrt(most2 / pose);
    return motion;
  }

  // Adds to a covariance of the pose what a prediction by dt adds to it: the pose's block of F P F^T + Q.
  void add_motion(Matrix6d& P, double dt) const noexcept {
    const std::array<double, 6> q = acceleration();
    const MotionStep motion = bounded(this->motion(dt), q[0]);
    for (int k = 0; k < 6; ++k) {
      for (int i = 0; i < 6; ++i)
        P(i, k) += motion.pose_by_velocity *
                   (P_.xx(6 + i, k) + P_.xx(i, 6 + k) + motion.pose_by_velocity * P_.xx(6 + i, 6 + k));
      P(k, k) += motion.q_pose * q[static_cast<std::size_t>(k)];
    }
  }

  // Predicts the state (P_, twist_) from its own time, lead_s_ before the pose, to `after_pose_s` after the pose.
  // Returns the motion from the present pose to there.
  Vec6 predict_state(double after_pose_s) noexcept {
    const double dt = lead_s_ + after_pose_s, moved_already = motion(lead_s_).pose_by_velocity;
    lead_s_ = 0;
    // At the state's own time, as in updates at the same time or after reverse(): the state stays, and only the pose
    // goes back to it.
    if (dt == 0) return -moved_already * twist_;
    const std::array<double, 6> q = acceleration();
    const MotionStep motion = bounded(this->motion(dt), q[0]);
    simd::in_packs([&](auto bits) __attribute__((always_inline)) { P_.predict<bits>(motion, q); });
    for (std::size_t b = 0; b < kBiases; ++b) {  // never less known than at first
      const double drifted = P_.bb[b][b] + squared(settings_.offset_drift_px) * std::abs(dt);
      P_.bb[b][b] = std::max(P_.bb[b][b], std::min(drifted, initial_bias_variance(b)));
    }
    const Vec6 moved = (motion.pose_by_velocity - moved_already) * twist_;
    twist_ = motion.velocity_kept * twist_;
    return moved;
  }

  Settings settings_;
  ErrorCovariance P_;
  Vec6 twist_;
  std::array<double, kBiases> bias_px_{};  // edge offset, trail
  double most_motion_m_ = kInfinity;       // bound of the edges' motion since the last update, see limit_motion
  double signal_weight_ = 1;               // see set_signal_weight
  double events_per_passage_ = 1;
  double events_per_px_ = 0;  // that all edges make while they move by a pixel; 0: not known
  unsigned steps_ = 0;
  MotionNoise motion_noise_;
  VelocityMemory velocity_memory_;
  double velocity_memory_s_ = settings_.velocity_memory_s;  // now
  KalmanMeasurements measurements_;                         // since the last update
  double spread2_px_ = 1;                                   // running mean of the squared residuals [px^2]
  struct Scales {
    double lever2 = 0, gradient2 = 0;
  };
  Scales scales_;  // running means of |E - T|^2 [m^2] and |gradient|^2 [px^2/m^2]
  bool scales_known_ = false;
  double spread_share_ = 0, scales_share_ = 0;  // weight of the next update in the running means
  struct Sums {
    double residual2 = 0, lever2 = 0, gradient2 = 0, since_us = 0;
  };
  Sums sums_;  // over the events since the last update; since_us: of their times after it
  EdgeScatter edges_;
  ResponseTime response_time_;
  unsigned sampled_ = 0;  // events added one by one
  double moved_px_ = 0;   // by the edges, since the residuals were evaluated
  double lead_s_ = 0;     // from the filter's state, which is at the mean time of its last events, to the pose
  // Time of the pose [us], exact to 2^53. Infinite before the first update, so that us_since_update() is 0.
  double t_us_ = kInfinity;
};

static_assert(MotionEstimatingRule<KalmanUpdate> && BatchUpdateRule<KalmanUpdate>);

}  // namespace evmarker
