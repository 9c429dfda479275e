#pragma once
// Nearest model edge of an event: segment matching on any wireframe, Eqs. (1) to (5).
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/model/marker_model.hpp"

namespace evmarker {

struct SegmentMatcherSettings {
  double max_distance_px = 2;  ///< Eq. (1): farther events are discarded
  double end_margin_px = 0.5;  ///< how far beyond the ends of a segment the foot of an event may lie
  double ambiguity_px = 0.2;   ///< the runner-up must be this much farther than the best, or the event is discarded
};

/// @throws std::invalid_argument naming the setting that is out of range
inline void validate(const SegmentMatcherSettings& settings) {
  const Require require("segment matcher");
  require(settings.max_distance_px > 0, "max_distance_px", settings.max_distance_px);
  require(settings.end_margin_px >= 0, "end_margin_px", settings.end_margin_px);
  require(settings.ambiguity_px >= 0, "ambiguity_px", settings.ambiguity_px);
}

/// What became of an event. `contradicting`: on an edge that moves the other way; only who knows the motion can tell.
enum class MatchResult { matched, ambiguous, contradicting, near, far };

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

  /// Projects the wireframe at a pose, without the edges on faces that are turned away. False, and no event matches,
  /// while any vertex is not in front of the camera or not finite, or no edge is to be seen.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    visible_ = false;
    Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (std::size_t i = 0; i < vertices_.size(); ++i) {
      vertices_[i].noalias() = T_camera_marker * model_.vertices[i];
      if (!(vertices_[i].z() > 1e-6 && vertices_[i].allFinite())) return false;
      const Eigen::Vector2d v = focal_length_ / vertices_[i].z() * vertices_[i].head<2>();
      low = low.cwiseMin(v);
      high = high.cwiseMax(v);
    }
    count_ = 0;
    for (std::size_t i = 0; i < model_.segments.size(); ++i) {
      const MarkerSegment& edge = model_.segments[i];
      if (!faces_camera(edge, vertices_[static_cast<std::size_t>(edge.from)], T_camera_marker.linear())) continue;
      segments_[count_] = project(edge, T_camera_marker.linear());
      segments_[count_++].index = static_cast<int>(i);
    }
    const double fringe = std::hypot(3 * settings_.max_distance_px, settings_.end_margin_px);
    box_low_ = low.array() - fringe;
    box_high_ = high.array() + fringe;
    visible_ = count_ > 0;
    return visible_;
  }

  /// Finds the segment of an event with line of sight (m; 1), Eqs. (1) to (5). `near` means beside some segment and
  /// within three times the maximal distance of it, `far` anything else; `correspondence` holds the match if the result
  /// is `matched`, and nothing of use otherwise.
  MatchResult match(const Eigen::Vector2d& m, Correspondence& correspondence) const noexcept {
    if (!visible_) return MatchResult::far;
    const Eigen::Vector2d u = focal_length_ * m;
    if (!((u - box_low_).minCoeff() > 0 && (box_high_ - u).minCoeff() > 0)) return MatchResult::far;
    const double reach = 3 * settings_.max_distance_px;

    constexpr double kNone = std::numeric_limits<double>::infinity();
    double best = kNone, second = kNone, signed_best = 0;
    int nearest = -1;
    for (std::size_t i = 0; i < count_; ++i) {
      const ProjectedSegment& segment = segments_[i];
      const Eigen::Vector2d offset = u - segment.v;
      const double foot = offset.dot(segment.direction);
      const double distance = offset.dot(segment.normal);  // Eq. (1), signed
      const bool beside = std::abs(foot - segment.half_length) <= segment.half_length + settings_.end_margin_px;
      const double d = beside ? std::abs(distance) : kNone;
      second = std::min(second, std::max(best, d));
      if (d < best) {
        best = d;
        signed_best = distance;
        nearest = static_cast<int>(i);
      }
    }
    if (!(best < reach)) return MatchResult::far;
    if (best > settings_.max_distance_px) return MatchResult::near;
    if (second - best < settings_.ambiguity_px) return MatchResult::ambiguous;

    const ProjectedSegment& segment = segments_[static_cast<std::size_t>(nearest)];
    correspondence.segment = segment.index;
    correspondence.distance_px = signed_best;
    correspondence.squared_px = best * best;
    correspondence.normal = segment.normal;
    correspondence.dark_side_known = segment.dark_side_known;
    correspondence.M = {m.x(), m.y(), 1};
    if (!closest_points(segment, correspondence)) return MatchResult::near;
    const Eigen::Vector3d& E = correspondence.E;
    correspondence.gradient << segment.normal, -segment.normal.dot(E.head<2>()) / E.z();
    correspondence.gradient *= focal_length_ / E.z();
    return MatchResult::matched;
  }

  /// Events with lines of sight (X/Z, Y/Z) outside of this are far from every segment.
  Eigen::AlignedBox2d reach() const noexcept {
    return visible_ ? Eigen::AlignedBox2d(box_low_ / focal_length_, box_high_ / focal_length_) : Eigen::AlignedBox2d();
  }
  const MarkerModel& model() const noexcept { return model_; }
  double focal_length() const noexcept { return focal_length_; }

 private:
  struct ProjectedSegment {
    Eigen::Vector2d v;          // projected start [px]
    Eigen::Vector2d direction;  // unit, along the segment
    Eigen::Vector2d normal;     // unit, toward the dark side
    double half_length;         // [px]
    bool dark_side_known;
    int index;             // in the model
    Eigen::Vector3d V, S;  // start and extent in the camera frame [m]
  };

  ProjectedSegment project(const MarkerSegment& edge, const Eigen::Matrix3d& R) const noexcept {
    ProjectedSegment s;
    s.V = vertices_[static_cast<std::size_t>(edge.from)];
    const Eigen::Vector3d& V_end = vertices_[static_cast<std::size_t>(edge.to)];
    s.S = V_end - s.V;
    s.v = focal_length_ / s.V.z() * s.V.head<2>();
    const Eigen::Vector2d along = focal_length_ / V_end.z() * V_end.head<2>() - s.v;
    const double length = along.norm();
    s.direction = length > 0 ? Eigen::Vector2d(along / length) : Eigen::Vector2d::UnitX();
    s.half_length = length / 2;
    s.normal = {-s.direction.y(), s.direction.x()};
    // Where the middle of the edge would move in the image if it moved into the dark.
    const Eigen::Vector3d middle = s.V + s.S / 2;
    const Eigen::Vector3d dark = R * edge.dark_side;
    const double toward_dark = s.normal.dot(middle.z() * dark.head<2>() - dark.z() * middle.head<2>());
    s.dark_side_known = toward_dark != 0;
    if (toward_dark < 0) s.normal = -s.normal;
    return s;
  }

  // Eq. (5), solved for a1 and a2: E = V_i + a2 S (the paper writes V_j) and F = a1 M with E - F perpendicular to both.
  static bool closest_points(const ProjectedSegment& segment, Correspondence& c) noexcept {
    const Eigen::Vector3d &V = segment.V, &S = segment.S, &M = c.M;
    const double MM = M.squaredNorm(), MS = M.dot(S), SS = S.squaredNorm(), MV = M.dot(V), SV = S.dot(V);
    const double determinant = MM * SS - MS * MS;
    if (!(determinant > 1e-6 * MM * SS)) return false;  // the edge points at the camera: no constraint
    const double a2 = std::clamp((MS * MV - MM * SV) / determinant, 0.0, 1.0);
    c.E = V + a2 * S;
    c.F = M.dot(c.E) / MM * M;  // = L E: after the clamp still the nearest point of the line of sight
    return true;
  }

  MarkerModel model_;
  double focal_length_;
  SegmentMatcherSettings settings_;
  std::vector<Eigen::Vector3d> vertices_;   // camera frame [m]
  std::vector<ProjectedSegment> segments_;  // the first `count_` are to be seen
  std::size_t count_ = 0;
  Eigen::Vector2d box_low_{0, 0}, box_high_{0, 0};  // no event outside is near a segment
  bool visible_ = false;
};

}  // namespace evmarker
