#pragma once
// Nearest model edge of an event: segment matching on any wireframe, Eqs. (1) to (5).
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/require.hpp"
#include "evmarker/matching/closest_points.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

struct SegmentMatcherSettings {
  double max_distance_px = 2;  ///< Eq. (1): farther events are discarded
  double end_margin_px = 0.5;  ///< how far beyond its ends a segment reaches for events
  double ambiguity_px = 0.2;   ///< the runner-up must be this much farther than the best, or the event is discarded
};

/// @throws std::invalid_argument naming the setting that is out of range
inline void validate(const SegmentMatcherSettings& settings) {
  const Require require("segment matcher");
  require(settings.max_distance_px > 0, "max_distance_px", settings.max_distance_px);
  require(settings.end_margin_px >= 0, "end_margin_px", settings.end_margin_px);
  require(settings.ambiguity_px >= 0, "ambiguity_px", settings.ambiguity_px);
}

/// What an event was matched to.
enum class MatchResult {
  matched,
  ambiguous,  ///< two segments are nearly equally near
  near,       ///< not matched, but beside a segment and within three times the maximal distance
  far
};

/// Matches events to the nearest segment of a wireframe at one pose. Distances are in undistorted pixels.
class SegmentMatcher {
 public:
  /// @param focal_length [px], converts directions to pixels
  /// @throws std::invalid_argument for a model that cannot be tracked or a setting out of range
  SegmentMatcher(MarkerModel model, double focal_length, SegmentMatcherSettings settings = {})
      : model_(std::move(model)), focal_length_(focal_length), settings_(settings) {
    validate(model_);
    Require("segment matcher").positive(focal_length, "focal length");
    validate(settings);
    segments_.resize(model_.segments.size());
    vertices_.resize(model_.vertices.size());
  }

  /// Sets another maximal distance: at once for what matches, from the next `project` on for how far `near` reaches.
  void set_max_distance_px(double distance_px) noexcept { settings_.max_distance_px = distance_px; }

