#pragma once
// Floor 4. Our rule: coupled point-to-line Kalman filter with velocity and edge offset.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "evmarker/pose_update.hpp"
#include "evmarker/so3.hpp"

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
  double offset_drift_px = 0.1;     ///< random walk of the edge offset in a second [px]
  /// A sensor's unknown delay: shifts the pose along its motion, unseen by the filter. Enters the information only.
  double latency_sigma_s = 2e-4;
  double trail_sigma_px = 0.1;  ///< likewise in pixels: an event comes only when a whole contrast step has passed
  /// The noise above is more than there is on average, so that a sudden turn or wrong events are survived; the poses
  /// err by less. Share of the filter's own covariance that is told.
  double covariance_scale = 0.2;
  double initial_sigma_t_m = 0.01;  ///< of the pose that tracking starts from
  double initial_sigma_r_rad = 0.1;
  double initial_sigma_v_m_s = 0.5;
  double initial_sigma_w_rad_s = 3;
  double initial_sigma_offset_px = 0.3;
};

/// Error-state filter over [translation, rotation, velocity, angular velocity, edge offset], perturbations as in
/// PoseEstimate. The edge offset is how far [px] on the dark side of an edge its events lie on average: pixels fire on
/// steps of the logarithm of light, and those crowd where it is dark. Left out, it makes the marker seem smaller and
/// farther away.
class KalmanUpdate {
 public:
  using Settings = KalmanSettings;

  KalmanUpdate(const Settings& settings, int events_per_update) : settings_(settings) {
    const auto require = [](double value, const char* name) {
      if (!(std::isfinite(value) && value > 0))
        throw std::invalid_argument(std::string("kalman update: ") + name + " is " + std::to_string(value));
    };
    require(settings.inflation, "inflation");
    require(settings.robust_px, "robust_px");
    require(settings.acceleration_noise, "acceleration_noise");
    require(settings.turning_distance_m, "turning_distance_m");
    require(settings.rotation_share, "rotation_share");
    require(settings.velocity_memory_s, "velocity_memory_s");
    require(settings.offset_drift_px, "offset_drift_px");
    require(settings.latency_sigma_s, "latency_sigma_s");
    require(settings.trail_sigma_px, "trail_sigma_px");
    require(settings.covariance_scale, "covariance_scale");
    require(settings.initial_sigma_t_m, "initial_sigma_t_m");
    require(settings.initial_sigma_r_rad, "initial_sigma_r_rad");
    require(settings.initial_sigma_v_m_s, "initial_sigma_v_m_s");
    require(settings.initial_sigma_w_rad_s, "initial_sigma_w_rad_s");
    require(settings.initial_sigma_offset_px, "initial_sigma_offset_px");
    if (events_per_update < 1)
      throw std::invalid_argument("kalman update: events_per_update is " + std::to_string(events_per_update));
    Vector13 sigma;
    sigma << Eigen::Vector3d::Constant(settings.initial_sigma_t_m),
        Eigen::Vector3d::Constant(settings.initial_sigma_r_rad),
        Eigen::Vector3d::Constant(settings.initial_sigma_v_m_s),
        Eigen::Vector3d::Constant(settings.initial_sigma_w_rad_s), settings.initial_sigma_offset_px;
    P_ = sigma.cwiseAbs2().asDiagonal();
  }

