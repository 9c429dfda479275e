#pragma once
// How slowly dark pixels answer, from how much farther their events spread than those of bright ones.
#include <algorithm>
#include <cmath>

namespace evmarker {

/// Estimates the time constant of the pixels that an edge leaves in the dark. A pixel answers the faster, the more
/// light it sees, as its photocurrent drives it: it brightens quickly, and darkens slowly. So OFF events of moving
/// edges spread farther behind them than ON events of edges just as fast: their variance is larger by T^2 v^2, T the
/// time constant in the dark and v the speed. All else that spreads events, like focus, dead time and errors of the
/// pose, spreads both alike; where it does not, as with leak events, which are ON, or with the steps of the logarithm
/// of light, which lie closer on the dark side of an edge, ON events spread farther.
class DarkResponse {
 public:
  /// Adds an event of a moving edge.
  /// @param on it got brighter
  /// @param spread a bounded function of the squared residual [px^2]
  /// @param growth by how much the mean of `spread` grows with the variance of the residuals
  /// @param speed2 of its edge along the normal, squared [px^2/ms^2]
  void add(bool on, double spread, double growth, double speed2) noexcept {
    Sums& sums = on ? on_ : off_;
    // Weighed by what the time constant adds to the variance: noise has its share in the events of slow edges.
    sums.weight += speed2;
    sums.weight2 += speed2 * speed2;
    sums.spread += speed2 * spread;
    sums.spread2 += speed2 * spread * spread;
    sums.growth += speed2 * growth;
  }

  /// Evaluates what has been added.
  /// @param of_edges_px2 variance of what edges differ in for other reasons, of all edges together [px^4]
  void estimate(double of_edges_px4) noexcept {
    const double growth = on_.growth_mean() + off_.growth_mean(), speed2 = on_.speed2_mean() + off_.speed2_mean();
    if (!(on_.weight > 0 && off_.weight > 0 && growth > 0)) return;
    const double by = 4 / (growth * speed2);  // from the difference of the spreads to T^2
    const double T2 = by * (off_.spread_mean() - on_.spread_mean());
    const double deviation = std::sqrt(by * by * (on_.variance_of_mean() + off_.variance_of_mean()) +
                                       4 / (speed2 * speed2) * 2 * of_edges_px4);
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
  struct Sums {
    double weight = 0, weight2 = 0, spread = 0, spread2 = 0, growth = 0;

    double spread_mean() const noexcept { return spread / weight; }
    double growth_mean() const noexcept { return growth / weight; }
    double speed2_mean() const noexcept { return weight2 / weight; }
    double variance_of_mean() const noexcept {
      return (spread2 / weight - spread_mean() * spread_mean()) * weight2 / (weight * weight);
    }
    void fade(double kept) noexcept {
      for (double* sum : {&weight, &weight2, &spread, &spread2, &growth}) *sum *= kept;
    }
  };
  static constexpr double kSurely = 2;  // standard deviations

  Sums on_, off_;
  double least_s_ = 0, most_s_ = 0;
};

}  // namespace evmarker
