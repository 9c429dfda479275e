#pragma once
// The two poses at which a planar wireframe has nearly the same image.
#include <cmath>
#include <cstddef>
#include <numbers>
#include <optional>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// The plane of a flat wireframe [marker frame]; by default that of a code marker.
struct ModelPlane {
  Vec3 normal{0, 0, 1};
  Vec3 centre{};    ///< of the wireframe [m]
  double size = 0;  ///< of the wireframe: side of a square with its longest diagonal [m]
};

/// The plane of a wireframe; none if it has depth, or no area.
inline std::optional<ModelPlane> plane_of(const MarkerModel& model) noexcept {
  constexpr double kFlat = 1e-3;  // of its size
  const Vec3 middle = centre(model);
  Vec3 longest, normal;  // arm from the middle to a vertex; product of two arms
  for (const Vec3 vertex : model.vertices)
    if (squared_norm(vertex - middle) > squared_norm(longest)) longest = vertex - middle;
  for (const Vec3 vertex : model.vertices)
    if (const Vec3 n = cross(longest, vertex - middle); squared_norm(n) > squared_norm(normal)) normal = n;
  if (!(norm(normal) > kFlat * squared_norm(longest))) return std::nullopt;
  normal = normal / norm(normal);
  for (const Vec3 vertex : model.vertices)
    if (std::abs(dot(normal, vertex - middle)) > kFlat * norm(longest)) return std::nullopt;
  return ModelPlane{normal, middle, std::numbers::sqrt2 * norm(longest)};
}

/// A plane as the camera sees it [camera frame].
struct SeenPlane {
  Vec3 centre;     ///< [m]
  Vec3 normal;     ///< of the plane
  Vec3 to_camera;  ///< direction from the centre

  SeenPlane(const Eigen::Isometry3d& T_camera_marker, const ModelPlane& plane) noexcept
      : centre(transform(T_camera_marker, plane.centre)),
        normal(rotate(T_camera_marker, plane.normal)),
        to_camera(-1 / norm(centre) * centre) {}

  /// Angle between the normal, of whichever side, and the line of sight [rad], 0 to pi/2.
  double tilt() const noexcept { return std::atan2(norm(cross(normal, to_camera)), std::abs(dot(normal, to_camera))); }
};

/// The other pose at which a planar wireframe has nearly the same image: tilted as much to the other side of its line
/// of sight. It is mirrored in depth, which leaves the image alone, and in its own plane, which leaves the wireframe
/// alone: R' = (I - 2 d d^T) R (I - 2 n n^T), with d the direction to the camera and n the normal [marker frame]. In
/// the image, the two differ by their perspective only.
inline Eigen::Isometry3d mirrored(const Eigen::Isometry3d& T_camera_marker, const ModelPlane& plane = {}) noexcept {
  const SeenPlane seen(T_camera_marker, plane);
  const double n[] = {plane.normal.x, plane.normal.y, plane.normal.z};
  Eigen::Isometry3d T = T_camera_marker;
  for (int i = 0; i < 3; ++i) {
    const Vec3 of_plane = axis(T_camera_marker, i) - 2 * n[i] * seen.normal;
    set_axis(T, i, of_plane - 2 * dot(seen.to_camera, of_plane) * seen.to_camera);
  }
  set_translation(T, translation(T) + seen.centre - transform(T, plane.centre));
  return T;
}

/// How the mirrored pose moves when the pose does: the derivative of `mirrored`, perturbations as in PoseEstimate.
inline Matrix6d mirrored_motion(const Eigen::Isometry3d& T_camera_marker, const ModelPlane& plane = {}) noexcept {
  const SeenPlane seen(T_camera_marker, plane);
  const Vec3 d = seen.to_camera, arm = seen.centre - translation(T_camera_marker),
             mirrored_arm = seen.centre - translation(mirrored(T_camera_marker, plane));
  Matrix6d J;
  for (int i = 0; i < 6; ++i) {
    Vec6 motion;
    (i < 3 ? motion.t : motion.r) = Eigen::Vector3d::Unit(i % 3);
    const Vec3 of_centre = motion.t + cross(motion.r, arm);
    // The rotation mirrored in depth, and twice that of the line of sight.
    const Vec3 r = 2 * dot(d, motion.r) * d - motion.r - 2 / norm(seen.centre) * cross(d, of_centre);
    const Vec6 of_mirrored{of_centre - cross(r, mirrored_arm), r};
    const auto column = of_mirrored.array();
    for (std::size_t k = 0; k < 6; ++k) J(static_cast<Eigen::Index>(k), i) = column[k];
  }
  return J;
}

}  // namespace evmarker
