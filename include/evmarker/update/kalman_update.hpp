#pragma once
// Our rule: coupled point-to-line Kalman filter with velocity and edge offset.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/pose_update.hpp"

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
    P_.xx.diagonal() << Eigen::Vector3d::Constant(squared(settings.initial_sigma_t_m)),
        Eigen::Vector3d::Constant(squared(settings.initial_sigma_r_rad)),
        Eigen::Vector3d::Constant(squared(settings.initial_sigma_v_m_s)),
        Eigen::Vector3d::Constant(squared(settings.initial_sigma_w_rad_s));
    P_.bb[kOffset][kOffset] = squared(settings.initial_sigma_offset_px);
    P_.bb[kTrail][kTrail] = squared(settings.initial_sigma_trail_px);
  }

  void set_events_per_update(int events) noexcept {
    spread_share_ = 1 - std::pow(0.999, events);
    scales_share_ = 1 - std::pow(0.99, events);
  }

  /// Adds one event's row J = [g, (E - T) x g, s, -s p] of the measurement, g how its edge moves along the image
  /// normal, p the event's polarity.
  [[gnu::always_inline]] void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Eigen::Vector3d lever = c.E - T_camera_marker.translation(), turning = lever.cross(c.gradient);
    const double s = c.dark_side_known ? 1 : 0, trailing = -s * c.polarity;
    const double residual = residual_px(c);
    const double lever2 = lever.squaredNorm(), gradient2 = c.gradient.squaredNorm(), residual2 = residual * residual;
    // Not finite, in one comparison: it would stay for ever. |turning| is at most |lever| |gradient|.
    if (!(residual2 * (lever2 * gradient2) < kInfinity)) return;
    const double robust2 = settings_.robust_px * settings_.robust_px;
    const double weight = robust2 / (robust2 + residual2);
    MeasurementRow row;
    row << c.gradient.x(), c.gradient.y(), c.gradient.z(), turning.x(), turning.y(), turning.z(), s, trailing, residual;
    measurements_.add(row, weight);
    sums_.residual2 += residual2;
    sums_.lever2 += lever2;
    sums_.gradient2 += gradient2;
    sums_.since_us += us_since_update(c.t);
  }

  /// The same for up to eight events.
  [[gnu::always_inline]] void add(const Correspondences& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const double T_x = T_camera_marker.translation().x(), T_y = T_camera_marker.translation().y(),
                 T_z = T_camera_marker.translation().z();
    const double robust2 = settings_.robust_px * settings_.robust_px, offset_px = bias_px_[kOffset],
                 trail_px = bias_px_[kTrail], t_us = t_us_;
    alignas(64) std::array<Lanes, MeasurementRows::kNumbers> rows;
    alignas(64) Lanes weights, residual2, lever2, gradient2, since, product;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const double g_x = c.g_x[i], g_y = c.g_y[i], g_z = c.g_z[i], trailing = -c.polarity[i],
                   residual = c.distance_px[i] - offset_px - trailing * trail_px;
      const double x = c.E_x[i] - T_x, y = c.E_y[i] - T_y, z = c.E_z[i] - T_z, late_us = c.t[i] - t_us;
      residual2[i] = c.is_event[i] * residual * residual;
      lever2[i] = c.is_event[i] * (x * x + y * y + z * z);
      gradient2[i] = c.is_event[i] * (g_x * g_x + g_y * g_y + g_z * g_z);
      product[i] = residual2[i] * (lever2[i] * gradient2[i]);
      weights[i] = c.is_event[i] * robust2 / (robust2 + residual2[i]);
      since[i] = c.is_event[i] * (late_us > 0 ? late_us : 0);
      rows[0][i] = g_x;
      rows[1][i] = g_y;
      rows[2][i] = g_z;
      rows[3][i] = y * g_z - z * g_y;
      rows[4][i] = z * g_x - x * g_z;
      rows[5][i] = x * g_y - y * g_x;
      rows[6][i] = 1;
      rows[7][i] = trailing;
      rows[8][i] = residual;
    }
    if (!(sum(product) < kInfinity)) return;
    measurements_.add(rows, weights, c.count);
    sums_.residual2 += sum(residual2);
    sums_.lever2 += sum(lever2);
    sums_.gradient2 += sum(gradient2);
    sums_.since_us += sum(since);
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
    ErrorState error;
    limit_motion(count, dt);
    error.x.head<6>() = predict(mean_dt);

    const double per_event = signal_ / (squared(settings_.inflation) * std::max(spread2_px_, kPixelVariance));
    const bool good = measurements_.correct(P_, error, per_event);
    forget_events();

    Vector6d step = error.x.head<6>();
    const Vector6d twist = twist_ + error.x.tail<6>();
    const double edge_speed = twist.head<3>().norm() + std::sqrt(lever2()) * twist.tail<3>().norm();
    const double lead_s = std::min(dt - mean_dt, most_motion_m_ / edge_speed);
    if (lead_s != 0) step += carried(lead_s) * twist;
    if (!good ||
        !(step.squaredNorm() + twist.squaredNorm() + squared(error.b[kOffset]) + squared(error.b[kTrail]) < kInfinity))
      return false;

    perturb(T_camera_marker, step);
    twist_ = twist;
    lead_s_ = lead_s;
    correct_biases(error);
    return true;
  }

  /// @param share of the events that tells of the marker; 0 at rest
  void expect_signal(double share) noexcept { signal_ = share; }

  /// From here on, edges that all move by a pixel make so many events, those of one pixel in one passage together: what
  /// the events do not say has not moved.
  void set_events_per_px(double events, double together) noexcept {
    events_per_px_ = events;
    events_together_ = together;
  }

  /// Measures the trail by how many events a pixel makes while an edge passes over it, and by how far they are spread.
  /// Events that have not led to an update are forgotten.
  void expect_events_per_px2(Eigen::Isometry3d& T_camera_marker, double events) noexcept {
    forget_events();
    // Events lie evenly over the edge's width, variance w^2 / 12, and each is known to a pixel only.
    const double width_px = std::sqrt(12 * std::max(spread2_px_ - kPixelVariance, kPixelVariance));
    const double trail_px = expected_trail_px(width_px, events), sigma_px = 0.25 * trail_px;
    MeasurementRow row = MeasurementRow::Zero();
    row(6 + kTrail) = 1;
    row(6 + kBiases) = trail_px - bias_px_[kTrail];
    measurements_.add(row, 1);
    ErrorState error;
    if (measurements_.correct(P_, error, 1 / squared(sigma_px))) correct_biases(error);
    perturb(T_camera_marker, error.x.head<6>());
    twist_ += error.x.tail<6>();
    forget_events();
  }

  /// Moves the pose on to a later time with the present velocity; its covariance grows. Events that have not led to
  /// an update yet are forgotten.
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    most_motion_m_ = kInfinity;
    advance(T_camera_marker, t);
  }

  /// The same where the marker made no events but those that were added: it can hardly have moved.
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
    twist_ = -twist_;
    P_.xx.topRightCorner<6, 6>() *= -1;
    P_.xx.bottomLeftCorner<6, 6>() *= -1;
    for (Vector12d& column : P_.xb) column.tail<6>() *= -1;
  }

  /// Of the pose, as PoseEstimate says it.
  [[gnu::noinline]] Matrix6d covariance() const noexcept {
    Matrix6d P = P_.xx.topLeftCorner<6, 6>();
    if (lead_s_ != 0) {
      const Passage passed = passage(lead_s_);
      const Noise noise = bounded(this->noise(passed));
      for (int k = 0; k < 6; ++k)
        P.col(k) += passed.carried *
                    (P_.xx.col(k).tail<6>() + P_.xx.col(6 + k).head<6>() + passed.carried * P_.xx.col(6 + k).tail<6>());
      P.diagonal() += noise.along(noise.pose);
    }
    const double speed = this->speed(rotation_speed());
    const double trail_s = speed > 0 ? settings_.trail_sigma_px / (std::sqrt(px_per_m2()) * speed) : 0;
    const double delay_s2 = squared(settings_.latency_sigma_s) + trail_s * trail_s;
    const Vector6d delayed = delay_s2 * twist_;
    for (int i = 0; i < 6; ++i) P.col(i) = settings_.covariance_scale * P.col(i) + twist_(i) * delayed;
    return P;
  }
  Vector6d twist() const noexcept { return twist_; }
  /// How far an event lies from where its edge makes events.
  [[gnu::always_inline]] double residual_px(const Correspondence& c) const noexcept {
    return c.distance_px - (c.dark_side_known ? bias_px_[kOffset] - c.polarity * bias_px_[kTrail] : 0);
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
    spread2_px_ += spread_share_ * (sums_.residual2 / count - spread2_px_);
    scales_ += (scales_known_ ? scales_share_ : 1) * (Eigen::Vector2d(sums_.lever2, sums_.gradient2) / count - scales_);
    scales_known_ = true;
  }

  // Rounding takes a rotation off SO(3) by 1e-16 a step: to mend that at every step took longer than the step.
  void perturb(Eigen::Isometry3d& T, const Vector6d& step) noexcept {
    T.translation() += step.head<3>();
    T.linear() = ++steps_ % 16 == 0 ? rotated(T.linear(), step.tail<3>()) : turned(T.linear(), step.tail<3>());
  }

  double us_since_update(Timestamp t) const noexcept { return std::max(0.0, static_cast<double>(t) - t_us_); }

  // 1 - exp(-x) for x >= 0: the share of the velocity that fades.
  static double faded(double x) noexcept {
    if (x < 1.0 / 32) [[likely]]  // the next term is under 1e-14 of the sum
      return x * (1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6 * (1 - x / 7))))));
    return -std::expm1(-x);
  }

  // A time in units of the velocity's memory, the share of the velocity that fades in it, and the integral of the
  // fading velocity. A time before now is as uncertain as one after it.
  struct Passage {
    double x, faded, carried;
  };
  Passage passage(double dt) const noexcept {
    const double tau = settings_.velocity_memory_s, x = std::abs(dt) / tau, f = faded(x);
    return {x, f, std::copysign(tau * f, dt)};
  }
  double carried(double dt) const noexcept { return dt != 0 ? passage(dt).carried : 0; }

  double lever2() const noexcept { return scales_(0); }
  double px_per_m2() const noexcept { return scales_(1); }

  // How fast rotation moves the edges, and how fast they move altogether [m/s].
  double rotation_speed() const noexcept { return std::sqrt(lever2() * twist_.tail<3>().squaredNorm()); }
  double speed(double rotation_speed) const noexcept { return twist_.head<3>().norm() + rotation_speed; }
  double turning_noise(double speed) const noexcept { return speed * speed * speed / settings_.turning_distance_m; }

  // White acceleration of a velocity that fades, integrated: for short times q dt^3 / 3, q dt^2 / 2 and q dt.
  struct Noise {
    double q_translation, q_rotation;
    double pose, pose_velocity, velocity;  // for q = 1
    Vector6d along(double value) const noexcept {
      const double t = value * q_translation, r = value * q_rotation;
      return {t, t, t, r, r, r};
    }
  };

  Noise noise(const Passage& passed) const noexcept {
    const double rotation_speed = this->rotation_speed();
    const double q_translation = settings_.acceleration_noise + turning_noise(speed(rotation_speed));
    const double q_edges = settings_.rotation_share * q_translation + turning_noise(rotation_speed);
    const double tau = settings_.velocity_memory_s, x = passed.x, f = passed.faded;
    return {q_translation, q_edges / std::max(lever2(), kSmallestLever2),
            tau * tau * tau * std::max(0.0, x - f - f * f / 2), tau * tau * f * f / 2, tau * (f - f * f / 2)};
  }

  // How far the edges can have moved at most while they made so many events, noise among them: no events is a
  // measurement, too. A velocity that takes them farther is wrong, and as wrong as that it is known.
  void limit_motion(int events, double dt) noexcept {
    most_motion_m_ = kInfinity;
    if (!(events_per_px_ > 0 && scales_known_)) return;
    constexpr double kSafety = 6;  // edges along the motion, hidden ones, fewer events of a fast edge
    const double deviation = std::sqrt((events + events_together_) * events_together_);
    most_motion_m_ = kSafety * (events + 3 * deviation) / (events_per_px_ * std::sqrt(px_per_m2()));
    const double velocity_sigma = std::sqrt(P_.xx(6, 6) + P_.xx(7, 7) + P_.xx(8, 8));
    const double expected = carried(dt) * std::max(speed(rotation_speed()), velocity_sigma);
    if (!(expected > most_motion_m_)) return;
    const double kept = most_motion_m_ / expected;
    twist_ *= kept;
    P_.xx.rightCols<6>() *= kept;
    P_.xx.bottomRows<6>() *= kept;
    for (Vector12d& column : P_.xb) column.tail<6>() *= kept;
  }

  // Noise that moves the edges no farther than that.
  Noise bounded(Noise noise) const noexcept {
    const double most2 = most_motion_m_ * most_motion_m_, pose = noise.q_translation * noise.pose;
    if (!(pose > most2)) return noise;
    noise.pose *= most2 / pose;
    noise.pose_velocity *= std::sqrt(most2 / pose);
    return noise;
  }

  // Lets time pass until so long after the pose: velocity carries it and fades, its noise adds up. Returns the motion
  // of the pose.
  Vector6d predict(double after_pose_s) noexcept {
    const double dt = lead_s_ + after_pose_s, carried_before = this->carried(lead_s_);
    lead_s_ = 0;
    if (dt == 0) return -carried_before * twist_;  // with a pose for every event, every other time
    const Passage passed = passage(dt);
    const double carried = passed.carried, kept = 1 - passed.faded;
    const Noise noise = bounded(this->noise(passed));
    const Vector6d of_pose = noise.along(noise.pose), of_velocity = noise.along(noise.velocity),
                   of_both = noise.along(std::copysign(noise.pose_velocity, carried));
    in_packs([&](auto bits)
                 __attribute__((always_inline)) { P_.predict<bits>(carried, kept, of_pose, of_both, of_velocity); });
    for (std::size_t b = 0; b < kBiases; ++b) P_.bb[b][b] += squared(settings_.offset_drift_px) * std::abs(dt);
    const Vector6d moved = (carried - carried_before) * twist_;
    twist_ *= kept;
    return moved;
  }

  Settings settings_;
  ErrorCovariance P_;
  Vector6d twist_ = Vector6d::Zero();
  std::array<double, kBiases> bias_px_{};  // edge offset, trail
  double most_motion_m_ = kInfinity;       // of the edges since the update before, by the events
  double signal_ = 1;                      // see expect_signal
  double events_together_ = 1;
  double events_per_px_ = 0;  // that all edges make while they move by a pixel; 0: not known
  unsigned steps_ = 0;
  KalmanMeasurements measurements_;  // since the last update
  double spread2_px_ = 1;            // running mean of the squared residuals [px^2]
  Eigen::Vector2d scales_{0, 0};     // running means of |E - T|^2 [m^2] and |gradient|^2 [px^2/m^2]
  bool scales_known_ = false;
  double spread_share_ = 0, scales_share_ = 0;  // of the next update's events in them
  struct Sums {
    double residual2 = 0, lever2 = 0, gradient2 = 0, since_us = 0;
  };
  Sums sums_;                // over the events since the last update; their times since then [us]
  double lead_s_ = 0;        // the filter's state is as old as the mean of its last events; the pose is so much newer
  double t_us_ = kInfinity;  // time of the pose, exact to 2^53 us; before the first, no time passes
};

static_assert(MotionEstimatingRule<KalmanUpdate> && GroupUpdateRule<KalmanUpdate>);

}  // namespace evmarker
