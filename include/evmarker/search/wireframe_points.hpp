#pragma once
// Points along the visible edges of a wireframe at a pose.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "evmarker/base/box.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// Calls `use(from, to, u, v)` for every edge in front of the camera whose face is turned to the camera.
/// `from` and `to` are its ends in the marker frame [m], `u` and `v` their undistorted images [px from the principal
/// point].
template <typename Use>
void for_each_visible_edge(const MarkerModel& model, double focal_length, const Eigen::Isometry3d& T_camera_marker,
                           const Use& use) noexcept {
  const auto image = [&](Vec3 P) { return image_point(P, focal_length); };
  for (const MarkerSegment& edge : model.segments) {
    const Vec3 from = model.vertices[static_cast<std::size_t>(edge.from)];
    const Vec3 to = model.vertices[static_cast<std::size_t>(edge.to)];
    const Vec3 a = transform(T_camera_marker, from), b = transform(T_camera_marker, to);
    if (a.z > 1e-6 && b.z > 1e-6 && faces_camera(edge, a, T_camera_marker)) use(from, to, image(a), image(b));
  }
}

/// The box around the images of the visible edges [px from the principal point]; the origin if there are none.
inline Box image_box(const MarkerModel& model, double focal_length, const Eigen::Isometry3d& T_camera_marker) noexcept {
  Box box;
  for_each_visible_edge(model, focal_length, T_camera_marker, [&](Vec3, Vec3, Vec2 u, Vec2 v) {
    box.extend(u);
    box.extend(v);
  });
  return box.empty() ? Box{{0, 0}, {0, 0}} : box;
}

/// Points at equal distances in the image along the visible edges, in fixed memory.
class WireframePoints {
 public:
  static constexpr std::size_t kMost = 128;  ///< number of points

  /// Replaces the points by those along the edges that are visible at a pose.
  /// @param focal_length [px]
  /// @param spacing_px distance between neighbours; it is enlarged where there would be more than kMost points
  void place(const MarkerModel& model, double focal_length, const Eigen::Isometry3d& T_camera_marker,
             double spacing_px) noexcept {
    count_ = 0;
    length_px_ = 0;
    centre_ = {};
    const auto for_each_edge = [&](const auto& use) {
      for_each_visible_edge(model, focal_length, T_camera_marker, use);
    };
    for_each_edge([&](Vec3, Vec3, Vec2 u, Vec2 v) { length_px_ += norm(v - u); });
    const double count = std::floor(std::clamp(length_px_ / spacing_px, 1.0, static_cast<double>(kMost)));
    const double spacing = length_px_ / count;
    double next = spacing / 2;  // distance of the next point from the start of the present edge [px]
    for_each_edge([&](Vec3 from, Vec3 to, Vec2 u, Vec2 v) {
      const double edge_px = norm(v - u);
      for (; next < edge_px && count_ < kMost; next += spacing)
        centre_ = centre_ + (points_[count_++] = from + next / edge_px * (to - from));
      next -= edge_px;
    });
    centre_ = centre_ / static_cast<double>(std::max<std::size_t>(1, count_));
  }

  /// The points, marker frame [m].
  std::size_t size() const noexcept { return count_; }
  const Vec3& operator[](std::size_t i) const noexcept { return points_[i]; }
  auto begin() const noexcept { return points_.begin(); }
  auto end() const noexcept { return points_.begin() + static_cast<std::ptrdiff_t>(count_); }
  /// The mean of the points, marker frame [m].
  const Vec3& centre() const noexcept { return centre_; }
  /// Total length of the visible edges in the image.
  double length_px() const noexcept { return length_px_; }

 private:
  std::array<Vec3, kMost> points_;  // marker frame [m]
  std::size_t count_ = 0;
  Vec3 centre_;
  double length_px_ = 0;
};

}  // namespace evmarker
