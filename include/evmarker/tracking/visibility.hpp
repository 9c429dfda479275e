#pragma once
// Whether a marker can be seen from where it is.
#include <Eigen/Geometry>
#include <algorithm>
#include <optional>

#include "evmarker/base/box.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/model/marker_model.hpp"

namespace evmarker {

/// Tells from a marker's pose whether enough of it can be seen to follow it.
class Visibility {
 public:
  explicit Visibility(const MarkerModel& model) noexcept : centre_(centre(model)), face_(only_face(model)) {}

  /// With less than half of the marker in the image, too few events are left to follow it.
  /// @param image of the plane z = 1
  bool out_of_image(const Eigen::Isometry3d& T_camera_marker, const Box& image) const noexcept {
    const Vec3 centre = transform(T_camera_marker, centre_);
    const Vec2 low = centre.z * image.low, high = centre.z * image.high;
    return centre.x < low.x || centre.y < low.y || centre.x > high.x || centre.y > high.y;
  }

  /// At 80 deg from the line of sight a face is a sixth as wide as it is long: its edges lie within the matching
  /// distance of each other, and where it turns farther, the pose would stay behind and stick to whatever else makes
  /// events there. Never true of a body of several faces.
  bool turned_away(const Eigen::Isometry3d& T_camera_marker) const noexcept {
    constexpr double kFlattest = 0.17364817766693033;  // cos 80 deg
    if (!face_) return false;
    const Vec3 sight = transform(T_camera_marker, centre_);
    const double towards = -dot(rotate(T_camera_marker, *face_), sight);
    return !(towards > 0) || towards * towards < kFlattest * kFlattest * squared_norm(sight);
  }

 private:
  // The normal of the face on which all edges are, if they are on one.
  static std::optional<Vec3> only_face(const MarkerModel& model) noexcept {
    const Vec3 normal = model.segments.front().face_normal;
    const bool one = squared_norm(normal) > 0 && std::ranges::all_of(model.segments, [&](const MarkerSegment& segment) {
                       return dot(normal, segment.face_normal) > 1 - 1e-9;
                     });
    return one ? std::optional(normal) : std::nullopt;
  }

  Vec3 centre_;               // of the model's bounding box, marker frame [m]
  std::optional<Vec3> face_;  // see only_face
};

}  // namespace evmarker
