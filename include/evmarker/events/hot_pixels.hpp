#pragma once
// Finds pixels that go on firing, as broken ones do.
#include <cstddef>
#include <cstdint>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Finds hot pixels by counting some of the events, one in 31, at every pixel.
///
/// An edge that passes makes a pixel fire some 20 times at most, and soon makes those beside it fire as often. A pixel
/// is hot if it fires more than some 370 times in 0.26 s while those 2 px away, to both sides in x or to both sides in
/// y, are as good as silent: alone, or in a line, as where a column of the sensor is broken. It is so for a second from
/// then on. A flickering lamp makes all pixels of an area fire, which are not hot.
class HotPixels {
 public:
  explicit HotPixels(SensorSize size)
      : size_(size), samples_(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height)) {
    hot_until_.resize(samples_.size());
  }

  /// Takes an event, which must lie on the sensor. Returns true if its pixel is hot.
  bool add(const Event& event) noexcept {
    if (--until_sample_ == 0) [[unlikely]]
      sample(event);
    return any_ && is_hot(event);
  }

 private:
  static constexpr int kEventsPerSample = 31;     // prime: not in step with a sensor that is read out by rows
  static constexpr unsigned kHot = 12;            // samples in an epoch
  static constexpr unsigned kSilent = 1;          // at most
  static constexpr int kBeside = 2;               // [px]
  static constexpr std::uint32_t kEpochs = 16;    // told apart
  static constexpr std::uint32_t kEpochsHot = 4;  // for which a pixel is hot from then on

  // Epochs of 0.26 s.
  static std::uint32_t epoch(Timestamp t) noexcept { return static_cast<std::uint32_t>(t >> 18); }

  std::size_t index(int x, int y) const noexcept {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(size_.width) + static_cast<std::size_t>(x);
  }

  [[gnu::noinline]] bool is_hot(const Event& event) const noexcept {
    const std::uint32_t until = hot_until_[index(event.x, event.y)];
    return until != 0 && until - epoch(event.t) <= kEpochsHot;
  }

  [[gnu::noinline]] void sample(const Event& event) noexcept {
    until_sample_ = kEventsPerSample;
    const std::uint32_t now = epoch(event.t);
    const std::size_t pixel = index(event.x, event.y);
    const unsigned samples = samples_in(pixel, now);
    if (samples + 1 < kHot) {
      samples_[pixel] = static_cast<std::uint8_t>(now % kEpochs << 4U | (samples + 1));
    } else if (stands_out(event.x, event.y, now)) {
      any_ = true;
      hot_until_[pixel] = now + kEpochsHot;
    }
  }

  // Only four bits of the epoch are kept. So a pixel's few samples of four seconds ago may count once more.
  unsigned samples_in(std::size_t pixel, std::uint32_t now) const noexcept {
    return samples_[pixel] >> 4U == now % kEpochs ? samples_[pixel] & 15U : 0;
  }

  bool stands_out(int x, int y, std::uint32_t now) const noexcept {
    const auto silent = [&](int at_x, int at_y) {
      return at_x < 0 || at_y < 0 || at_x >= size_.width || at_y >= size_.height ||
             samples_in(index(at_x, at_y), now) <= kSilent;
    };
    return (silent(x - kBeside, y) && silent(x + kBeside, y)) || (silent(x, y - kBeside) && silent(x, y + kBeside));
  }

  SensorSize size_;
  std::vector<std::uint8_t> samples_;     // of each pixel: how many in an epoch, and four bits of the epoch
  std::vector<std::uint32_t> hot_until_;  // the last epoch in which a pixel is hot; 0 if it never was
  int until_sample_ = kEventsPerSample;
  bool any_ = false;  // there has been one
};

}  // namespace evmarker
