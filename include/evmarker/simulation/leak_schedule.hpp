#pragma once
// When pixels that sleep under constant light fire all the same.
#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

/// The time [us] at which each pixel will fire of its leak alone if the light stays as it is, and the first one of
/// every tile. Empty, and all calls do nothing, for a sensor that does not leak.
class LeakSchedule {
 public:
  LeakSchedule(const TileGrid& grid, bool leaky)
      : pixels_(leaky ? grid.indices() : 0, kNever), tiles_(leaky ? grid.tiles() : 0, kNever) {}

  void set(std::size_t pixel, double us) {
    if (!pixels_.empty()) pixels_[pixel] = us;
  }

  /// Notes the first one of a tile whose pixels have been set.
  void update(std::size_t tile) {
    if (tiles_.empty()) return;
    const auto first = pixels_.begin() + static_cast<std::ptrdiff_t>(tile * TileGrid::kPixelsPerTile);
    tiles_[tile] = *std::min_element(first, first + TileGrid::kPixelsPerTile);
  }

  /// True if some pixel of a tile will fire before a time.
  bool due(std::size_t tile, double until_us) const { return !tiles_.empty() && tiles_[tile] < until_us; }

  /// Calls `act(pixel)` for all that will.
  template <typename Action>
  void for_each_due(std::size_t tile, double until_us, Action&& act) const {
    if (!due(tile, until_us)) return;
    const std::size_t first = tile * TileGrid::kPixelsPerTile;
    for (std::size_t i = first; i < first + TileGrid::kPixelsPerTile; ++i)
      if (pixels_[i] < until_us) act(i);
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  std::vector<double> pixels_;  // in the order of the grid
  std::vector<double> tiles_;
};

}  // namespace evmarker
