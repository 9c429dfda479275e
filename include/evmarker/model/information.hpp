#pragma once
// The information matrix of a pose, for sensor fusion.
#include <Eigen/Cholesky>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// Inverse of a pose's covariance, in the same order; zero if the pose has no covariance or one that is not positive
/// definite.
inline Matrix6d information(const PoseEstimate& pose) noexcept {
  if (!pose.covariance) return Matrix6d::Zero();
  const Eigen::LLT<Matrix6d> root(*pose.covariance);
  const Matrix6d solved = root.solve(Matrix6d::Identity()), inverse = solved.selfadjointView<Eigen::Lower>();
  return root.info() == Eigen::Success && inverse.allFinite() ? inverse : Matrix6d::Zero();
}

}  // namespace evmarker
