#pragma once
// What a tracker tells: pose, covariance, twist and how far to trust it.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <limits>
#include <optional>

#include "evmarker/base/so3.hpp"
#include "evmarker/events/event.hpp"

namespace evmarker {

using MarkerId = int;

/// A setting that is derived from what is seen.
inline constexpr int kAutomatic = 0;

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

enum class TrackingState {
  converging,  ///< the first updates after a detection, or more speaks against the pose than for it: it may be far off
  tracking,    ///< verified: use the pose
  lost         ///< verification failed or the marker left: the last pose of this tracker
};

constexpr const char* to_string(TrackingState state) noexcept {
  switch (state) {
    case TrackingState::converging: return "converging";
    case TrackingState::tracking: return "tracking";
    case TrackingState::lost: return "lost";
  }
  return "?";
}

/// Why a marker was lost.
enum class LossReason {
  none,            ///< it is not lost
  hidden,          ///< edges that move make no events
  left_image,      ///< half of it is out of the image, or behind the camera
  inconsistent,    ///< too few of the events near it fit its edges
  verification,    ///< tracking backwards did not lead back, Eqs. (13), (14)
  replaced,        ///< a detection shows it elsewhere
  events_missing,  ///< events were dropped for longer than its motion could be predicted
  not_confirmed    ///< it never came to be `tracking`
};

constexpr const char* to_string(LossReason reason) noexcept {
  switch (reason) {
    case LossReason::none: return "none";
    case LossReason::hidden: return "hidden";
    case LossReason::left_image: return "left_image";
    case LossReason::inconsistent: return "inconsistent";
    case LossReason::verification: return "verification";
    case LossReason::replaced: return "replaced";
    case LossReason::events_missing: return "events_missing";
    case LossReason::not_confirmed: return "not_confirmed";
  }
  return "?";
}

/// How well the events agree with the pose.
struct TrackingQuality {
  TrackingState state = TrackingState::converging;
  double health = 0;  ///< probability that the marker is where the pose says, by the evidence so far
  LossReason loss_reason = LossReason::none;
  int matched = 0;         ///< events that took part in this update
  int offered = 0;         ///< events that fell on or near the marker since the last update
  double residual_px = 0;  ///< root mean square distance of the matched events to their edges [px]
  double backtrack_px = std::numeric_limits<double>::quiet_NaN();         ///< Eq. (13) at the last verification [px]
  double backtrack_rad = std::numeric_limits<double>::quiet_NaN();        ///< Eq. (14) at the last verification [rad]
  double backtrack_angle_rad = std::numeric_limits<double>::quiet_NaN();  ///< the same as one geodesic angle [rad]
  Timestamp updated_t = 0;    ///< time of the last update [us]: `t - updated_t` is the pose's age
  Timestamp backtrack_t = 0;  ///< when the last verification ran [us]; errors are NaN before the first
};

/// The pose of one marker at one time. Perturbations act on the left, in the camera frame, ordered
/// [translation [m]; rotation [rad] about the marker's origin].
struct PoseEstimate {
  MarkerId id = 0;
  Timestamp t = 0;                                                    ///< [us]
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();  ///< [m]
  std::optional<Matrix6d> covariance =
      std::nullopt;  ///< of the perturbation above [m^2, m rad; m rad, rad^2], where the update rule estimates one
  std::optional<Vector6d> twist =
      std::nullopt;  ///< rate of the perturbation above [m/s; rad/s], where the rule has one
  std::optional<double> edge_offset_px =
      std::nullopt;  ///< how far on the dark side of their edges events lie, where the rule knows
  std::optional<double> trail_px = std::nullopt;  ///< how far behind their moving edges, likewise
  TrackingQuality quality;
};

/// Inverse covariance, for those who fuse poses; zero where there is none, or none that is positive definite.
inline Matrix6d information(const PoseEstimate& pose) noexcept {
  if (!pose.covariance) return Matrix6d::Zero();
  const Eigen::LLT<Matrix6d> root(*pose.covariance);
  const Matrix6d solved = root.solve(Matrix6d::Identity()), inverse = solved.selfadjointView<Eigen::Lower>();
  return root.info() == Eigen::Success && inverse.allFinite() ? inverse : Matrix6d::Zero();
}

/// Covariance of where a point of the marker is in the undistorted image [px^2]. The pose must have one.
/// @param point marker frame [m]
inline Eigen::Matrix2d image_covariance(const PoseEstimate& pose, const Eigen::Vector3d& point,
                                        double focal_length) noexcept {
  const Eigen::Vector3d lever = pose.T_camera_marker.linear() * point;
  const Eigen::Vector3d X = lever + pose.T_camera_marker.translation();
  Eigen::Matrix<double, 3, 6> dX;  // by the perturbation
  dX << Eigen::Matrix3d::Identity(), -skew(lever);
  Eigen::Matrix<double, 2, 3> dm;  // by X
  dm << Eigen::Matrix2d::Identity(), -X.head<2>() / X.z();
  const Eigen::Matrix<double, 2, 6> J = focal_length / X.z() * dm * dX;
  return J * *pose.covariance * J.transpose();
}

}  // namespace evmarker
