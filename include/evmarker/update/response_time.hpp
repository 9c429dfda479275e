#pragma once
// By how much a sensor's events are late, from how far they spread about moving edges.
#include <algorithm>
#include <array>
#include <cmath>

#include "evmarker/update/dark_response.hpp"

namespace evmarker {

/// Estimates by how much the events of a moving edge are late. A pixel follows the light like a low-pass of first
/// order, whose time constant grows in the dark: its response has the standard deviation T and is late by T. So events
/// lie behind an edge of speed v by T v, which motion alone cannot tell from another pose, and spread by T v more,
/// which shows in two ways. First, their variance grows by T^2 v^2. Here it is regressed on 1, 1 / (v + v0) and v^2 by
/// fading least squares. The second term is noise, which lies anywhere: of the events at an edge of speed v, it is the
/// share v0 / (v + v0). Second, OFF events spread farther than ON events, see DarkResponse.
class ResponseTime {
 public:
  /// @param max_distance_px within which distance of an edge events are matched
  explicit ResponseTime(double max_distance_px = 2) noexcept : max_distance_px_(max_distance_px) {}
  void set_max_distance_px(double distance_px) noexcept { max_distance_px_ = distance_px; }

  /// Adds an event. A sample is enough: events that do not directly follow each other err more independently.
  /// @param residual_px of the event from its edge
  /// @param px_per_s speed of the edge along its normal
  /// @param polarity 1 ON, -1 OFF, 0 unknown, or not what the motion makes
  void add(double residual_px, double px_per_s, double polarity = 0) noexcept {
    const double v = 1e-3 * std::abs(px_per_s), u = 1 / (v + kV0_px_ms), v2 = v * v, r2 = residual_px * residual_px;
    // A bounded function of the residual in place of its square, so that noise far from the edge counts little.
    const double by = 1 / (1 + r2), spread = r2 * by;
    sums_[0] += 1;
    sums_[1] += u;
    sums_[2] += u * u;
    sums_[3] += v2;
    sums_[4] += v2 * u;
    sums_[5] += v2 * v2;
    sums_[6] += spread;
    sums_[7] += spread * u;
    sums_[8] += spread * v2;
    sums_[9] += spread * spread;
    // Half the second derivative of `spread` by the residual. Its mean is that of how `spread` grows with the variance:
    // d E[f] / d(variance) = E[f''] / 2, where the variance grows by independent normal errors.
    sums_[10] += (1 - 3 * r2) * by * by * by;
    if (polarity != 0) dark_.add(polarity > 0, spread, v2);
    if (sums_[0] >= next_estimate_) [[unlikely]] {
      next_estimate_ *= 2;
      estimate();
    }
  }

  /// Evaluates what has been added, and lets it fade.
  void evaluate() noexcept {
    estimate();
    for (double& sum : sums_) sum *= kKept;
    dark_.fade(kKept);
    evaluations_ = kKept * evaluations_ + 1;
  }

  /// Least delay of the events that their spread shows [s]; 0 where it shows none.
  double delay_s() const noexcept { return delay_.s; }
  /// Variance of the true delay about it [s^2].
  double delay_variance_s2() const noexcept { return delay_.variance_s2; }

 private:
  struct Delay {
    double s = 0, variance_s2 = 0;  // least delay, and variance of the true one about it
  };

  static constexpr double kKept = 0.97;       // of the sums, from one evaluation to the next
  static constexpr double kUsual_ms2 = 0.1;   // standard deviation of T^2 where nothing is known [ms^2]
  static constexpr double kOfEdge_px2 = 0.1;  // deviation of the events' variance from edge to edge at one speed
  static constexpr double kEdges = 4;         // that err independently between two evaluations
  static constexpr double kSurely = 5;        // standard deviations from which on the data overrule the prior
  static constexpr double kV0_px_ms = 0.03;   // v0 above: of an edge that makes as many events as 20 Hz/px of noise
  static constexpr double kDeadTimeSpread_ms =
      0.2;  // of a passage whose events are 0.05 ms of dead time apart: no delay
  static constexpr double square(double x) noexcept { return x * x; }

