#pragma once
// What every pose promises, whatever events and settings have led to it.
#include <Eigen/Dense>
#include <algorithm>
#include <cstddef>
#include <map>
#include <span>
#include <vector>

#include "evmarker/model/pose_estimate.hpp"
#include "fuzz/input.hpp"

namespace evmarker::fuzz {

inline void check_covariance(const Matrix6d& covariance) {
  require_that(covariance.allFinite(), "a covariance is finite");
  require_that(covariance == covariance.transpose(), "a covariance is symmetric");
  require_that((covariance.diagonal().array() > 0).all(), "variances are positive");
  // Free of units, as metres and radians are not to be compared.
  const Vector6d scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
  const double least = Eigen::SelfAdjointEigenSolver<Matrix6d>(correlation, Eigen::EigenvaluesOnly).eigenvalues()(0);
  require_that(least > -1e-9, "a covariance is positive semidefinite");
}

inline void check_pose(const PoseEstimate& pose) {
  ++arrived;
  const Eigen::Matrix3d R = pose.T_camera_marker.linear();
  require_that(pose.T_camera_marker.matrix().allFinite(), "a pose is finite");
  require_that((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-9 && R.determinant() > 0,
               "a rotation is orthonormal");
  if (pose.twist) require_that(pose.twist->allFinite(), "a twist is finite");
  if (pose.edge_offset_px) require_that(std::isfinite(*pose.edge_offset_px), "an edge offset is finite");
  if (pose.trail_px) require_that(std::isfinite(*pose.trail_px), "a trail is finite");
  const TrackingQuality& quality = pose.quality;
  require_that(quality.health >= 0 && quality.health <= 1, "health is a probability");
  require_that(quality.matched >= 0 && quality.residual_px >= 0, "quality is not negative");
  require_that((quality.state == TrackingState::lost) == (quality.loss_reason != LossReason::none),
               "a pose has a loss reason if it is the last one");
}

inline bool same_bits(const PoseEstimate& a, const PoseEstimate& b) {
  return a.id == b.id && a.t == b.t && a.T_camera_marker.matrix() == b.T_camera_marker.matrix() &&
         a.covariance == b.covariance && a.twist == b.twist && a.edge_offset_px == b.edge_offset_px &&
         a.trail_px == b.trail_px && a.quality.state == b.quality.state && a.quality.health == b.quality.health &&
         a.quality.loss_reason == b.quality.loss_reason && a.quality.matched == b.quality.matched &&
         a.quality.updated_t == b.quality.updated_t;
}

/// @param monotonic whether the events' times never went back
inline void check_poses(std::span<const PoseEstimate> poses, bool monotonic) {
  constexpr std::size_t kBetween = 8;  // decompositions take longest: of a few covariances only
  std::map<MarkerId, Timestamp> last;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    check_pose(poses[i]);
    if (poses[i].covariance && (i % kBetween == 0 || i + 1 == poses.size())) check_covariance(*poses[i].covariance);
    const auto [before, first] = last.try_emplace(poses[i].id, poses[i].t);
    if (monotonic) require_that(poses[i].t >= before->second, "the poses of a marker never go back in time");
    before->second = poses[i].t;
  }
}

}  // namespace evmarker::fuzz
