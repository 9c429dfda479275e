#pragma once
// A rectangle of the image, divided into square cells.
#include <algorithm>
#include <cmath>

#include "evmarker/base/box.hpp"

namespace evmarker {

/// A rectangle of the undistorted image, divided into square cells of at least a pixel, with a rim of cells around it.
/// Image coordinates are in px from the principal point, x right, y down. The cells are numbered row by row.
struct CellRegion {
  Vec2 low;                                      ///< top left corner
  double cell_px = 1;                            ///< side of a cell
  int width = 1, height = 1;                     ///< [cells]
  int left = 0, top = 0, right = 1, bottom = 1;  ///< cells on the sensor: columns [left, right), rows [top, bottom)

  /// The region around the part of a box that lies in the image; around the centre of the image if there is none.
  /// @param box,image [px from the principal point]
  /// @param most largest width and height of the region, rim included [cells], at least 2 rim + 2
  /// @param rim width of the rim [cells]
  static CellRegion of(const Box& box, const Box& image, int most, int rim) noexcept {
    Box seen = box.intersection(image);
    if (seen.empty()) seen = {0.5 * (image.low + image.high), 0.5 * (image.low + image.high)};
    CellRegion region;
    region.cell_px = std::max(1.0, seen.size() / (most - 2 * rim - 1));
    // The small addition keeps rounding from moving the box's corner into the rim.
    region.low = seen.widened((rim + 1e-6) * region.cell_px).low;
    const auto cells = [&](double length) {
      return std::min(static_cast<int>(std::floor(length / region.cell_px)) + 2 * rim + 1, most);
    };
    region.width = cells(seen.width());
    region.height = cells(seen.height());
    const Vec2 first = region.to_cells(image.low), last = region.to_cells(image.high);
    region.left = static_cast<int>(std::max(std::floor(first.x), 0.0));
    region.top = static_cast<int>(std::max(std::floor(first.y), 0.0));
    const auto end = [&](double cell, int size) {
      return std::min(static_cast<int>(std::min(std::floor(cell), 1.0 * most)), size - 1) + 1;
    };
    region.right = end(last.x, region.width);
    region.bottom = end(last.y, region.height);
    return region;
  }

  /// An image point's distance from the region's top left corner [cells].
  Vec2 to_cells(Vec2 u) const noexcept { return (u - low) / cell_px; }

  /// The number of the cell that contains an image point, or -1 outside of the region.
  int cell(Vec2 u) const noexcept {
    const auto [x, y] = to_cells(u);
    const bool inside = x >= 0 && y >= 0 && x < width && y < height;
    return inside ? static_cast<int>(y) * width + static_cast<int>(x) : -1;
  }

  /// True if the cell in column x, row y is on the sensor.
  bool on_sensor(int x, int y) const noexcept { return x >= left && x < right && y >= top && y < bottom; }
  int cells_on_sensor() const noexcept { return std::max(0, right - left) * std::max(0, bottom - top); }
};

}  // namespace evmarker
