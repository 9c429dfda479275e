#pragma once
// Markers that hide each other: a marker's sheet is opaque, and its rim makes events like an edge.
#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/tracking/marker_tracker.hpp"

namespace evmarker {

inline constexpr double kSheetRim = 1;  ///< width of the white rim around a code marker, which it needs [cells]

/// Inverse depth 1/Z [1/m] of the point where the line of sight (m; 1) meets the plane of a code marker; not positive
/// if it does not, 0 for a marker that is not matched through its grid at the present pose.
inline double inverse_depth(const GridMatcher& matcher, Vec2 m) noexcept {
  return matcher.on_grid() ? matcher.projected().inverse_depth(matcher.projected().sight(m)) : 0;
}

/// True if that point is on the marker's sheet, so near to its rim that its events are the rim's included. The sheet of
/// a square without a code is the square.
inline bool on_sheet(const GridMatcher& matcher, Vec2 m) noexcept {
  const ProjectedGrid& grid = matcher.projected();
  const double rim = grid.cells() > 1 ? kSheetRim : 0;
  const double edge = grid.rate() * matcher.max_distance_px() / matcher.focal_length();
  return matcher.on_grid() && grid.within(rim + edge, grid.sight(m));
}

/// Inverse depth [1/m] at which a tracked marker's sheet blocks the line of sight (m; 1); 0 if it does not, or if the
/// marker's pose is in doubt.
template <PoseUpdateRule Rule>
double sheet_inverse_depth(const MarkerTracker<Rule>& tracker, Vec2 m) noexcept {
  const GridMatcher& matcher = tracker.follower().matcher();
  return tracker.reliable() && on_sheet(matcher, m) ? inverse_depth(matcher, m) : 0;
}

/// True if a sheet at that inverse depth hides the marker on the line of sight (m; 1). False if the marker's depth
/// there is not known.
template <PoseUpdateRule Rule>
bool hidden_by(double sheet_inverse_depth, const MarkerTracker<Rule>& tracker, Vec2 m) noexcept {
  constexpr double kResolvable = 1.003;  // nearer sheets may lie on each other: the poses' errors decide which is above
  const double its = inverse_depth(tracker.follower().matcher(), m);
  return its > 0 && kResolvable * its < sheet_inverse_depth;
}

}  // namespace evmarker
