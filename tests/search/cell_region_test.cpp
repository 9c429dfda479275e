#include "evmarker/search/cell_region.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;

namespace {

const Box kImage{{-320, -240}, {319, 239}};

Box box(double left, double top, double right, double bottom) { return {{left, top}, {right, bottom}}; }

}  // namespace

TEST_CASE("a small box has cells of a pixel and a rim") {
  const CellRegion region = CellRegion::of(box(-10, -20, 30, 20), kImage, 256, 6);
  CHECK(region.cell_px == 1);
  CHECK(region.width == 53);
  CHECK(region.height == 53);
  CHECK(region.cells_on_sensor() == 53 * 53);
  CHECK(region.cell({-16, -26}) == 0);
  CHECK(region.cell({-14.5, -25.5}) == 1);
  CHECK(region.cell({-16, -24.9}) == 53);
  CHECK(region.cell({-16.1, 0}) == -1);
  CHECK(region.cell({37.1, 0}) == -1);
  CHECK(region.cell(Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN())) == -1);
}

TEST_CASE("a large box has larger cells, never too many, and ends at the image's rim") {
  for (const double half : {100.0, 200.0, 1000.0, 1e9}) {
    CAPTURE(half);
    const CellRegion region = CellRegion::of(box(-half, -half, half, half), kImage, 256, 6);
    CHECK(region.width <= 256);
    CHECK(region.height <= 256);
    CHECK(region.width > 200);
    CHECK(region.cell({0, 0}) >= 0);
    if (half < 300) continue;
    CHECK(region.cell_px > 2);
    CHECK(region.cell({-320, -240}) == region.top * region.width + region.left);
    CHECK(region.cell({319, 239}) == (region.bottom - 1) * region.width + region.right - 1);
    CHECK(region.left == 6);
    CHECK_FALSE(region.on_sensor(region.left - 1, region.top));
    CHECK(region.cell({-322, -240}) >= 0);  // on the rim
  }
}

TEST_CASE("a box outside of the image leaves a region somewhere in it") {
  const CellRegion region = CellRegion::of(box(1000, 1000, 1100, 1100), kImage, 256, 6);
  CHECK(region.width > 0);
  CHECK(region.cells_on_sensor() > 0);
}
