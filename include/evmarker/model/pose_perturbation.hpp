#pragma once
// Small motions of poses, in the order and the frame of PoseEstimate's covariance.
#include <Eigen/Geometry>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// The perturbation that turns one pose into another: translation [m], then rotation vector [rad], in the frame into
/// which both map.
inline Vector6d pose_difference(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
  return Vec6(translation(to) - translation(from), so3_log(product_with_transposed(to.linear(), from.linear())));
}

/// Applies a perturbation to a pose, which stays a rigid motion.
inline void perturb(Eigen::Isometry3d& T, const Vector6d& by) {
  const Vec6 step = by;
  set_translation(T, translation(T) + step.t);
  turn(T, step.r);
  orthonormalize(T);
}

}  // namespace evmarker
