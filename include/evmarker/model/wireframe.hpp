#pragma once
// A rigid body of straight edges that is tracked without a detector.
#include <Eigen/Geometry>
#include <optional>
#include <stdexcept>
#include <string>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// A body that is tracked by its edges alone, from a rough start pose on. Its frame is that of the model's vertices.
struct Wireframe {
  MarkerId id = 0;    ///< of its poses
  MarkerModel model;  ///< vertices [m]
  /// Rough T_camera_wireframe [m] at the first event: the start search begins around it.
  std::optional<Eigen::Isometry3d> start = std::nullopt;
};

/// Checks that a start pose is a rigid motion that puts all vertices in front of the camera.
/// @throws std::invalid_argument naming the fault
inline void validate_start(const MarkerModel& model, const Eigen::Isometry3d& start) {
  if (!is_finite(start)) throw std::invalid_argument("start is not finite");
  if (!is_rotation(start.linear())) throw std::invalid_argument("start is no rotation and translation");
  for (std::size_t i = 0; i < model.vertices.size(); ++i)
    if (const double z = transform(start, model.vertices[i]).z; !(z > 1e-6))
      throw std::invalid_argument("start puts vertex " + std::to_string(i) +
                                  " not in front of the camera, but at z = " + number_text(z) + " m");
}

}  // namespace evmarker