  /// Projects the wireframe at a pose, without the edges on faces that are turned away. False, and no event matches,
  /// while any vertex is not in front of the camera or not finite, or no edge faces the camera.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    box_ = {};  // empty: nothing matches unless this succeeds
    Box box;
    for (std::size_t i = 0; i < vertices_.size(); ++i) {
      vertices_[i] = transform(T_camera_marker, model_.vertices[i]);
      if (!(vertices_[i].z > 1e-6 && is_finite(vertices_[i]))) return false;
      box.extend(image(vertices_[i]));
    }
    count_ = 0;
    for (std::size_t i = 0; i < model_.segments.size(); ++i) {
      const MarkerSegment& edge = model_.segments[i];
      if (!faces_camera(edge, vertices_[static_cast<std::size_t>(edge.from)], T_camera_marker)) continue;
      segments_[count_] = project(edge, T_camera_marker);
      segments_[count_++].index = static_cast<int>(i);
    }
    if (count_ > 0) box_ = box.widened(std::hypot(kNearFactor * settings_.max_distance_px, settings_.end_margin_px));
    return count_ > 0;
  }

  /// Finds the segment of an event with line of sight (m; 1), Eqs. (1) to (5). `correspondence` is valid if the result
  /// is `matched`.
  MatchResult match(Vec2 m, Correspondence& correspondence) const noexcept {
    const Vec2 u = focal_length_ * m;
    if (!box_.contains(u)) return MatchResult::far;
    const auto [segment, distance_px, second_px] = nearest_two(u);
    const double best_px = std::abs(distance_px);
    if (!(best_px < kNearFactor * settings_.max_distance_px)) return MatchResult::far;
    if (best_px > settings_.max_distance_px) return MatchResult::near;
    if (second_px - best_px < settings_.ambiguity_px) return MatchResult::ambiguous;
    const Vec3 M{m.x, m.y, 1};
    const ClosestPoints points = closest_points(segment->V, segment->S, 0, 1, M);
    if (!points.valid) return MatchResult::near;
    const Vec2 normal{segment->line.x, segment->line.y};
    correspondence.segment = segment->index;
    correspondence.distance_px = distance_px;
    correspondence.squared_px = best_px * best_px;
    correspondence.from_end_px2 = from_end_px2(points, segment->S, 0, 1, focal_length_);
    correspondence.normal = normal;
    correspondence.dark_side_known = segment->dark_side_known;
    correspondence.gradient = image_gradient(normal, points.E, focal_length_);
    correspondence.M = M;
    correspondence.E = points.E;
    correspondence.F = points.F;
    return MatchResult::matched;
  }

  /// Events with lines of sight (X/Z, Y/Z) outside of this are far from every segment.
  Box reach() const noexcept { return {box_.low / focal_length_, box_.high / focal_length_}; }
  const MarkerModel& model() const noexcept { return model_; }
  double focal_length() const noexcept { return focal_length_; }

 private:
  static constexpr double kNearFactor = 3;  // up to this multiple of the maximal distance, events are near

  struct ProjectedSegment {
    Vec2 v;              // projected start [px]
    Vec2 direction;      // unit, along the segment
    Vec3 line;           // (n; c) of Eq. (1), n.u + c = 0 [px], |n| = 1; n toward the dark side if it is known
    double half_length;  // [px]
    bool dark_side_known;
    int index;  // in the model
    Vec3 V, S;  // start and extent in the camera frame [m]
  };

  struct NearestTwo {
    const ProjectedSegment* segment;
    double distance_px;  // to `segment`, signed
    double second_px;    // to the runner-up, absolute
  };

  // The nearest two of the segments that contain the foot of the perpendicular from u, end margin included.
  NearestTwo nearest_two(Vec2 u) const noexcept {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    double best = kNone;
    NearestTwo nearest{nullptr, kNone, kNone};
    for (std::size_t i = 0; i < count_; ++i) {
      const ProjectedSegment& segment = segments_[i];
      const double foot = dot(u - segment.v, segment.direction), distance = line_distance(segment.line, u);
      const bool beside = std::abs(foot - segment.half_length) <= segment.half_length + settings_.end_margin_px;
      const double d = beside ? std::abs(distance) : kNone;
      nearest.second_px = std::min(nearest.second_px, std::max(best, d));  // the best so far, once d beats it
      if (d < best) {
        best = d;
        nearest.segment = &segment;
        nearest.distance_px = distance;
      }
    }
    return nearest;
  }

  Vec2 image(Vec3 P) const noexcept { return image_point(P, focal_length_); }

  ProjectedSegment project(const MarkerSegment& edge, const Eigen::Isometry3d& T_camera_marker) const noexcept {
    ProjectedSegment s;
    s.V = vertices_[static_cast<std::size_t>(edge.from)];
    const Vec3 V_end = vertices_[static_cast<std::size_t>(edge.to)];
    s.S = V_end - s.V;
    s.v = image(s.V);
    const Vec2 along = image(V_end) - s.v;
    const double length = norm(along);
    s.direction = length > 0 ? along / length : Vec2(1, 0);
    s.half_length = length / 2;
    Vec2 normal{-s.direction.y, s.direction.x};
    // Image motion of the edge's middle when it moves into the dark, up to a factor: d(X/Z) = (Z dX - X dZ) / Z^2.
    const Vec3 middle = s.V + s.S / 2, dark = rotate(T_camera_marker, edge.dark_side);
    const double toward_dark = dot(normal, middle.z * Vec2(dark.x, dark.y) - dark.z * Vec2(middle.x, middle.y));
    s.dark_side_known = toward_dark != 0;
    if (toward_dark < 0) normal = -1 * normal;
    s.line = {normal.x, normal.y, -dot(normal, s.v)};
    return s;
  }

  MarkerModel model_;
  double focal_length_;
  SegmentMatcherSettings settings_;
  std::vector<Vec3> vertices_;              // camera frame [m]
  std::vector<ProjectedSegment> segments_;  // the first `count_` are to be seen
  std::size_t count_ = 0;
  Box box_;  // [px] no event outside is near a segment
};

}  // namespace evmarker
