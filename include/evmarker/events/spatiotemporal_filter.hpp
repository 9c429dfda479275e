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
#include "evmarker/simd/pack.hpp"

namespace evmarker {

/// Given as the window, makes the filter choose its window by the measured background activity.
inline constexpr std::chrono::microseconds kAutomaticWindow{0};
/// The window of the paper's filter.
inline constexpr std::chrono::microseconds kPaperWindow{2000};

/// Accepts an event if one of its 8 neighbouring pixels had an event, of either polarity, at most `window` before
/// it (or after it, where recordings step back in time). The pixel's own events do not count, so that a hot pixel does
/// not support itself. With a window of 2000 us this is the paper's preprocessing. When time jumps by more than 18 min,
/// ahead or back, all earlier events are forgotten. A single event with a wrong time would do that, too; trackers
/// discard such events before the filter, see TimeGuard.
///
/// The window implies a least speed: an edge reaches the next pixel of its path after 1 / speed, and where that is
/// longer than the window, its events may be rejected.
/// The automatic window is 0.01 / r, where r [Hz/px] is the background activity measured so far. It accepts a share of
/// 1 - exp(-8 r window) = 1 - exp(-0.08) of the noise, one event in thirteen. It is at most 50 ms, enough for edges
/// from 20 px/s on; with a longer one, the events of an edge that passed long ago would support noise. It is at least
/// 0.5 ms, enough for edges from 2000 px/s on; that is reached at 20 Hz/px of noise.
class SpatiotemporalFilter {
 public:
  /// @param window `kAutomaticWindow`, or a fixed one of up to 8 minutes
  /// @throws std::invalid_argument if the window is out of range or a side of the sensor is not positive
  explicit SpatiotemporalFilter(SensorSize size, std::chrono::microseconds window = kAutomaticWindow)
      : stride_(static_cast<std::size_t>(size.width) + 2),
        window_(static_cast<std::uint32_t>(window.count())),
        activity_(static_cast<double>(size.width) * size.height) {
    if (size.width < 1 || size.height < 1)
      throw std::invalid_argument("filter: sensor size is " + std::to_string(size.width) + " x " +
                                  std::to_string(size.height));
    if (window.count() < 0 || window > std::chrono::minutes(8))
      throw std::invalid_argument("filter: window is " + std::to_string(window.count()) + " us, not in [0, 8 min]");
    last_.resize(stride_ * (static_cast<std::size_t>(size.height) + 2) + 1);  // four are read at once, see accept
    if (window == kAutomaticWindow) {
      until_sample_ = BackgroundActivity::kEventsAtFirst;
      set_window_from_activity();
    }
  }

  /// Takes an event, which must lie on the sensor. Returns true if a neighbour supports it.
  bool accept(const Event& event) noexcept {
    if (distance_us(event.t, swept_at_) > kSweepInterval) [[unlikely]]
      sweep(event.t);
    const auto now = static_cast<std::uint32_t>(event.t);
    std::uint32_t* const pixel = &last_[index(event)];
    // All eight without a branch: the processor could not predict which of them are recent. Four pixels of each row at
    // once, of which the last one, and of the middle row the pixel itself, do not count.
    const auto too_old = [&](const std::uint32_t* middle) {
      return now - simd::quad_at(middle - 1) + window_ > 2 * window_;  // |now - last| > window
    };
    const auto columns_too_old =
        too_old(pixel - stride_) & (too_old(pixel) | simd::Quad{0, ~0u, 0, 0}) & too_old(pixel + stride_);
    const bool supported = (columns_too_old[0] & columns_too_old[1] & columns_too_old[2]) == 0;
    if (--until_sample_ == 0) [[unlikely]]
      sample_background_activity(event, pixel);
    *pixel = now;
    return supported;
  }

