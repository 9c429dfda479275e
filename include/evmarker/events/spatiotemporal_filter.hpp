#pragma once
// Background-activity filter: an event needs a recent neighbour.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/background_activity.hpp"
#include "evmarker/events/event_stream.hpp"

namespace evmarker {

/// A filter's window that follows the noise of the sensor.
inline constexpr std::chrono::microseconds kAutomaticWindow{0};
/// The window of the paper's filter.
inline constexpr std::chrono::microseconds kPaperWindow{2000};

/// Lets an event through if one of its 8 neighbouring pixels had an event, of either polarity, at most `window` before
/// it (or after it, where recordings step back in time). The pixel itself does not count: a hot pixel supports nobody,
/// least of all itself. The paper's preprocessing, with 2000 us.
///
/// A fixed window is a statement about speed: the neighbours of an edge's pixel fire within the time in which it moves
/// by a pixel. Noise of rate r, in Hz/px, passes with 1 - exp(-8 r window). So the automatic window is as long as lets
/// one noise event in thirteen pass: 0.01 / r, by the background activity that was measured so far, but not more than
/// 50 ms: edges of 20 px/s are let through by then, and memories of an older edge would support any noise in its trail.
/// And not less than 0.5 ms: there are 20 Hz/px of noise, and edges slower than 2000 px/s would only pass by chance.
class SpatiotemporalFilter {
 public:
  /// @param window `kAutomaticWindow`, or fixed
  /// @throws std::invalid_argument if the window is not in [0, 8 minutes]
  explicit SpatiotemporalFilter(SensorSize size, std::chrono::microseconds window = kAutomaticWindow)
      : stride_(static_cast<std::size_t>(size.width) + 2),
        window_(static_cast<std::uint32_t>(window.count())),
        activity_(static_cast<double>(size.width) * size.height) {
    if (size.width < 1 || size.height < 1)
      throw std::invalid_argument("filter: sensor size is " + std::to_string(size.width) + " x " +
                                  std::to_string(size.height));
    if (window.count() < 0 || window > std::chrono::minutes(8))
      throw std::invalid_argument("filter: window is " + std::to_string(window.count()) + " us, not in [0, 8 min]");
    last_.resize(stride_ * (static_cast<std::size_t>(size.height) + 2));
    if (window == kAutomaticWindow) {
      until_sample_ = BackgroundActivity::kEventsAtFirst;
      follow_activity();
    }
  }

  /// True if the event, which must lie on the sensor, has support.
  bool accept(const Event& event) noexcept {
    if (distance(event.t, swept_at_) > kSweepInterval) [[unlikely]]
      sweep(event.t);
    const auto now = static_cast<std::uint32_t>(event.t);
    std::uint32_t* const pixel = &last_[index(event)];
    const auto recent = [&](const std::uint32_t* neighbour) {
      return static_cast<unsigned>(now - *neighbour + window_ <= 2 * window_);  // |now - neighbour| <= window
    };
    // Without branches: all eight, since which of them is recent cannot be predicted.
    const unsigned supported = recent(pixel - stride_ - 1) | recent(pixel - stride_) | recent(pixel - stride_ + 1) |
                               recent(pixel - 1) | recent(pixel + 1) |  //
                               recent(pixel + stride_ - 1) | recent(pixel + stride_) | recent(pixel + stride_ + 1);
    if (--until_sample_ == 0) [[unlikely]]
      sample(event, pixel);
    *pixel = now;
    return supported != 0;
  }

  /// As of the last event.
  std::chrono::microseconds window() const noexcept { return std::chrono::microseconds(window_); }

  /// Has what `accept` will need for the event, which must lie on the sensor, brought into the cache.
  void prefetch(const Event& event) const noexcept {
    const std::uint32_t* const pixel = &last_[index(event)];
    for (const std::uint32_t* const row : {pixel - stride_, pixel, pixel + stride_}) __builtin_prefetch(row);
  }

 private:
  // Times are kept as their low 32 bits. So that a pixel that was silent for 71 minutes does not look recent when they
  // come round, stale times are moved to the far side of the circle well before that. From there they look stale until
  // the next sweep and in it, or all are stale by then, as long as twice the window is less than the interval.
  static constexpr std::uint64_t kSweepInterval = std::uint64_t{1} << 30;
  static constexpr std::uint32_t kFarSide = std::uint32_t{1} << 31;

  static constexpr std::uint64_t distance(Timestamp a, Timestamp b) noexcept {
    const auto ua = static_cast<std::uint64_t>(a), ub = static_cast<std::uint64_t>(b);
    return a > b ? ua - ub : ub - ua;
  }

  std::size_t index(const Event& event) const noexcept { return (event.y + std::size_t{1}) * stride_ + event.x + 1; }

  void sweep(Timestamp t) noexcept {
    const auto now = static_cast<std::uint32_t>(t);
    const bool all_stale = distance(t, swept_at_) > kSweepInterval + window_;  // also before the first event
    for (std::uint32_t& last : last_)
      if (all_stale || now - last + window_ > 2 * window_) last = now + kFarSide;
    swept_at_ = t;
  }

  // How long ago there was an event at this pixel or a neighbour, or how long after, where times step back.
  [[gnu::noinline]] void sample(const Event& event, const std::uint32_t* pixel) noexcept {
    const auto now = static_cast<std::uint32_t>(event.t);
    std::uint32_t age = kFarSide;
    for (const std::uint32_t* const middle : {pixel - stride_, pixel, pixel + stride_})
      for (const std::uint32_t last : {middle[-1], middle[0], middle[1]}) age = std::min({age, now - last, last - now});
    until_sample_ = activity_.add(age, event.t);
    follow_activity();
  }

  void follow_activity() noexcept {
    constexpr double kNoise = 0.01, kLeast_us = 500, kMost_us = 50000;
    window_ = static_cast<std::uint32_t>(std::clamp(1e6 * kNoise / activity_.hz_per_px(), kLeast_us, kMost_us));
  }

  std::size_t stride_;              // a border of one pixel all around never gets an event and needs no test
  std::uint32_t window_;            // [us]
  std::uint64_t until_sample_ = 0;  // events; none is ever due with a fixed window
  BackgroundActivity activity_;
  std::vector<std::uint32_t> last_;
  Timestamp swept_at_ = std::numeric_limits<Timestamp>::min() / 2;
};

}  // namespace evmarker
