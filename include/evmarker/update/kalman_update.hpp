#pragma once
// Our rule: coupled point-to-line Kalman filter with velocity and edge offset.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// Error-state filter over [translation, rotation, velocity, angular velocity, edge offset, trail], perturbations as in
/// PoseEstimate. The edge offset is how far [px] on the dark side of an edge its events lie on average: pixels fire on
/// steps of the logarithm of light, and those crowd where it is dark. Left out, it makes the marker seem smaller and
/// farther away. The trail is how far [px] behind a moving edge they lie: a pixel fires only when a whole step has been
/// passed. An edge that moves toward the dark makes ON events, so these lie that much nearer to the bright side than
/// OFF events, whichever way the marker moves. Left out, the pose trails the marker.
class KalmanUpdate {
 public:
  using Settings = KalmanSettings;

  /// @throws std::invalid_argument naming the setting and its value
  KalmanUpdate(const Settings& settings, int events_per_update) : settings_(settings) {
    set_events_per_update(events_per_update);
    const Require require("kalman update");
    require(events_per_update >= 1, "events_per_update", events_per_update);
    require.positive(settings.inflation, "inflation");
    require.positive(settings.robust_px, "robust_px");
    require.positive(settings.acceleration_noise, "acceleration_noise");
    require.positive(settings.turning_distance_m, "turning_distance_m");
    require.positive(settings.rotation_share, "rotation_share");
    require.positive(settings.velocity_memory_s, "velocity_memory_s");
    require.positive(settings.offset_drift_px, "offset_drift_px");
    require.positive(settings.latency_sigma_s, "latency_sigma_s");
    require.positive(settings.trail_sigma_px, "trail_sigma_px");
    require.positive(settings.covariance_scale, "covariance_scale");
    require.positive(settings.initial_sigma_t_m, "initial_sigma_t_m");
    require.positive(settings.initial_sigma_r_rad, "initial_sigma_r_rad");
    require.positive(settings.initial_sigma_v_m_s, "initial_sigma_v_m_s");
    require.positive(settings.initial_sigma_w_rad_s, "initial_sigma_w_rad_s");
    require.positive(settings.initial_sigma_offset_px, "initial_sigma_offset_px");
    require.positive(settings.initial_sigma_trail_px, "initial_sigma_trail_px");
    const double sigmas[] = {settings.initial_sigma_t_m, settings.initial_sigma_r_rad, settings.initial_sigma_v_m_s,
                             settings.initial_sigma_w_rad_s};
    for (int i = 0; i < 12; ++i) P_.xx(i, i) = squared(sigmas[i / 3]);
    P_.bb[kOffset][kOffset] = squared(settings.initial_sigma_offset_px);
    P_.bb[kTrail][kTrail] = squared(settings.initial_sigma_trail_px);
  }

  void set_events_per_update(int events) noexcept {
    spread_share_ = 1 - std::pow(0.999, events);
    scales_share_ = 1 - std::pow(0.99, events);
  }

