#pragma once
// Finds the markers to which an event may belong, in constant time.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/model/undistortion_table.hpp"

namespace evmarker {

/// The image in tiles, each with the set of markers whose events may lie in it. Markers are numbered from 0. Only the
/// constructor may throw or allocate, and `resize` beyond `max_markers`.
class TileMap {
 public:
  /// @param max_markers for which `resize` needs no memory
  TileMap(const UndistortionTable& lines_of_sight, std::size_t max_markers)
      : columns_(tiles(lines_of_sight.sensor_size().width)), margin_(kMargin_px / lines_of_sight.focal_length()) {
    const SensorSize size = lines_of_sight.sensor_size();
    const auto rows = tiles(size.height);
    rows_.resize(rows);
    tiles_.resize(rows * columns_);
    marker_bits_.resize(rows * columns_);
    areas_.reserve(max_markers);
    Event event;
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x) {
        event.x = static_cast<std::uint16_t>(x);
        event.y = static_cast<std::uint16_t>(y);
        const Vec2 m = lines_of_sight(event);
        if (!is_finite(m)) continue;  // matches no marker
        tiles_[tile(event)].extend(m);
        rows_[event.y / kTile_px].extend(m);
      }
  }

  /// Sets the number of markers. All places are forgotten: until its first `move`, a marker is nowhere.
  void resize(std::size_t markers) {
    areas_.assign(markers, Box());
    marker_bits_.assign(marker_bits_.size(), 0);
  }

  /// Sets where a marker may have events.
  /// @param reach lines of sight (X/Z, Y/Z)
  void move(std::size_t marker, const Box& reach) noexcept {
    // With a margin, so that small motions change nothing: kept while half of it is left, by which events that wait to
    // be given to the marker may still move it, and while it is not too wide by more than another margin.
    const Box before = areas_[marker], now = reach.widened(margin_);
    if (before.contains(reach.widened(margin_ / 2)) && now.widened(margin_).contains(before)) return;
    areas_[marker] = now;
    const std::uint64_t bit = bit_of(marker);
    for (std::size_t row = 0; row < rows_.size(); ++row) {
      if (!rows_[row].intersects(before) && !rows_[row].intersects(now)) continue;
      for (std::size_t i = row * columns_; i < (row + 1) * columns_; ++i)
        marker_bits_[i] =
            any_marker_reaches(tiles_[i], marker % kBits) ? marker_bits_[i] | bit : marker_bits_[i] & ~bit;
    }
  }

  /// True if an event, which must lie on the sensor, may belong to more than one marker.
  bool shared(const Event& event, const UndistortionTable& lines_of_sight) const noexcept {
    const std::uint64_t bits = marker_bits_[tile(event)];
    if ((bits & (bits - 1)) == 0 && areas_.size() <= kBits) [[likely]]
      return false;
    const Vec2 m = lines_of_sight(event);
    int markers = 0;
    for_each_at(event, [&](std::size_t i) { markers += areas_[i].contains(m); });
    return markers > 1;
  }

  /// Calls `use(marker)` with the number of every marker to which an event, which must lie on the sensor, may belong.
  /// It is also called with some others: areas have a margin, and tiles are coarse.
  template <typename Use>
  void for_each_at(const Event& event, const Use& use) const {
    for (std::uint64_t bits = marker_bits_[tile(event)]; bits != 0; bits &= bits - 1)
      for (auto i = static_cast<std::size_t>(std::countr_zero(bits)); i < areas_.size(); i += kBits) use(i);
  }

 private:
  static constexpr std::size_t kTile_px = 8, kBits = 64;
  static constexpr double kMargin_px = 6;

  static std::size_t tiles(int pixels) noexcept { return (static_cast<std::size_t>(pixels) + kTile_px - 1) / kTile_px; }
  std::size_t tile(const Event& event) const noexcept { return event.y / kTile_px * columns_ + event.x / kTile_px; }
  // The 65th marker shares the bit of the first: both get the tiles of either.
  static std::uint64_t bit_of(std::size_t marker) noexcept { return std::uint64_t{1} << (marker % kBits); }
  // True if marker `first`, below kBits, or another one with its bit may have events in a tile.
  bool any_marker_reaches(const Box& tile, std::size_t first) const noexcept {
    for (std::size_t i = first; i < areas_.size(); i += kBits)
      if (tile.intersects(areas_[i])) return true;
    return false;
  }

  std::size_t columns_;
  double margin_;                           // [tangent]
  std::vector<Box> tiles_;                  // lines of sight of the pixels of each tile
  std::vector<Box> rows_;                   // the same for whole rows of tiles
  std::vector<std::uint64_t> marker_bits_;  // of each tile, see bit_of
  std::vector<Box> areas_;                  // of each marker: where it may have events, with a margin
};

}  // namespace evmarker
