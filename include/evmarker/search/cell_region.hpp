#pragma once
// A rectangle of the image in square cells.
#include <algorithm>
#include <cmath>

#include "evmarker/base/box.hpp"

namespace evmarker {

/// A rectangle of the undistorted image [px from the principal point], cut into cells of a pixel or more so that there
/// are not too many, with a rim of cells around it.
struct CellRegion {
  Vec2 low;  ///< corner
  double cell_px = 1;
  int width = 1, height = 1;                     ///< [cells]
  int left = 0, top = 0, right = 1, bottom = 1;  ///< cells on the sensor: from (left, top) to before (right, bottom)

  /// @param box that is wanted, @param image that there is [px]
  /// @param most cells to each side, @param rim cells around the box
  static CellRegion of(const Box& box, const Box& image, int most, int rim) noexcept {
    Box seen = box.intersection(image);
    if (seen.empty()) seen = {0.5 * (image.low + image.high), 0.5 * (image.low + image.high)};
    CellRegion region;
    region.cell_px = std::max(1.0, seen.size() / (most - 2 * rim - 1));
    region.low = seen.widened((rim + 1e-6) * region.cell_px).low;  // rounding does not put the corner on the rim
    const auto cells = [&](double length) {
      return std::min(static_cast<int>(std::floor(length / region.cell_px)) + 2 * rim + 1, most);
    };
    region.width = cells(seen.width());
    region.height = cells(seen.height());
    const Vec2 first = region.place(image.low), last = region.place(image.high);
    region.left = static_cast<int>(std::max(std::floor(first.x), 0.0));
    region.top = static_cast<int>(std::max(std::floor(first.y), 0.0));
    const auto end = [&](double cell, int size) {
      return std::min(static_cast<int>(std::min(std::floor(cell), 1.0 * most)), size - 1) + 1;
    };
    region.right = end(last.x, region.width);
    region.bottom = end(last.y, region.height);
    return region;
  }

  /// Of a pixel, in cells from the corner.
  Vec2 place(Vec2 u) const noexcept { return (u - low) / cell_px; }

  /// The number of a pixel's cell, row by row, or -1 outside.
  int cell(Vec2 u) const noexcept {
    const auto [x, y] = place(u);
    const bool inside = x >= 0 && y >= 0 && x < width && y < height;
    return inside ? static_cast<int>(y) * width + static_cast<int>(x) : -1;
  }

  bool on_sensor(int x, int y) const noexcept { return x >= left && x < right && y >= top && y < bottom; }
  int cells_on_sensor() const noexcept { return std::max(0, right - left) * std::max(0, bottom - top); }
};

}  // namespace evmarker
