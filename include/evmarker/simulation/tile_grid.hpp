#pragma once
// A sensor's pixels in square tiles.
#include <cstddef>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Numbers the pixels of a sensor tile by tile, so that neighbours are neighbours in memory. Tiles at the right and the
/// bottom reach beyond the sensor: not every index is a pixel.
class TileGrid {
 public:
  static constexpr int kSide = 16;
  static constexpr std::size_t kPixelsPerTile = std::size_t{kSide} * kSide;

  explicit TileGrid(SensorSize size) noexcept
      : size_(size), columns_((size.width + kSide - 1) / kSide), rows_((size.height + kSide - 1) / kSide) {}

  SensorSize sensor_size() const noexcept { return size_; }
  std::size_t tiles() const noexcept { return static_cast<std::size_t>(columns_ * rows_); }
  /// One more than the greatest index.
  std::size_t indices() const noexcept { return tiles() * kPixelsPerTile; }

  static std::size_t tile(std::size_t index) noexcept { return index / kPixelsPerTile; }

  std::size_t index(int x, int y) const noexcept {
    const int place = y / kSide * columns_ + x / kSide;
    return static_cast<std::size_t>((place * kSide + y % kSide) * kSide + x % kSide);
  }
  int x(std::size_t index) const noexcept {
    return static_cast<int>(index / kPixelsPerTile) % columns_ * kSide + static_cast<int>(index) % kSide;
  }
  int y(std::size_t index) const noexcept {
    return static_cast<int>(index / kPixelsPerTile) / columns_ * kSide + static_cast<int>(index) / kSide % kSide;
  }
  bool on_sensor(std::size_t index) const noexcept { return size_.contains(x(index), y(index)); }

 private:
  SensorSize size_;
  int columns_, rows_;
};

}  // namespace evmarker
