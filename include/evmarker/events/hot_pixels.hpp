#pragma once
// Finds pixels that go on firing, as broken ones do.
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/hot_lines.hpp"

namespace evmarker {

/// Finds hot pixels by counting some of the events, one in 31, at every pixel.
///
/// An edge that passes makes a pixel fire some 20 times at most, and soon makes those beside it fire as often. A pixel
/// is hot if it fires more than some 370 times in 0.26 s while those 2 px away, to both sides in x or to both sides in
/// y, are as good as silent: it stands alone, or in a line of such pixels, as in a broken column (HotLines finds a
/// whole broken column or row sooner, and all its pixels at once). It stays hot for a second. A flickering lamp makes
/// all pixels of an area fire: these are not hot.
class HotPixels {
 public:
  static constexpr std::size_t kEventsPerUpdate = 1024;  ///< most events between two calls of `update`

  explicit HotPixels(SensorSize size)
      : size_(size),
        counts_(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height)),
        lines_(size, kEventsPerSample) {
    hot_until_.resize(counts_.size());
  }

  /// Takes events: puts samples of them aside.
  void count(std::span<const Event> events) noexcept {
    for (; events.size() >= until_sample_; until_sample_ = kEventsPerSample) {
      put_aside(events[until_sample_ - 1]);
      events = events.subspan(until_sample_);
    }
    until_sample_ -= events.size();
  }

  /// Judges by the samples. To be called after at most kEventsPerUpdate events; `is_hot` changes only here, so
  /// that it does not depend on how many events are counted at once.
  void update() noexcept {
    for (const Event& event : std::span(samples_).first(samples_put_aside_)) add_sample(event);
    samples_put_aside_ = 0;
  }

  /// True if the pixel of an event, which must lie on the sensor, is hot.
  bool is_hot(const Event& event) const noexcept { return any_ && was_found(event); }

 private:
  static constexpr std::size_t kEventsPerSample = 31;  // prime: not in step with a sensor that is read out by rows
  static constexpr unsigned kHot = 12;                 // samples in an epoch
  static constexpr unsigned kSilent = 1;               // most samples of a silent pixel in an epoch
  static constexpr int kBeside = 2;                    // [px]
  static constexpr std::uint32_t kEpochs = 16;         // that the four bits in counts_ tell apart
  static constexpr std::uint32_t kEpochsHot = 4;       // further epochs for which a pixel that was found hot stays so

  // Epochs of 0.26 s.
  static std::uint32_t epoch(Timestamp t) noexcept { return static_cast<std::uint32_t>(t >> 18); }

  std::size_t index(int x, int y) const noexcept {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(size_.width) + static_cast<std::size_t>(x);
  }

  [[gnu::noinline]] bool was_found(const Event& event) const noexcept {
    const std::uint32_t until = hot_until_[index(event.x, event.y)];
    return until != 0 && until - epoch(event.t) <= kEpochsHot;  // unsigned: huge once `until` has passed
  }

  void put_aside(const Event& event) noexcept {
    if (!size_.contains(event.x, event.y)) return;
    if (samples_put_aside_ == samples_.size()) update();
    samples_[samples_put_aside_++] = event;
  }

  void add_sample(const Event& event) noexcept {
    const std::uint32_t now = epoch(event.t);
    const std::size_t pixel = index(event.x, event.y);
    const unsigned samples = samples_in(pixel, now);
    if (samples + 1 < kHot) {
      counts_[pixel] = static_cast<std::uint8_t>(now % kEpochs << 4U | (samples + 1));
    } else if (stands_out(event.x, event.y, now)) {  // the count stays: every further sample is judged
      mark(event.x, event.y, now);
    }
    const HotLines::Found hot = lines_.count(event, now);
    if (hot.column)
      for (int y = 0; y < size_.height; ++y) mark(event.x, y, now);
    if (hot.row)
      for (int x = 0; x < size_.width; ++x) mark(x, event.y, now);
  }

  void mark(int x, int y, std::uint32_t now) noexcept {
    any_ = true;
    hot_until_[index(x, y)] = now + kEpochsHot;
  }

  // Only four bits of the epoch are kept. So a pixel's few samples of four seconds ago may count once more.
  unsigned samples_in(std::size_t pixel, std::uint32_t now) const noexcept {
    return counts_[pixel] >> 4U == now % kEpochs ? counts_[pixel] & 15U : 0;
  }

  bool stands_out(int x, int y, std::uint32_t now) const noexcept {
    const auto silent = [&](int at_x, int at_y) {
      return at_x < 0 || at_y < 0 || at_x >= size_.width || at_y >= size_.height ||
             samples_in(index(at_x, at_y), now) <= kSilent;
    };
    return (silent(x - kBeside, y) && silent(x + kBeside, y)) || (silent(x, y - kBeside) && silent(x, y + kBeside));
  }

  SensorSize size_;
  std::array<Event, kEventsPerUpdate / kEventsPerSample + 1> samples_{};
  std::size_t samples_put_aside_ = 0, until_sample_ = kEventsPerSample;
  std::vector<std::uint8_t> counts_;      // of each pixel: samples in an epoch, and four bits of the epoch
  std::vector<std::uint32_t> hot_until_;  // the last epoch in which a pixel is hot; 0 if it never was
  HotLines lines_;
  bool any_ = false;  // there has been one
};

}  // namespace evmarker
