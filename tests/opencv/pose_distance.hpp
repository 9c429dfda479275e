#pragma once
// How far apart two poses are.
#include <Eigen/Geometry>
#include <numbers>

namespace evmarker::opencv::test {

inline double distance_mm(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return 1000 * (a.translation() - b.translation()).norm();
}

inline double angle_deg(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle() * 180 / std::numbers::pi;
}

}  // namespace evmarker::opencv::test
