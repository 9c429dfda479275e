#pragma once
// How well a start pose is known, by how well its vertices are known in the image.
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/base/cholesky.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// Covariance of a pose at which the images of the vertices are `sigma_px` off, root mean square of x and y together.
/// Rotations are known to 0.1 rad, also where the vertices hardly tell them, as the tilt of a small flat marker that
/// faces the camera.
/// @param focal_length [px]
/// @return in the order of PoseEstimate; zero if the pose does not put all vertices in front of the camera
inline Matrix6d start_covariance(const MarkerModel& model, double focal_length,
                                 const Eigen::Isometry3d& T_camera_marker, double sigma_px) noexcept {
  constexpr double kRotation_rad = 0.1;
  // With the covariance s^2 (sum of J^T J)^-1, the variances of N vertices' images sum up to 6 s^2: one s^2 for each
  // degree of freedom.
  const double per_row = 6 / (static_cast<double>(model.vertices.size()) * sigma_px * sigma_px);
  std::array<std::array<double, 6>, 6> information{};
  for (const Eigen::Vector3d& vertex : model.vertices) {
    const Vec3 lever = rotate(T_camera_marker, vertex), P = translation(T_camera_marker) + lever;
    if (!(P.z > 0)) return Matrix6d::Zero();
    for (const Vec2 along : {Vec2(1, 0), Vec2(0, 1)}) {
      const Vec3 g = image_gradient(along, P, focal_length);
      const std::array<double, 6> J = Vec6(g, cross(lever, g)).array();
      for (std::size_t k = 0; k < 6; ++k)
        for (std::size_t i = 0; i <= k; ++i) information[k][i] += per_row * J[k] * J[i];
    }
  }
  for (std::size_t k = 3; k < 6; ++k) information[k][k] += 1 / (kRotation_rad * kRotation_rad);
  const Cholesky<6> factors(information);
  Matrix6d covariance;
  for (int k = 0; k < 6; ++k) {
    const std::array<double, 6> column = factors.column_of_inverse(static_cast<std::size_t>(k));
    for (int i = k; i < 6; ++i) covariance(i, k) = covariance(k, i) = column[static_cast<std::size_t>(i)];
  }
  return covariance.allFinite() ? covariance : Matrix6d::Zero();
}

}  // namespace evmarker
