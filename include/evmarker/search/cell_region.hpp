#pragma once
// A rectangle of the image in square cells.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace evmarker {

/// A rectangle of the undistorted image [px from the principal point], cut into cells of a pixel or more so that there
/// are not too many, with a rim of cells around it.
struct CellRegion {
  Eigen::Vector2d low{0, 0};  ///< corner
  double cell_px = 1;
  int width = 1, height = 1;                     ///< [cells]
  int left = 0, top = 0, right = 1, bottom = 1;  ///< cells on the sensor: from (left, top) to before (right, bottom)

  /// @param box that is wanted, @param image that there is [px]
  /// @param most cells to each side, @param rim cells around the box
  static CellRegion of(const Eigen::AlignedBox2d& box, const Eigen::AlignedBox2d& image, int most, int rim) noexcept {
    Eigen::AlignedBox2d seen = box.intersection(image);
    if (seen.isEmpty()) seen = Eigen::AlignedBox2d(image.center().eval());
    CellRegion region;
    region.cell_px = std::max(1.0, seen.sizes().maxCoeff() / (most - 2 * rim - 1));
    region.low = seen.min().array() - (rim + 1e-6) * region.cell_px;  // rounding does not put the corner on the rim
    const Eigen::Array2i size =
        ((seen.sizes() / region.cell_px).array().floor().cast<int>() + 2 * rim + 1).min(most).eval();
    region.width = size.x();
    region.height = size.y();
    const Eigen::Array2i first = region.place(image.min()).array().floor().max(0).cast<int>();
    const Eigen::Array2i last = region.place(image.max()).array().floor().min(most).cast<int>().min(size - 1);
    region.left = first.x();
    region.top = first.y();
    region.right = last.x() + 1;
    region.bottom = last.y() + 1;
    return region;
  }

  /// Of a pixel, in cells from the corner.
  Eigen::Vector2d place(const Eigen::Vector2d& u) const noexcept { return (u - low) / cell_px; }

  /// The number of a pixel's cell, row by row, or -1 outside.
  int cell(const Eigen::Vector2d& u) const noexcept {
    const Eigen::Vector2d p = place(u);
    const bool inside = p.x() >= 0 && p.y() >= 0 && p.x() < width && p.y() < height;
    return inside ? static_cast<int>(p.y()) * width + static_cast<int>(p.x()) : -1;
  }

  bool on_sensor(int x, int y) const noexcept { return x >= left && x < right && y >= top && y < bottom; }
  int cells_on_sensor() const noexcept { return std::max(0, right - left) * std::max(0, bottom - top); }
};

}  // namespace evmarker
