#pragma once
// Times of the leak events of pixels under constant light.
#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

/// Times [us] at which the pixels will fire by their leak alone if the light stays constant, with the first time of
/// every tile. For a sensor without a leak it is empty, all calls do nothing and nothing is ever due.
class LeakSchedule {
 public:
  /// @param leaky false for a sensor without a leak
  LeakSchedule(const TileGrid& grid, bool leaky)
      : pixels_(leaky ? grid.indices() : 0, kNever), tiles_(leaky ? grid.tiles() : 0, kNever) {}

  /// Sets a pixel's time; its tile then needs `update`.
  /// @param pixel index in the grid
  void set(std::size_t pixel, double us) {
    if (!pixels_.empty()) pixels_[pixel] = us;
  }

  /// Updates the first time of a tile after `set`.
  void update(std::size_t tile) {
    if (tiles_.empty()) return;
    const auto first = pixels_.begin() + static_cast<std::ptrdiff_t>(tile * TileGrid::kPixelsPerTile);
    tiles_[tile] = *std::min_element(first, first + TileGrid::kPixelsPerTile);
  }

  /// True if some pixel of a tile will fire before a time.
  bool due(std::size_t tile, double until_us) const { return !tiles_.empty() && tiles_[tile] < until_us; }

  /// Calls `act(pixel)` for every pixel of a tile that will fire before a time.
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
  std::vector<double> tiles_;   // first times
};

}  // namespace evmarker
