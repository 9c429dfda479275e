#pragma once
// Poses that are off by a step, and by which step they are.
#include <Eigen/Geometry>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::steps {

inline Vector6d step(const Eigen::Vector3d& t, const Eigen::Vector3d& r) { return (Vector6d() << t, r).finished(); }

inline Eigen::Isometry3d perturbed(Eigen::Isometry3d T, const Vector6d& step) {
  const Eigen::Vector3d r = step.tail<3>();
  T.translation() += step.head<3>();
  if (r.norm() > 0) T.linear() = Eigen::AngleAxisd(r.norm(), r.normalized()) * T.linear();
  return T;
}

/// What perturbs the estimate into the truth.
inline Vector6d error_of(const Eigen::Isometry3d& estimate, const Eigen::Isometry3d& truth) {
  const Eigen::AngleAxisd r(truth.linear() * estimate.linear().transpose());
  return step(truth.translation() - estimate.translation(), r.angle() * r.axis());
}
inline double translation_error(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return error_of(a, b).head<3>().norm();
}
inline double rotation_error(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return error_of(a, b).tail<3>().norm();
}

}  // namespace evmarker::steps
