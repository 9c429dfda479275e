#pragma once
// How slowly dark pixels answer, from how much farther their events spread than those of bright ones.
#include <algorithm>
#include <cmath>

namespace evmarker {

/// Estimates the time constant of the pixels that an edge leaves in the dark. A pixel answers the faster, the more
/// light it sees, as its photocurrent drives it: it brightens quickly, and darkens slowly. So OFF events of moving
/// edges spread farther behind them than ON events of edges just as fast: their variance is larger by T^2 v^2, T the
/// time constant in the dark and v the speed. All else that spreads events, like focus, dead time and errors of the
/// pose, spreads both alike, or ON events farther, so that T is rather too small: leak events are ON, and the steps of
/// the logarithm of light lie closer on the dark side of an edge.
class DarkResponse {
 public:
  /// Adds an event of a moving edge.
  /// @param on it got brighter
  /// @param bounded_r2 r^2 / (1 + r^2), r its residual [px]: noise far from the edge counts little
  /// @param speed2 of its edge along the normal, squared [px^2/ms^2]
  void add(bool on, double bounded_r2, double speed2) noexcept {
    Sums& sums = on ? on_ : off_;
    // Weighed by what the time constant adds to the variance: noise has its share in the events of slow edges.
    sums.weight += speed2;
    sums.weight2 += speed2 * speed2;
    sums.r2 += speed2 * bounded_r2;
    sums.r4 += speed2 * bounded_r2 * bounded_r2;
  }

  /// Evaluates what has been added.
  /// @param max_distance_px matching distance, beyond which no events are seen
  /// @param of_edges_px4 variance of the mean over all edges of the events' variance, as edges differ
  void estimate(double max_distance_px, double of_edges_px4) noexcept {
    if (!(on_.weight > 0 && off_.weight > 0)) return;
    // Mean of the bounded r^2 over events that lie evenly over the matching distance.
    const double even = 1 - std::atan(max_distance_px) / max_distance_px, speed2 = (on_.speed2() + off_.speed2()) / 2;
    const Estimate on = on_.variance_px2(even), off = off_.variance_px2(even);
    const double T2 = (off.value - on.value) / speed2,
                 deviation = std::sqrt(on.variance + off.variance + 2 * of_edges_px4) / speed2;
    if (!std::isfinite(T2 + deviation)) return;
    least_s_ = 1e-3 * std::sqrt(std::max(0.0, T2 - kSurely * deviation));
    most_s_ = least_s_ > 0 ? 1e-3 * std::sqrt(T2 + kSurely * deviation) : 0;
  }

  /// Lets what has been added fade.
  void fade(double kept) noexcept {
    on_.fade(kept);
    off_.fade(kept);
  }

  /// The time constant [s], less two standard deviations; 0 where none shows.
  double least_s() const noexcept { return least_s_; }
  /// The time constant [s] and two standard deviations more; 0 where none shows.
  double most_s() const noexcept { return most_s_; }

 private:
  struct Estimate {
    double value = 0, variance = 0;
  };
  struct Sums {
    double weight = 0, weight2 = 0, r2 = 0, r4 = 0;

    double speed2() const noexcept { return weight2 / weight; }
    // Variance of the events about their edge, those that are not seen included: events that lie evenly over the
    // matching distance, for which the mean of the bounded r^2 is `even`, could come from anywhere. For normal
    // distributions of a spread up to the matching distance d it is right to 29 % at d = 2 px, 18 % too low at 3 px and
    // 40 % at 5 px.
    Estimate variance_px2(double even) const noexcept {
      const double mean = r2 / weight, seen = std::max(kLeastSeen, 1 - mean / even);
      const double variance_of_mean = (r4 / weight - mean * mean) * weight2 / (weight * weight);
      return {mean / seen, variance_of_mean / (seen * seen * seen * seen)};
    }
    void fade(double kept) noexcept {
      for (double* sum : {&weight, &weight2, &r2, &r4}) *sum *= kept;
    }
  };
  static constexpr double kLeastSeen = 0.05;  // at which all variances look alike
  static constexpr double kSurely = 2;        // standard deviations

  Sums on_, off_;
  double least_s_ = 0, most_s_ = 0;
};

}  // namespace evmarker
