#pragma once
// The inverse of a pose's covariance, for those who fuse poses.
#include <Eigen/Cholesky>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// Inverse covariance, for those who fuse poses; zero where there is none, or none that is positive definite.
inline Matrix6d information(const PoseEstimate& pose) noexcept {
  if (!pose.covariance) return Matrix6d::Zero();
  const Eigen::LLT<Matrix6d> root(*pose.covariance);
  const Matrix6d solved = root.solve(Matrix6d::Identity()), inverse = solved.selfadjointView<Eigen::Lower>();
  return root.info() == Eigen::Success && inverse.allFinite() ? inverse : Matrix6d::Zero();
}

}  // namespace evmarker
