#include "evmarker/simulation/tile_grid.hpp"

#include <doctest/doctest.h>

#include <set>

using namespace evmarker;

TEST_CASE("every pixel has an index of its own and comes back from it, also in the cut tiles at the borders") {
  const TileGrid grid({37, 20});
  CHECK(grid.tiles() == 3 * 2);
  std::set<std::size_t> indices;
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 37; ++x) {
      const auto index = grid.index(x, y);
      CHECK(index < grid.indices());
      CHECK(grid.x(index) == x);
      CHECK(grid.y(index) == y);
      CHECK(grid.on_sensor(index));
      indices.insert(index);
    }
  CHECK(indices.size() == 37 * 20);
  std::size_t on_sensor = 0;
  for (std::size_t i = 0; i < grid.indices(); ++i) on_sensor += grid.on_sensor(i);
  CHECK(on_sensor == 37 * 20);
}

TEST_CASE("a tile is a square of neighbours") {
  const TileGrid grid({64, 48});
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x)
      CHECK(TileGrid::tile(grid.index(x, y)) == static_cast<std::size_t>(y / 16 * 4 + x / 16));
}
