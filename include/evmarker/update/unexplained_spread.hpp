#pragma once
// How much farther events lie from their edges than focus and response time explain.
#include <algorithm>

namespace evmarker {

/// The variance of events about their edges that nothing explains: of a sensor whose pixels answer so slowly, or are
/// dead for so long, that most events of a fast edge come when it is far ahead. Events beyond the matching distance are
/// not seen, so that the variance of all is more than that of the matched ones: a normal distribution cut off at the
/// matching distance g has the variance r g^2, r < 1/3, and without the cut about r (1 - 1.7 r) / (1 - 3 r) g^2.
class UnexplainedSpread {
 public:
  /// @param spread_px2 mean squared residual of matched events [px^2]
  /// @param max_distance_px the matching distance
  /// @param smear_px their standard deviation by the response time that is known [px]
  /// @param blur by how much wider than those of a focused sensor edges are, see EdgeBlur
  void measure(double spread_px2, double max_distance_px, double smear_px, double blur = 1) noexcept {
    constexpr double kMostFilled = 0.33;  // less than 1/3, at which all variances look alike
    filled_ = std::min(spread_px2 / (max_distance_px * max_distance_px), kMostFilled);
    const double of_all_px2 = spread_px2 * (1 - 1.7 * filled_) / (1 - 3 * filled_);
    px2_ = std::max(0.0, of_all_px2 - kSharp_px2 * (blur * blur) - smear_px * smear_px);
  }

  /// True if events with such a spread lie nearly evenly over the matching distance: the edges could be anywhere in it.
  static bool fills(double spread_px2, double max_distance_px) noexcept {
    return spread_px2 > kEven * (max_distance_px * max_distance_px);
  }

  /// The variance [px^2]; 0 as long as nothing has been measured.
  double px2() const noexcept { return px2_; }
  /// See `fills`.
  bool fills_distance() const noexcept { return filled_ > kEven; }

 private:
  static constexpr double kSharp_px2 =
      0.64;                              // of a focused sensor whose pixels answer at once: 0.65 to 0.8 px, squared
  static constexpr double kEven = 0.27;  // of 1/3

  double px2_ = 0, filled_ = 0;
};

}  // namespace evmarker
