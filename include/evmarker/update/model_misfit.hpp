#pragma once
// What events do that the measurement model does not say, and how far that may shift the pose.
#include <algorithm>

#include "evmarker/update/unexplained_spread.hpp"

namespace evmarker {

/// Variances of the pose by what the model does not say of the events. A filter takes its model for right: its own
/// covariance shrinks with every event, while the events of an edge all err alike.
class ModelMisfit {
 public:
  /// Standard deviation of the trail that an edge's width tells, relative to it.
  static constexpr double kTrailError = 0.25;

  /// Measures how far events lie from their edges, see UnexplainedSpread.
  void measure_spread(double spread_px2, double max_distance_px, double smear_px, double blur = 1) noexcept {
    spread_.measure(spread_px2, max_distance_px, smear_px, blur);
  }

  /// Compares the two estimates of the trail: its variance is that of the second, and the square of their difference.
  /// Until then, the filter's own covariance has the error of the trail.
  /// @param by_filter_px as the filter corrects it, on average over the edges
  /// @param by_width_px as the width of the edges tells it
  void compare_trails(double by_filter_px, double by_width_px) noexcept {
    const double of_width_px2 = squared(kTrailError * by_width_px),
                 difference_px2 = squared(by_filter_px - by_width_px);
    trail_variance_px2_ = of_width_px2 + difference_px2;
    unexplained_trail_px2_ = std::max(0.0, difference_px2 - of_width_px2);
  }

  /// Variance of the edges' places along their motion [px^2].
  double along_motion_px2() const noexcept { return spread_.px2() + trail_variance_px2_; }
  /// Variance of the mean place of one edge's events [px^2]: by the spread, and by what is more between the two trails
  /// than the second's error.
  double of_edge_px2() const noexcept { return kOfEdge * (spread_.px2() + unexplained_trail_px2_); }
  /// True while events lie nearly evenly over the matching distance: the pose cannot be trusted.
  bool events_fill_distance() const noexcept { return spread_.fills_distance(); }

 private:
  static constexpr double kOfEdge = 0.25;  // share of the variance that the events of an edge have in common
  static constexpr double squared(double x) noexcept { return x * x; }

  UnexplainedSpread spread_;
  double trail_variance_px2_ = 0, unexplained_trail_px2_ = 0;
};

}  // namespace evmarker
