#pragma once
// The lines of sight of all pixels of a simulated camera, and of the tiles of its grid.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "evmarker/base/vector.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/simulation/marker_view.hpp"
#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

/// A circle on the plane z = 1 that contains the lines of sight of a tile.
struct TileSight {
  Sight centre;      ///< that of the tile's first pixel
  double radius_px;  ///< infinite if a pixel has no line of sight
  Vec2 corner;       ///< the tile's first pixel
};

/// A table of lines of sight, computed once.
class PixelSights {
 public:
  PixelSights(const PinholeCamera& camera, const TileGrid& grid) {
    add_pixels(camera, grid);
    for (std::size_t tile = 0; tile < grid.tiles(); ++tile) add_tile(grid, tile);
  }

  /// @param index of a pixel in the grid. NaN where the lens model has no line of sight
  const Sight& pixel(std::size_t index) const noexcept { return pixels_[index]; }
  const TileSight& tile(std::size_t tile) const noexcept { return tiles_[tile]; }
  /// Tangent of the largest angle between a line of sight and the optical axis.
  double largest_tangent() const noexcept { return largest_tangent_; }

 private:
  void add_pixels(const PinholeCamera& camera, const TileGrid& grid) {
    const SensorSize size = camera.sensor_size();
    std::vector<Vec2> rays;  // with a border of one pixel around the sensor, for the differences between neighbours
    for (int y = -1; y <= size.height; ++y)
      for (int x = -1; x <= size.width; ++x) {
        const Eigen::Vector3d M = camera.line_of_sight({x, y});
        rays.emplace_back(M.x(), M.y());
      }
    const auto ray = [&](int x, int y) -> const Vec2& {
      return rays[static_cast<std::size_t>((y + 1) * (size.width + 2) + x + 1)];
    };
    const float nan = std::numeric_limits<float>::quiet_NaN();
    pixels_.assign(grid.indices(), {nan, nan, nan, nan, nan, nan});
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x) {
        Sight& sight = pixels_[grid.index(x, y)];
        const Vec2 m = ray(x, y), per_x = (ray(x + 1, y) - ray(x - 1, y)) / 2,
                   per_y = (ray(x, y + 1) - ray(x, y - 1)) / 2;
        if (!is_finite(per_x) || !is_finite(per_y) || !is_finite(m)) continue;
        sight = {static_cast<float>(m.x),     static_cast<float>(m.y),     static_cast<float>(per_x.x),
                 static_cast<float>(per_x.y), static_cast<float>(per_y.x), static_cast<float>(per_y.y)};
        largest_tangent_ =
            std::max(largest_tangent_, static_cast<double>(std::sqrt(sight.x * sight.x + sight.y * sight.y)));
      }
  }

  void add_tile(const TileGrid& grid, std::size_t tile) {
    const std::size_t first = tile * TileGrid::kPixelsPerTile;
    const Sight* const begin = &pixels_[first];
    TileSight& view = tiles_.emplace_back(TileSight{begin[0], 0, Vec2(grid.x(first), grid.y(first))});
    for (std::size_t i = 0; i < TileGrid::kPixelsPerTile; ++i)
      if (grid.on_sensor(first + i)) {
        const float x = begin[i].x - view.centre.x, y = begin[i].y - view.centre.y;
        const double distance = static_cast<double>(std::sqrt(x * x + y * y) / view.centre.scale() * 1.5f);
        view.radius_px =
            std::isfinite(distance) ? std::max(view.radius_px, distance) : std::numeric_limits<double>::infinity();
      }
  }

  std::vector<Sight> pixels_;  // in the order of the grid
  std::vector<TileSight> tiles_;
  double largest_tangent_ = 0;
};

}  // namespace evmarker
