#pragma once
// Floor 8. Which of several markers an event may belong to where they hide each other.
#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

#include "evmarker/found_marker.hpp"
#include "evmarker/tile_map.hpp"

namespace evmarker {

/// Calls `use(marker)` for every marker to which an event on the sensor may belong and that no other one hides there. A
/// marker's paper is opaque, and where it covers the edges behind it, its own edge looks like theirs: they would follow
/// it. Not inline, for the sake of the events that only one marker may have.
/// @param m line of sight (m; 1) of the event
template <PoseUpdateRule Rule, typename Use>
[[gnu::noinline]] void for_each_visible_at(const Event& event, const Eigen::Vector2d& m, const TileMap& tiles,
                                           const std::vector<FoundMarker<Rule>>& markers, const Use& use) {
  double nearest = 0;
  tiles.for_each_at(event, [&](std::size_t i) { nearest = std::max(nearest, markers[i].tracker().paper_nearness(m)); });
  tiles.for_each_at(event, [&](std::size_t i) {
    if (!markers[i].tracker().behind(nearest, m)) use(i);
  });
}

}  // namespace evmarker
