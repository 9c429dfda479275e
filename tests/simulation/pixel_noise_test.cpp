#include "evmarker/simulation/pixel_noise.hpp"

#include <doctest/doctest.h>

#include <cmath>

using namespace evmarker;

TEST_CASE("noise comes at its rate, tile by tile, in order of time, and does not depend on how it is drawn") {
  const TileGrid grid({100, 50});
  PixelNoise whole(grid, 20, Random(1)), cut(grid, 20, Random(1));
  const auto all = whole.draw(1e6);
  CHECK(std::abs(static_cast<double>(all.size()) - 1e5) < 4 * std::sqrt(1e5));
  for (std::size_t i = 1; i < all.size(); ++i) {
    const auto before = TileGrid::tile(all[i - 1].pixel), now = TileGrid::tile(all[i].pixel);
    CHECK((before < now || (before == now && all[i - 1].t <= all[i].t)));
  }
  std::size_t count = 0;
  for (int i = 1; i <= 10; ++i)
    for (const auto& event : cut.draw(i * 1e5)) {
      CHECK(grid.on_sensor(event.pixel));
      CHECK(event.t >= (i - 1) * 1e5);
      CHECK(event.t < i * 1e5);
      ++count;
    }
  CHECK(count == all.size());
}

TEST_CASE("without a rate there is no noise") {
  CHECK(PixelNoise(TileGrid({100, 50}), 0, Random(1)).draw(1e12).empty());
}
