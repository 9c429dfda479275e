#pragma once
// By how much blur widens the edges.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace evmarker {

/// Measures how much wider than on a focused sensor events lie about their edges, all the time: out of focus, or behind
/// a poor lens. Noise, an occluder, fast motion and slow pixels spread them, too, but not always. So blur is the least
/// spread over some hundred pixels of motion, as noise is the least power of a signal that comes and goes ("minimum
/// statistics").
class EdgeBlur {
 public:
  /// Standard deviation [px] of events about the edges of a focused sensor; settings in pixels are for such a one.
  static constexpr double kSharp_px = 2.0 / 3;

  /// Adds the variance of the events about their edges [px^2], while the edges moved by some times their width.
  void add(double spread_px2) noexcept {
    least_px2_ = std::min(least_px2_, spread_px2);
    if (++added_ < window_) return;
    // The first windows are short: a sensor is blurred from its first event on.
    factor_ = std::max(1.0, std::sqrt(std::exchange(least_px2_, kInfinity)) / kSharp_px);
    window_ = std::min(2 * window_, kLongestWindow);
    added_ = 0;
  }

  /// By how much wider than those of a focused sensor the edges are; at least 1, and 1 at first.
  double factor() const noexcept { return factor_; }

 private:
  static constexpr int kFirstWindow = 1, kLongestWindow = 32;  // variances
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  double factor_ = 1;
  double least_px2_ = kInfinity;  // of this window
  int added_ = 0, window_ = kFirstWindow;
};

}  // namespace evmarker
