#pragma once
// Poses in other frames: of the camera in a marker's, of one marker in another's.
#include <Eigen/Geometry>
#include <algorithm>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

namespace detail {

// How T_camera_a^-1 T_camera_b changes, in a's frame, with the perturbation of b's pose: rotated into a's frame.
inline Matrix6d jacobian_of_second(const Eigen::Isometry3d& T_camera_a) {
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = T_camera_a.linear().transpose();
  return J;
}

// The same with that of a's pose: the other way round, and by the lever arm from a's origin to b's.
inline Matrix6d jacobian_of_first(const Eigen::Isometry3d& T_camera_a, const Eigen::Vector3d& b_in_camera) {
  Matrix6d J = -jacobian_of_second(T_camera_a);
  const Eigen::Vector3d lever = b_in_camera - T_camera_a.translation();
  for (int i = 0; i < 3; ++i) {
    const Vec3 moved = cross(Vec3(lever), axis(Eigen::Isometry3d::Identity(), i));
    J.block<3, 1>(0, 3 + i) = T_camera_a.linear().transpose() * Eigen::Vector3d(moved);
  }
  return J;
}

// Of two poses together: what is true of both, and the worse of each.
inline TrackingQuality quality_of_both(const TrackingQuality& a, const TrackingQuality& b) {
  const bool worse = a.state == TrackingState::lost || (a.state != b.state && b.state == TrackingState::tracking);
  TrackingQuality quality = worse ? a : b;
  quality.health = a.health * b.health;
  quality.matched = std::min(a.matched, b.matched);
  quality.offered = std::min(a.offered, b.offered);
  quality.residual_px = std::max(a.residual_px, b.residual_px);
  quality.updated_t = std::min(a.updated_t, b.updated_t);
  return quality;
}

}  // namespace detail

/// The camera's pose in the marker's frame: in place of T_camera_marker stands its inverse, T_marker_camera. Twist and
/// covariance are those of the camera's motion relative to the marker, in the marker's frame.
inline PoseEstimate inverse(const PoseEstimate& pose) {
  PoseEstimate result = pose;
  result.T_camera_marker = pose.T_camera_marker.inverse();
  const Matrix6d J = detail::jacobian_of_first(pose.T_camera_marker, Eigen::Vector3d::Zero());
  if (pose.covariance) result.covariance = J * *pose.covariance * J.transpose();
  if (pose.twist) result.twist = J * *pose.twist;
  return result;
}

/// The pose of marker b in the frame of marker a: in place of T_camera_marker stands T_a_b, and twist and covariance
/// are those of b's motion relative to a, in a's frame; the id is b's. Both poses must be of one time. The covariance
/// is right as far as the errors of the two poses are independent.
inline PoseEstimate relative_pose(const PoseEstimate& a, const PoseEstimate& b) {
  PoseEstimate result;
  result.id = b.id;
  result.t = b.t;
  result.T_camera_marker = a.T_camera_marker.inverse() * b.T_camera_marker;
  const Matrix6d A = detail::jacobian_of_first(a.T_camera_marker, b.T_camera_marker.translation()),
                 B = detail::jacobian_of_second(a.T_camera_marker);
  if (a.covariance && b.covariance)
    result.covariance = A * *a.covariance * A.transpose() + B * *b.covariance * B.transpose();
  if (a.twist && b.twist) result.twist = A * *a.twist + B * *b.twist;
  result.quality = detail::quality_of_both(a.quality, b.quality);
  return result;
}

}  // namespace evmarker