  /// Adds one event's row J = [g, (E - T) x g, s] of the measurement, g how its edge moves along the image normal.
  void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Eigen::Vector3d lever = c.E - T_camera_marker.translation();
    Vector7 J;
    J.head<3>() = c.gradient;
    J.segment<3>(3) = lever.cross(c.gradient);
    J(6) = c.dark_side_known ? 1 : 0;
    const double residual = c.distance_px - J(6) * offset_px_;
    if (!std::isfinite(residual * residual * J.squaredNorm() * lever.squaredNorm())) return;  // would stay for ever
    const double ratio = residual / settings_.robust_px;
    const double weight = 1 / (1 + ratio * ratio);
    H_.selfadjointView<Eigen::Lower>().rankUpdate(J, weight);
    b_ += weight * residual * J;
    spread2_px_ += 0.001 * (residual * residual - spread2_px_);
    lever2_ += (lever2_ > 0 ? 0.01 : 1) * (lever.squaredNorm() - lever2_);
    px_per_m2_ += (px_per_m2_ > 0 ? 0.01 : 1) * (c.gradient.squaredNorm() - px_per_m2_);
    since_s_ += seconds_since_update(c.t);
    ++events_;
  }

  bool update(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    const double dt = seconds_since_update(t);
    const double mean_dt = events_ > 0 ? std::min(since_s_ / events_, dt) : dt;
    t_ = t;
    started_ = true;
    const Vector6d moved = predict(mean_dt);
    since_s_ = events_ = 0;

    // Information of the events about [pose, offset]; their residuals refer to the pose before the prediction.
    constexpr double kPixelVariance = 1.0 / 12;  // of a place of which only the pixel is known
    const double per_event = 1 / (settings_.inflation * settings_.inflation * std::max(spread2_px_, kPixelVariance));
    const Matrix7 H = per_event * Matrix7(H_.selfadjointView<Eigen::Lower>());
    Vector7 b = per_event * b_;
    b -= H.leftCols<6>() * moved;
    H_.setZero();
    b_.setZero();

    // P <- (P^-1 + C^T H C)^-1 without inverting P or H: both may be singular. C picks pose and offset.
    Eigen::Matrix<double, kStates, 7> PC;
    PC << P_.leftCols<6>(), P_.rightCols<1>();
    Matrix7 CPC;
    CPC << PC.topRows<6>(), PC.bottomRows<1>();
    const Matrix7 L = CPC.llt().matrixL();
    const Eigen::LLT<Matrix7> innovation(Matrix7::Identity() + L.transpose() * H * L);
    // K maps information to state: P C^T (I + H C P C^T)^-1 = PC L^-T (I + L^T H L)^-1 L^T
    const Eigen::Matrix<double, kStates, 7> G =
        L.triangularView<Eigen::Lower>().solve(PC.transpose()).transpose();  // PC L^-T
    const Vector13 delta = G * innovation.solve(L.transpose() * b);
    // P - K H C P as a square, so that rounding leaves it positive, plus the part of the velocity's variance that pose
    // and offset do not explain.
    const Eigen::Matrix<double, 7, kStates> root = innovation.matrixL().solve(G.transpose());
    Matrix13 P = root.transpose() * root;
    P.block<6, 6>(6, 6) += P_.block<6, 6>(6, 6) - G.middleRows<6>(6) * G.middleRows<6>(6).transpose();
    Eigen::Isometry3d T = T_camera_marker;
    const Vector6d twist = twist_ + delta.segment<6>(6);
    perturb(T, moved + delta.head<6>() + carried(dt - mean_dt) * twist);
    if (!delta.allFinite() || !P.allFinite() || !T.matrix().allFinite()) return false;

    P_ = P;
    T_camera_marker = T;
    twist_ = twist;
    lead_s_ = dt - mean_dt;
    offset_px_ += delta(12);
    return true;
  }

  /// Moves the pose on to a later time with the present velocity; its information shrinks.
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    const double dt = seconds_since_update(t);
    t_ = t;
    started_ = true;
    perturb(T_camera_marker, predict(dt));
  }

  void reverse() noexcept {
    H_.setZero();
    b_.setZero();
    since_s_ = events_ = 0;
    lead_s_ = -lead_s_;
    twist_ = -twist_;
    P_.block<6, 6>(0, 6) *= -1;
    P_.block<6, 6>(6, 0) *= -1;
    P_.block<1, 6>(12, 6) *= -1;
    P_.block<6, 1>(6, 12) *= -1;
  }

  Matrix6d information() const noexcept {
    KalmanUpdate now = *this;
    now.predict(0);
    const double speed = this->speed();
    const double trail_s = speed > 0 ? settings_.trail_sigma_px / (std::sqrt(px_per_m2_) * speed) : 0;
    const Vector6d delay = std::hypot(settings_.latency_sigma_s, trail_s) * twist_;
    const Matrix6d covariance =
        settings_.covariance_scale * now.P_.topLeftCorner<6, 6>() + delay * delay.transpose();
    return covariance.llt().solve(Matrix6d::Identity());
  }
  std::optional<Vector6d> twist() const noexcept { return twist_; }
  /// How far on the dark side of an edge its events lie [px].
  double edge_offset_px() const noexcept { return offset_px_; }

 private:
  static constexpr int kStates = 13;
  static constexpr double kSmallestLever2 = 1e-8;  // [m^2]
  using Vector7 = Eigen::Matrix<double, 7, 1>;
  using Matrix7 = Eigen::Matrix<double, 7, 7>;
  using Vector13 = Eigen::Matrix<double, kStates, 1>;
  using Matrix13 = Eigen::Matrix<double, kStates, kStates>;

  static void perturb(Eigen::Isometry3d& T, const Vector6d& step) noexcept {
    T.translation() += step.head<3>();
    T.linear() = orthonormalized(so3_exp(step.tail<3>()) * T.linear());
  }

  double seconds_since_update(Timestamp t) const noexcept {
    return started_ && t > t_ ? 1e-6 * (static_cast<double>(t) - static_cast<double>(t_)) : 0;
  }

  // Integral of the fading velocity; a time before now is as uncertain as one after it.
  double carried(double dt) const noexcept {
    const double tau = settings_.velocity_memory_s;
    return std::copysign(tau * std::expm1(-std::abs(dt) / tau), dt);
  }

  // How fast rotation moves the edges, and how fast they move altogether [m/s].
  double rotation_speed() const noexcept { return std::sqrt(lever2_) * twist_.tail<3>().norm(); }
  double speed() const noexcept { return twist_.head<3>().norm() + rotation_speed(); }
  double turning_noise(double speed) const noexcept { return speed * speed * speed / settings_.turning_distance_m; }

  // Lets time pass until so long after the pose: velocity carries it and fades, its noise adds up. Returns the motion
  // of the pose.
  Vector6d predict(double after_pose_s) noexcept {
    const double carried = this->carried(lead_s_ + after_pose_s);
    const double dt = std::abs(lead_s_ + after_pose_s), tau = settings_.velocity_memory_s;
    const double faded = -std::expm1(-dt / tau), faded2 = -std::expm1(-2 * dt / tau);
    const double kept = 1 - faded;
    Matrix13 F = Matrix13::Identity();
    F.block<6, 6>(0, 6).diagonal().setConstant(carried);
    F.block<6, 6>(6, 6).diagonal().setConstant(kept);
    P_ = F * P_ * F.transpose();
    const double q_translation = settings_.acceleration_noise + turning_noise(speed());
    const double q_edges = settings_.rotation_share * q_translation + turning_noise(rotation_speed());
    const double q_rotation = q_edges / std::max(lever2_, kSmallestLever2);
    for (int axis = 0; axis < 6; ++axis) {
      const double q = axis < 3 ? q_translation : q_rotation;
      // White acceleration of a velocity that fades, integrated: for short times q dt^3 / 3, q dt^2 / 2 and q dt.
      P_(axis, axis) += q * tau * tau * std::max(0.0, dt - 2 * tau * faded + tau / 2 * faded2);
      P_(axis, axis + 6) += q * carried * std::abs(carried) / 2;
      P_(axis + 6, axis) += q * carried * std::abs(carried) / 2;
      P_(axis + 6, axis + 6) += q * tau / 2 * faded2;
    }
    P_(12, 12) += settings_.offset_drift_px * settings_.offset_drift_px * dt;
    const Vector6d moved = (carried - this->carried(lead_s_)) * twist_;
    twist_ *= kept;
    lead_s_ = 0;
    return moved;
  }

  Settings settings_;
  Matrix13 P_;
  Vector6d twist_ = Vector6d::Zero();
  double offset_px_ = 0;
  Matrix7 H_ = Matrix7::Zero();  // lower triangle: sum of w J J^T
  Vector7 b_ = Vector7::Zero();  // sum of w J d
  double spread2_px_ = 1;        // running mean of the squared residuals [px^2]
  double lever2_ = 0;            // running mean of |E - T|^2 [m^2], 0 before the first event
  double px_per_m2_ = 0;         // running mean of |gradient|^2 [px^2/m^2]
  double since_s_ = 0;           // sum of the events' times since the last update [s]
  double events_ = 0;
  double lead_s_ = 0;  // the filter's state is as old as the mean of its last events; the pose is so much newer
  Timestamp t_ = 0;    // of the pose
  bool started_ = false;
};

static_assert(PoseUpdateRule<KalmanUpdate>);

}  // namespace evmarker
