#pragma once
// Occlusion of markers by each other: the sheet of a marker is opaque, and its outline makes events like an edge.
#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/tracking/marker_tracker.hpp"

namespace evmarker {

inline constexpr double kQuietZone = 1;  ///< width of the white border that every code marker should have [cells]

/// Inverse depth 1/Z [1/m] of the point where the line of sight (m; 1) meets the plane of a code marker. Not positive
/// if they do not meet in front of the camera; 0 if the marker is not matched by its grid at the present pose.
inline double inverse_depth(const GridMatcher& matcher, Vec2 m) noexcept {
  return matcher.on_grid() ? matcher.projected().inverse_depth(matcher.projected().grid_point(m)) : 0;
}

/// True if the line of sight (m; 1) meets the marker's sheet, or passes it within the matching distance, where events
/// may come from the outline of the sheet. The sheet of a square without a code is the square.
inline bool on_sheet(const GridMatcher& matcher, Vec2 m) noexcept {
  const ProjectedGrid& grid = matcher.projected();
  const double border = grid.cells() > 1 ? kQuietZone : 0;
  const double edge = grid.rate() * matcher.max_distance_px() / matcher.focal_length();
  return matcher.on_grid() && grid.within(border + edge, grid.grid_point(m));
}

/// Inverse depth [1/m] at which the sheet of a marker blocks the line of sight (m; 1); 0 if it does not, if the tracker
/// is not `reliable()`, or if its marker is not matched by a grid: boards and other wireframes hide nothing.
template <PoseUpdateRule Rule>
double sheet_inverse_depth(const MarkerTracker<Rule>& tracker, Vec2 m) noexcept {
  const GridMatcher& matcher = tracker.follower().matcher().grid();
  return tracker.reliable() && on_sheet(matcher, m) ? inverse_depth(matcher, m) : 0;
}

/// True if a sheet at an inverse depth [1/m] hides a marker on the line of sight (m; 1). False if the marker's depth
/// there is not known.
template <PoseUpdateRule Rule>
bool hidden_by(double blocking_inverse_depth, const MarkerTracker<Rule>& tracker, Vec2 m) noexcept {
  // Ratio of depths; below it, sheets may lie on each other, and errors of the poses decide which is nearer.
  constexpr double kResolvable = 1.003;
  const double marker_inverse_depth = inverse_depth(tracker.follower().matcher().grid(), m);
  return marker_inverse_depth > 0 && kResolvable * marker_inverse_depth < blocking_inverse_depth;
}

}  // namespace evmarker
