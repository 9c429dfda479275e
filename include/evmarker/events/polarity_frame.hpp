#pragma once
// The frame of last polarities, as the image for frame-based marker detection.
#include <algorithm>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// An 8-bit image, row by row, of the last polarity at every pixel: bright after ON, dark after OFF, grey before the
/// first event. It also has the time of each pixel's last event.
class PolarityFrame {
 public:
  static constexpr std::uint8_t kOff = 0;
  static constexpr std::uint8_t kUntouched = 128;
  static constexpr std::uint8_t kOn = 255;

  /// @throws std::invalid_argument if a side is not positive
  explicit PolarityFrame(SensorSize size) : size_(size) {
    if (size.width < 1 || size.height < 1)
      throw std::invalid_argument("polarity frame: sensor size is " + std::to_string(size.width) + " x " +
                                  std::to_string(size.height));
    pixels_.assign(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height), kUntouched);
    times_.resize(pixels_.size());
  }

  /// Takes one event, which must lie on the sensor.
  void update(const Event& event) noexcept {
    const std::size_t i = static_cast<std::size_t>(event.y) * static_cast<std::size_t>(size_.width) + event.x;
    pixels_[i] = event.p > 0 ? kOn : kOff;
    times_[i] = static_cast<std::uint32_t>(event.t);
    t_ = event.t;
  }

  /// Forgets all events. This happens between two events, so it does no more than it must.
  void clear() noexcept {
    std::ranges::fill(pixels_, kUntouched);  // the times, four times as much memory, have no meaning from here on
    ++clears_;
  }

  SensorSize sensor_size() const noexcept { return size_; }
  std::span<const std::uint8_t> pixels() const noexcept { return pixels_; }
  /// The low 32 bits of the time of the last event at every pixel [us], row by row; without meaning where a pixel is
  /// untouched.
  std::span<const std::uint32_t> times() const noexcept { return times_; }
  /// Time of the last event in the frame [us].
  Timestamp t() const noexcept { return t_; }
  /// How often `clear` was called.
  std::uint64_t clears() const noexcept { return clears_; }

 private:
  SensorSize size_;
  std::vector<std::uint8_t> pixels_;
  std::vector<std::uint32_t> times_;
  Timestamp t_ = 0;
  std::uint64_t clears_ = 0;
};

}  // namespace evmarker
