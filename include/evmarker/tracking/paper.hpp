#pragma once
// What a marker's paper hides: it is opaque, and where it covers edges, its own edge looks like theirs.
#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/tracking/marker_tracker.hpp"

namespace evmarker {

inline constexpr double kPaperRim = 1;  ///< width of the white rim that a code marker's paper needs around it [cells]

/// 1/Z [1/m] of the point of a code marker's plane that a line of sight (m; 1) meets; not positive if there is none, 0
/// if the present pose is not matched through the grid.
inline double nearness(const GridMatcher& matcher, Vec2 m) noexcept {
  return matcher.on_grid() ? matcher.projected().nearness(matcher.projected().sight(m)) : 0;
}

/// Whether that point is on the marker's paper; an outline's is its square. The events of the paper's edge count as on
/// it.
inline bool on_paper(const GridMatcher& matcher, Vec2 m) noexcept {
  const ProjectedGrid& grid = matcher.projected();
  const double rim = grid.cells() > 1 ? kPaperRim : 0;
  const double edge = grid.rate() * matcher.max_distance_px() / matcher.focal_length();
  return matcher.on_grid() && grid.within(rim + edge, grid.sight(m));
}

/// Where a line of sight (m; 1) meets the paper of a code marker that is tracked, 1/Z [1/m]: it hides what is farther
/// away. 0 where it does not, and while its pose is not to be relied on.
template <PoseUpdateRule Rule>
double paper_nearness(const MarkerTracker<Rule>& tracker, Vec2 m) noexcept {
  const GridMatcher& matcher = tracker.follower().matcher();
  return tracker.reliable() && on_paper(matcher, m) ? nearness(matcher, m) : 0;
}

/// Whether another marker's paper that is so near hides a marker on a line of sight. False where that is not known.
template <PoseUpdateRule Rule>
bool hidden_by(double paper_nearness, const MarkerTracker<Rule>& tracker, Vec2 m) noexcept {
  constexpr double kToldApart = 1.003;  // by the poses' errors; closer sheets may lie on each other, either above
  const double its = nearness(tracker.follower().matcher(), m);
  return its > 0 && kToldApart * its < paper_nearness;
}

}  // namespace evmarker