  /// The present window [us]; the automatic one changes with the background activity.
  std::chrono::microseconds window() const noexcept { return std::chrono::microseconds(window_); }
  /// The background activity measured so far [Hz/px]; 1 until the first estimate. With a fixed window nothing is
  /// measured, and it stays 1.
  double background_hz_per_px() const noexcept { return activity_.hz_per_px(); }

  /// Prefetches the memory that `accept` will read for this event, which must lie on the sensor.
  void prefetch(const Event& event) const noexcept {
    const std::uint32_t* const pixel = &last_[index(event)];
    for (const std::uint32_t* const row : {pixel - stride_, pixel, pixel + stride_}) __builtin_prefetch(row);
  }

 private:
  // Only the low 32 bits of a time are kept; they repeat after 71 minutes. So that old times never seem recent again, a
  // sweep sets all times outside of the window to 2^31 us (36 min) from now, whenever time has moved by more than
  // kSweepInterval (18 min) since the last sweep. If it has moved by more than kSweepInterval + window since then, no
  // stored time can be within the window, and all are set. Otherwise a time that the last sweep set to 2^31 us is now
  // at least 2^31 - (2^30 + window) us away. That must be more than the window, so the window must be shorter than 2^29
  // us, 8.9 min: hence the limit of 8 min.
  static constexpr std::uint64_t kSweepInterval = std::uint64_t{1} << 30;  // [us]
  static constexpr std::uint32_t kFarthest_us = std::uint32_t{1} << 31;    // longest distance of two times of 32 bits

  static constexpr std::uint64_t distance_us(Timestamp a, Timestamp b) noexcept {
    const auto ua = static_cast<std::uint64_t>(a), ub = static_cast<std::uint64_t>(b);
    return a > b ? ua - ub : ub - ua;
  }

  std::size_t index(const Event& event) const noexcept { return (event.y + std::size_t{1}) * stride_ + event.x + 1; }

  // Keeps times that are older than the window from seeming recent later, see above.
  void sweep(Timestamp t) noexcept {
    const auto now = static_cast<std::uint32_t>(t);
    const bool all_stale = distance_us(t, swept_at_) > kSweepInterval + window_;  // also before the first event
    for (std::uint32_t& last : last_)
      if (all_stale || now - last + window_ > 2 * window_) last = now + kFarthest_us;
    swept_at_ = t;
  }

  // Adds this event's age, the time since the last event in its 3 x 3 pixels, to the estimator of background activity,
  // and adapts the window. The age is an absolute value, as times may step back.
  [[gnu::noinline]] void sample_background_activity(const Event& event, const std::uint32_t* pixel) noexcept {
    const auto now = static_cast<std::uint32_t>(event.t);
    std::uint32_t age = kFarthest_us;
    for (const std::uint32_t* const middle : {pixel - stride_, pixel, pixel + stride_})
      for (const std::uint32_t last : {middle[-1], middle[0], middle[1]}) age = std::min({age, now - last, last - now});
    until_sample_ = activity_.add(age, event.t);
    set_window_from_activity();
  }

  void set_window_from_activity() noexcept {
    constexpr double kNoiseEventsPerWindow = 0.01, kLeast_us = 500, kMost_us = 50000;
    window_ = static_cast<std::uint32_t>(
        std::clamp(1e6 * kNoiseEventsPerWindow / activity_.hz_per_px(), kLeast_us, kMost_us));
  }

  std::size_t stride_;    // sensor width + 2: a border without events saves the neighbours' bounds checks
  std::uint32_t window_;  // [us]
  // Events until the next sample; with a fixed window it wraps from 0 to 2^64 - 1, and no sample is ever due.
  std::uint64_t until_sample_ = 0;
  BackgroundActivity activity_;
  std::vector<std::uint32_t> last_;  // low 32 bits of the time of each pixel's last event [us]
  Timestamp swept_at_ = std::numeric_limits<Timestamp>::min() / 2;  // far from every time that may come first
};

}  // namespace evmarker