  // Not inlined: it is rare.
  [[gnu::noinline]] void estimate() noexcept {
    if (const double speed4 = sums_[5], spread_speed2 = sums_[8]; !std::isfinite(speed4 * spread_speed2)) {
      sums_ = {};
      dark_ = {};
    }
    dark_.estimate(max_distance_px_, of_edges_px4());
    const Delay of_dark = delay_by_dark(), of_speed = delay_by_speed();
    delay_ = {std::max(of_speed.s, of_dark.s), of_speed.variance_s2 + of_dark.variance_s2};
  }

  // Variance of the mean of the edges' variances, as these differ: of kEdges for every evaluation, of one at first.
  double of_edges_px4() const noexcept { return square(kOfEdge_px2) / (kEdges * (evaluations_ + 0.25)); }

  // Pixels that brighten answer nearly at once, those that darken are late by the dark's time constant. The mean of
  // both polarities is late by half of it, and by less under robust weights, which count the latest events less; where
  // there is so little light that pixels that brighten are late, too, by up to the time constant more.
  Delay delay_by_dark() const noexcept {
    constexpr double kMean = 0.35, kDeviation = 0.5;
    return {kMean * dark_.least_s(), square(kDeviation * dark_.most_s())};
  }

  // T^2 less two standard deviations and the spread of a usual dead time.
  Delay delay_by_speed() const noexcept {
    const auto& [n, u, uu, q, qu, qq, y, yu, yq, yy, slope] = sums_;  // q = v^2
    if (!(n > 0 && slope > 0)) return {};
    const double by = n / slope;  // from how `spread` grows to how the variance does
    // The normal equations: sums about the means; below, what u explains is taken out of them as well.
    const double Suu = uu - u * u / n, Squ = qu - q * u / n, Sqq = qq - q * q / n;
    const double Syu = yu - y * u / n, Syq = yq - y * q / n, variance = (yy - y * y / n) / n;
    // u is used only if its coefficient is positive, as noise has a larger share at slow edges. Else a spread that
    // stops growing with the speed, cut off by the matching distance, would look like negative noise.
    const bool noisy = Suu > 0 && Syu * Sqq > Syq * Squ;
    const double q_by_u = noisy ? Squ / Suu : 0;
    const double Sqq_rest = std::max(0.0, Sqq - q_by_u * Squ), Syq_rest = Syq - q_by_u * Syu;
    // The slope Syq_rest / Sqq_rest with a prior of mean 0 and deviation kUsual_ms2. Where the data surely contradict
    // that, as in dim light, the prior's deviation grows to a third of the slope, which then hardly shrinks.
    const double sample_variance = variance * by * by;
    const double raw_slope = Sqq_rest > 0 ? std::max(0.0, by * Syq_rest / Sqq_rest) : 0;
    const double sure_slope2 =
        Sqq_rest > 0 ? square(raw_slope) - square(kSurely) * (sample_variance + n * of_edges_px4()) / Sqq_rest : 0;
    const double prior = sample_variance / std::max(square(kUsual_ms2), sure_slope2 / 9);  // as so much of Sqq
    const double T2 = std::max(0.0, by * Syq_rest / (Sqq_rest + prior)),
                 sigma = std::sqrt(sample_variance / (Sqq_rest + prior));
    if (!std::isfinite(T2 + sigma)) return {};
    const double late_s = 1e-3 * std::sqrt(std::max(0.0, T2 - 2 * sigma - square(kDeadTimeSpread_ms)));
    // It is not known how much of the rest of T is a delay, and `late_s` itself only to a half: a pixel's dead time
    // spreads its events, too.
    return {late_s, square(1e-3 * std::sqrt(T2) - late_s) + square(0.5 * late_s)};
  }

  double max_distance_px_;         // of matched events
  double evaluations_ = 0;         // as they fade
  double next_estimate_ = 1024;    // samples at which the next early estimate is made
  std::array<double, 11> sums_{};  // of n, u, u^2, v^2 [px^2/ms^2], v^2 u, v^4, spread, its products, and its growth
  DarkResponse dark_;
  Delay delay_;
};

}  // namespace evmarker
