#pragma once
// Random noise events.
#include <algorithm>
#include <cstdint>
#include <vector>

#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

/// An event of a pixel without a change of its light.
struct NoiseEvent {
  std::size_t pixel;  ///< index in the grid
  double t;           ///< [us]
  bool on;
};

/// Poisson noise of a whole sensor, at random pixels and of random polarity.
class PixelNoise {
 public:
  /// @param hz_per_px rate of the noise of each pixel
  PixelNoise(const TileGrid& grid, double hz_per_px, const Random& random)
      : grid_(grid),
        mean_interval_us_(1e6 / (hz_per_px * grid.sensor_size().width * grid.sensor_size().height)),
        random_(random) {
    next_us_ = interval_us();
  }

  /// The noise events since the last call and before a time, sorted by tile and, within a tile, by time. Valid until
  /// the next call.
  const std::vector<NoiseEvent>& draw(double until_us) {
    events_.clear();
    for (; next_us_ < until_us; next_us_ += interval_us()) {
      const int x = static_cast<int>(random_.uniform() * grid_.sensor_size().width);
      const int y = static_cast<int>(random_.uniform() * grid_.sensor_size().height);
      events_.push_back({grid_.index(x, y), next_us_, random_.bits() >> 63 != 0});
    }
    std::stable_sort(events_.begin(), events_.end(), [](const NoiseEvent& a, const NoiseEvent& b) {
      return TileGrid::tile(a.pixel) < TileGrid::tile(b.pixel);
    });
    return events_;
  }

 private:
  double interval_us() { return random_.exponential() * mean_interval_us_; }  // infinite without noise

  TileGrid grid_;
  double mean_interval_us_;
  Random random_;
  double next_us_;
  std::vector<NoiseEvent> events_;
};

}  // namespace evmarker
