#include "evmarker/simulation/leak_schedule.hpp"

#include <doctest/doctest.h>

#include <vector>

using namespace evmarker;

namespace {

std::vector<std::size_t> due(const LeakSchedule& schedule, std::size_t tile, double until_us) {
  std::vector<std::size_t> pixels;
  schedule.for_each_due(tile, until_us, [&](std::size_t pixel) { pixels.push_back(pixel); });
  return pixels;
}

}  // namespace

TEST_CASE("pixels are due tile by tile, from the time on that was set") {
  LeakSchedule schedule(TileGrid({40, 20}), true);
  const std::size_t other_tile = 2 * TileGrid::kPixelsPerTile;
  CHECK_FALSE(schedule.due(0, 1e12));
  schedule.set(3, 500);
  schedule.set(7, 200);
  schedule.set(other_tile + 1, 100);
  schedule.update(0);
  schedule.update(2);
  CHECK_FALSE(schedule.due(0, 200));
  CHECK(schedule.due(0, 201));
  CHECK(due(schedule, 0, 201) == std::vector<std::size_t>{7});
  CHECK(due(schedule, 0, 501) == std::vector<std::size_t>{3, 7});
  CHECK(due(schedule, 2, 101) == std::vector<std::size_t>{other_tile + 1});
  CHECK(due(schedule, 1, 1e12).empty());
  schedule.set(7, 900);
  schedule.update(0);
  CHECK_FALSE(schedule.due(0, 500));
}

TEST_CASE("on a sensor that does not leak nothing is ever due") {
  LeakSchedule schedule(TileGrid({40, 20}), false);
  schedule.set(3, 500);
  schedule.update(0);
  CHECK_FALSE(schedule.due(0, 1e12));
  CHECK(due(schedule, 0, 1e12).empty());
}
