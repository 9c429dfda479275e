#pragma once
// Numbering of a sensor's pixels by square tiles.
#include <cstddef>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Numbers the pixels of a sensor tile by tile, so that pixels near each other are near in memory. Tiles at the right
/// and the bottom may reach beyond the sensor: not every index is a pixel of the sensor.
class TileGrid {
 public:
  static constexpr int kSide = 16;  ///< of a tile [px]
  static constexpr std::size_t kPixelsPerTile = std::size_t{kSide} * kSide;

  explicit TileGrid(SensorSize size) noexcept
      : size_(size), columns_((size.width + kSide - 1) / kSide), rows_((size.height + kSide - 1) / kSide) {}

  SensorSize sensor_size() const noexcept { return size_; }
  /// Number of tiles.
  std::size_t tiles() const noexcept { return static_cast<std::size_t>(columns_ * rows_); }
  /// One more than the greatest index.
  std::size_t indices() const noexcept { return tiles() * kPixelsPerTile; }

  /// The tile that an index is in.
  static std::size_t tile(std::size_t index) noexcept { return index / kPixelsPerTile; }

  /// The index of a pixel of the sensor.
  std::size_t index(int x, int y) const noexcept {
    const int place = y / kSide * columns_ + x / kSide;
    return static_cast<std::size_t>((place * kSide + y % kSide) * kSide + x % kSide);
  }
  /// The pixel of an index.
  int x(std::size_t index) const noexcept {
    return static_cast<int>(index / kPixelsPerTile) % columns_ * kSide + static_cast<int>(index) % kSide;
  }
  int y(std::size_t index) const noexcept {
    return static_cast<int>(index / kPixelsPerTile) / columns_ * kSide + static_cast<int>(index) / kSide % kSide;
  }
  /// True if the pixel of an index lies on the sensor.
  bool on_sensor(std::size_t index) const noexcept { return size_.contains(x(index), y(index)); }

 private:
  SensorSize size_;
  int columns_, rows_;
};

}  // namespace evmarker