  /// Adds the measurement of one event.
  [[gnu::always_inline]] void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 lever = Vec3(c.E) - translation(T_camera_marker);
    const Measurement of_event = measurement(c.gradient, lever, c.distance_px, c.dark_side_known ? 1 : 0, c.polarity);
    // Not finite, in one comparison: it would stay for ever. |turning| is at most |lever| |gradient|.
    if (!(of_event.residual2 * (of_event.lever2 * of_event.gradient2) < kInfinity)) return;
    measurements_.add(of_event.row, of_event.weight);
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
    alignas(64) simd::Lanes weights, residual2, lever2, gradient2, since, product;
    for (std::size_t i = 0; i < simd::kLanes; ++i) {
      const Vec3 lever = Vec3(c.E_x[i], c.E_y[i], c.E_z[i]) - T;
      const Measurement of_event =
          measurement({c.g_x[i], c.g_y[i], c.g_z[i]}, lever, c.distance_px[i], 1, c.polarity[i]);
      const double late_us = c.t[i] - t_us;
      residual2[i] = c.is_event[i] * of_event.residual2;
      lever2[i] = c.is_event[i] * of_event.lever2;
      gradient2[i] = c.is_event[i] * of_event.gradient2;
      product[i] = residual2[i] * (lever2[i] * gradient2[i]);
      weights[i] = c.is_event[i] * of_event.weight;
      since[i] = c.is_event[i] * (late_us > 0 ? late_us : 0);
#pragma GCC unroll 9
      for (std::size_t k = 0; k < MeasurementRows::kNumbers; ++k) rows[k][i] = of_event.row[k];
    }
    if (!(simd::sum(product) < kInfinity)) return;
    measurements_.add(rows, weights, c.count);
    sums_.residual2 += simd::sum(residual2);
    sums_.lever2 += simd::sum(lever2);
    sums_.gradient2 += simd::sum(gradient2);
    sums_.since_us += simd::sum(since);
  }

  [[gnu::noinline]] bool update(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    if (signal_ == 0) {  // at rest: the first update after it bridges all of it
      forget_events();
      return true;
    }
    const double dt = 1e-6 * us_since_update(t);
    const int count = measurements_.count();
    const double mean_dt = count > 0 ? std::min(1e-6 * sums_.since_us / count, dt) : dt;
    if (count > 0) average(count);
    t_us_ = static_cast<double>(t);
    limit_motion(count, dt);
    ErrorState error;
    set_pose(error, predict(mean_dt));

    const double per_event = signal_ / (squared(settings_.inflation) * std::max(spread2_px_, kPixelVariance));
    const bool good = measurements_.correct(P_, error, per_event);
    forget_events();

    Vec6 step = pose(error);
    const Vec6 twist = twist_ + velocity(error);
    const double edge_speed = norm(twist.t) + std::sqrt(scales_.lever2) * norm(twist.r);
    const double lead_s = std::min(dt - mean_dt, most_motion_m_ / edge_speed);
    if (lead_s != 0) step = step + motion(lead_s).carried * twist;
    const Vec2 biases{error.b[kOffset], error.b[kTrail]};
    if (!good || !std::isfinite(squared_norm(step) + squared_norm(twist) + squared_norm(biases))) return false;

    perturb(T_camera_marker, step);
    twist_ = twist;
    lead_s_ = lead_s;
    correct_biases(error);
    return true;
  }

  /// @param share of the matched events that are the marker's; 0 at rest
  void expect_signal(double share) noexcept { signal_ = share; }

  /// Sets how many events all edges make while they move by a pixel, and how many of these one pixel makes in a
  /// passage. From here on, few events mean little motion.
  void set_events_per_px(double events, double together) noexcept {
    events_per_px_ = events;
    events_together_ = together;
  }

  /// Takes a measurement of the trail: by the number of events that a pixel makes while an edge passes over it, and by
  /// their spread. Forgets the events since the last update.
  void expect_events_per_px2(Eigen::Isometry3d& T_camera_marker, double events) noexcept {
    forget_events();
    // Events lie evenly over the edge's width, variance w^2 / 12, and each is known to a pixel only.
    const double width_px = std::sqrt(12 * std::max(spread2_px_ - kPixelVariance, kPixelVariance));
    const double trail_px = expected_trail_px(width_px, events), sigma_px = 0.25 * trail_px;
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

  /// Moves the pose on to a later time with the present velocity; its covariance grows. Forgets the events since the
  /// last update.
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    most_motion_m_ = kInfinity;
    advance(T_camera_marker, t);
  }

  /// Moves the pose on to a time until which the marker made no other events: it can hardly have moved.
  void wait(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    if (signal_ == 0) {
      forget_events();
      t_us_ = std::max(t_us_, static_cast<double>(t));
      return;
    }
    limit_motion(measurements_.count(), 1e-6 * us_since_update(t));
    advance(T_camera_marker, t);
  }

  void reverse() noexcept {
    forget_events();
    lead_s_ = -lead_s_;
    scale_velocity(-1);
  }

  /// Covariance of the pose, see PoseEstimate.
  [[gnu::noinline]] Matrix6d covariance() const noexcept {
    Matrix6d P;
    for (int k = 0; k < 6; ++k)
      for (int i = 0; i < 6; ++i) P(i, k) = P_.xx(i, k);
    if (lead_s_ != 0) add_motion(P, lead_s_);
    const double speed = this->speed(rotation_speed());
    const double trail_s = speed > 0 ? settings_.trail_sigma_px / (std::sqrt(scales_.px_per_m2) * speed) : 0;
    const double delay_s2 = squared(settings_.latency_sigma_s) + trail_s * trail_s;
    const std::array<double, 6> twist = twist_.array(), delayed = (delay_s2 * twist_).array();
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t i = 0; i < 6; ++i) {
        double& element = P.data()[6 * k + i];
        element = settings_.covariance_scale * element + twist[k] * delayed[i];
      }
    return P;
  }
  Vector6d twist() const noexcept { return twist_; }
  /// How far an event lies from where its edge makes events.
  [[gnu::always_inline]] double residual_px(const Correspondence& c) const noexcept {
    return residual_px(c.distance_px, c.dark_side_known ? 1 : 0, c.polarity);
  }
  /// How far on the dark side of an edge its events lie [px].
  double edge_offset_px() const noexcept { return bias_px_[kOffset]; }
  /// How far behind their moving edges events lie [px].
  double trail_px() const noexcept { return bias_px_[kTrail]; }

 private:
  static constexpr std::size_t kOffset = 0, kTrail = 1;  // biases
  static constexpr double kPixelVariance = 1.0 / 12;     // of a place of which only the pixel is known
  static constexpr double kSmallestLever2 = 1e-8;        // [m^2]
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr double squared(double x) noexcept { return x * x; }

  struct Measurement {
    MeasurementRow row;
    double weight, residual2, lever2, gradient2;
  };

  // One event's row [J; d] of d = J [pose; biases]: J = [g, (E - T) x g, s, -s p], with a Cauchy weight.
  // g: how its edge moves along the image normal; s: 1 if it is known on which side the edge is dark; p: polarity.
  [[gnu::always_inline]] Measurement measurement(Vec3 g, Vec3 lever, double distance_px, double s,
                                                 double p) const noexcept {
    const Vec3 turning = cross(lever, g);
    const double residual = residual_px(distance_px, s, p), residual2 = residual * residual;
    const double robust2 = settings_.robust_px * settings_.robust_px;
    return {{g.x, g.y, g.z, turning.x, turning.y, turning.z, s, -s * p, residual},
            robust2 / (robust2 + residual2),
            residual2,
            squared_norm(lever),
            squared_norm(g)};
  }

  [[gnu::always_inline]] double residual_px(double distance_px, double s, double p) const noexcept {
    return distance_px - s * bias_px_[kOffset] + s * p * bias_px_[kTrail];
  }

  static Vec6 pose(const ErrorState& error) noexcept { return of(error, 0); }
  static Vec6 velocity(const ErrorState& error) noexcept { return of(error, 6); }
  static Vec6 of(const ErrorState& error, Eigen::Index i) noexcept {
    const auto& x = error.x;
    return {{x(i), x(i + 1), x(i + 2)}, {x(i + 3), x(i + 4), x(i + 5)}};
  }
  static void set_pose(ErrorState& error, const Vec6& pose) noexcept {
    const std::array<double, 6> all = pose.array();
    std::copy(all.begin(), all.end(), error.x.data());
  }

  void advance(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    forget_events();
    const double dt = 1e-6 * us_since_update(t);
    t_us_ = static_cast<double>(t);
    perturb(T_camera_marker, predict(dt));
  }

  void forget_events() noexcept {
    measurements_.clear();
    sums_ = {};
  }

  void correct_biases(const ErrorState& error) noexcept {
    // An edge makes events on its dark side, within its own width, and behind itself. Those that would have it
    // otherwise are not its own.
    bias_px_[kOffset] = std::clamp(bias_px_[kOffset] + error.b[kOffset], 0.0, half_width_px());
    bias_px_[kTrail] = std::max(0.0, bias_px_[kTrail] + error.b[kTrail]);
  }

  // Of an edge in the image, by how far its events are spread; half of a pixel at least, however sharp it is.
  double half_width_px() const noexcept { return std::sqrt(std::max(spread2_px_, 0.25)); }

  void average(int count) noexcept {
    const double share = scales_known_ ? scales_share_ : 1;
    spread2_px_ += spread_share_ * (sums_.residual2 / count - spread2_px_);
    scales_.lever2 += share * (sums_.lever2 / count - scales_.lever2);
    scales_.px_per_m2 += share * (sums_.gradient2 / count - scales_.px_per_m2);
    scales_known_ = true;
  }

  // Rounding takes a rotation off SO(3) by 1e-16 a step: to mend that at every step took longer than the step.
  void perturb(Eigen::Isometry3d& T, const Vec6& step) noexcept {
    set_translation(T, translation(T) + step.t);
    if (++steps_ % 16 == 0) orthonormalize(T);
    turn(T, step.r);
  }

  double us_since_update(Timestamp t) const noexcept { return std::max(0.0, static_cast<double>(t) - t_us_); }

  MotionStep motion(double dt) const noexcept {
    return dt != 0 ? motion_step(dt, settings_.velocity_memory_s) : MotionStep();
  }

  // How fast rotation moves the edges, and how fast they move altogether [m/s].
  double rotation_speed() const noexcept { return std::sqrt(scales_.lever2 * squared_norm(twist_.r)); }
  double speed(double rotation_speed) const noexcept { return norm(twist_.t) + rotation_speed; }
  double turning_noise(double speed) const noexcept { return speed * speed * speed / settings_.turning_distance_m; }

  // Density of the white acceleration along each axis, see KalmanSettings.
  std::array<double, 6> acceleration() const noexcept {
    const double rotation_speed = this->rotation_speed();
    const double translation = settings_.acceleration_noise + turning_noise(speed(rotation_speed));
    const double edges = settings_.rotation_share * translation + turning_noise(rotation_speed);
    const double rotation = edges / std::max(scales_.lever2, kSmallestLever2);
    return {translation, translation, translation, rotation, rotation, rotation};
  }

  // How far the edges can have moved at most while they made these events, noise among them: no events is a
  // measurement, too. A velocity that takes them farther is wrong, and as wrong as that it is known.
  void limit_motion(int events, double dt) noexcept {
    most_motion_m_ = kInfinity;
    if (!(events_per_px_ > 0 && scales_known_)) return;
    constexpr double kSafety = 6;  // edges along the motion, hidden ones, fewer events of a fast edge
    const double deviation = std::sqrt((events + events_together_) * events_together_);
    most_motion_m_ = kSafety * (events + 3 * deviation) / (events_per_px_ * std::sqrt(scales_.px_per_m2));
    const double velocity_sigma = std::sqrt(P_.xx(6, 6) + P_.xx(7, 7) + P_.xx(8, 8));
    const double expected = motion(dt).carried * std::max(speed(rotation_speed()), velocity_sigma);
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

  // Noise that moves the edges no farther than they can have moved.
  MotionStep bounded(MotionStep motion, double acceleration) const noexcept {
    const double most2 = most_motion_m_ * most_motion_m_, pose = acceleration * motion.pose;
    if (!(pose > most2)) return motion;
    motion.pose *= most2 / pose;
    motion.both *= std::sqrt(most2 / pose);
    return motion;
  }

  // What a time does to the pose's quarter of F P F^T + Q.
  void add_motion(Matrix6d& P, double dt) const noexcept {
    const std::array<double, 6> q = acceleration();
    const MotionStep motion = bounded(this->motion(dt), q[0]);
    for (int k = 0; k < 6; ++k) {
      for (int i = 0; i < 6; ++i)
        P(i, k) += motion.carried * (P_.xx(6 + i, k) + P_.xx(i, 6 + k) + motion.carried * P_.xx(6 + i, 6 + k));
      P(k, k) += motion.pose * q[static_cast<std::size_t>(k)];
    }
  }

  // Predicts the state to a time after the pose. Returns the motion of the pose.
  Vec6 predict(double after_pose_s) noexcept {
    const double dt = lead_s_ + after_pose_s, carried_before = motion(lead_s_).carried;
    lead_s_ = 0;
    if (dt == 0) return -carried_before * twist_;  // with a pose for every event, every other time
    const std::array<double, 6> q = acceleration();
    const MotionStep motion = bounded(this->motion(dt), q[0]);
    simd::in_packs([&](auto bits) __attribute__((always_inline)) { P_.predict<bits>(motion, q); });
    for (std::size_t b = 0; b < kBiases; ++b) P_.bb[b][b] += squared(settings_.offset_drift_px) * std::abs(dt);
    const Vec6 moved = (motion.carried - carried_before) * twist_;
    twist_ = motion.kept * twist_;
    return moved;
  }

  Settings settings_;
  ErrorCovariance P_;
  Vec6 twist_;
  std::array<double, kBiases> bias_px_{};  // edge offset, trail
  double most_motion_m_ = kInfinity;       // of the edges since the update before, by the events
  double signal_ = 1;                      // see expect_signal
  double events_together_ = 1;
  double events_per_px_ = 0;  // that all edges make while they move by a pixel; 0: not known
  unsigned steps_ = 0;
  KalmanMeasurements measurements_;  // since the last update
  double spread2_px_ = 1;            // running mean of the squared residuals [px^2]
  struct Scales {
    double lever2 = 0, px_per_m2 = 0;
  };
  Scales scales_;  // running means of |E - T|^2 [m^2] and |gradient|^2 [px^2/m^2]
  bool scales_known_ = false;
  double spread_share_ = 0, scales_share_ = 0;  // of the next update's events in them
  struct Sums {
    double residual2 = 0, lever2 = 0, gradient2 = 0, since_us = 0;
  };
  Sums sums_;                // over the events since the last update; their times since then [us]
  double lead_s_ = 0;        // from the filter's state, which is at the mean time of its last events, to the pose
  double t_us_ = kInfinity;  // time of the pose, exact to 2^53 us; before the first, no time passes
};

static_assert(MotionEstimatingRule<KalmanUpdate> && GroupUpdateRule<KalmanUpdate>);

}  // namespace evmarker
