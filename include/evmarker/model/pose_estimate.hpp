#pragma once
// The result of tracking: pose, covariance, twist, and how well the events support them.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <optional>

#include "evmarker/events/event.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

using MarkerId = int;

/// The value of a setting with which the library derives it from the events.
inline constexpr int kAutomatic = 0;

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

enum class TrackingState {
  converging,  ///< just begun, or more evidence against the pose than for it: it may be far off
  tracking,    ///< verified: use the pose
  lost         ///< the last pose of this tracker, see LossReason
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
  hidden,          ///< its moving edges make no events
  left_image,      ///< its centre is out of the image, or part of it behind the camera
  inconsistent,    ///< too few of the events near it fit its edges
  verification,    ///< tracking backwards did not lead back to an earlier pose, Eqs. (13), (14)
  replaced,        ///< it was detected elsewhere
  events_missing,  ///< a gap in the events was too long to predict its motion
  not_confirmed,   ///< it never reached the state `tracking`
  turned_away,     ///< its face is seen from behind, or at so flat an angle that its edges cannot be told apart
  refused          ///< what is seen of it does not fit its model, as a board's file, see CheckingDetector
};
inline constexpr std::size_t kLossReasons = 10;

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
    case LossReason::turned_away: return "turned_away";
    case LossReason::refused: return "refused";
  }
  return "?";
}

/// How well the events agree with the pose.
struct TrackingQuality {
  TrackingState state = TrackingState::converging;
  double health = 0;  ///< probability that the pose is right, by the evidence so far
  LossReason loss_reason = LossReason::none;
  int matched = 0;         ///< events that took part in this update
  int offered = 0;         ///< events that fell on or near the marker since the last update
  double residual_px = 0;  ///< root mean square distance of the matched events to their edges [px]
  double backtrack_px = std::numeric_limits<double>::quiet_NaN();         ///< Eq. (13) at the last verification [px]
  double backtrack_rad = std::numeric_limits<double>::quiet_NaN();        ///< Eq. (14) at the last verification [rad]
  double backtrack_angle_rad = std::numeric_limits<double>::quiet_NaN();  ///< the same as one geodesic angle [rad]
  Timestamp updated_t = 0;    ///< time of the last update [us]: `t - updated_t` is the pose's age
  Timestamp backtrack_t = 0;  ///< time of the last verification [us]; before the first, its errors are NaN
};

/// The pose of one marker at one time. Perturbations act on the left, in the camera frame, ordered
/// [translation [m]; rotation [rad] about the marker's origin].
struct PoseEstimate {
  MarkerId id = 0;
  Timestamp t = 0;                                                    ///< [us]
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();  ///< [m]
  // The next four are empty if the update rule does not estimate them.
  std::optional<Matrix6d> covariance = std::nullopt;    ///< of the perturbation [m^2, m rad; m rad, rad^2]
  std::optional<Vector6d> twist = std::nullopt;         ///< rate of the perturbation [m/s; rad/s]
  std::optional<double> edge_offset_px = std::nullopt;  ///< how far on the dark side of their edges events lie
  std::optional<double> trail_px = std::nullopt;        ///< how far events lie behind their moving edges
  TrackingQuality quality;
};

/// Variances of a marker point's place in the undistorted image, along x and along y [px^2].
/// @param covariance of the pose, see PoseEstimate
/// @param origin of the marker [m, camera frame]
/// @param lever from the origin to the point [m, camera frame]
/// @param focal_length [px]
inline Vec2 image_variances(const Matrix6d& covariance, Vec3 origin, Vec3 lever, double focal_length) noexcept {
  const auto variance = [&](Vec2 along) {
    const Vec3 g = image_gradient(along, origin + lever, focal_length);
    // Derivative of the point's image by the perturbation.
    const std::array<double, 6> J = Vec6(g, cross(lever, g)).array();
    double sum = 0;
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t i = 0; i < 6; ++i) sum += J[i] * covariance.data()[6 * k + i] * J[k];
    return sum;
  };
  return {variance({1, 0}), variance({0, 1})};
}

/// Variance of a marker point's place in the undistorted image, the sum over x and y [px^2]. The pose must have a
/// covariance.
/// @param point [m, marker frame]
/// @param focal_length [px]
inline double image_variance(const PoseEstimate& pose, Vec3 point, double focal_length) noexcept {
  const Vec2 variances = image_variances(*pose.covariance, translation(pose.T_camera_marker),
                                         rotate(pose.T_camera_marker, point), focal_length);
  return variances.x + variances.y;
}

}  // namespace evmarker
