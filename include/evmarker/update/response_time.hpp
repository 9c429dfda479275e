#pragma once
// The sensor's response time, from the growth of the events' spread with the speed of their edges.
#include <algorithm>
#include <array>
#include <cmath>

namespace evmarker {

/// Estimates by how much the events of a moving edge are late. A pixel follows the light like a low-pass of first
/// order, whose time constant grows in the dark: its response has the standard deviation T and is late by T. So events
/// lie behind an edge of speed v by T v, which motion alone cannot tell from another pose, and spread by T v more,
/// which shows: their variance grows by T^2 v^2. Here it is regressed on 1, v and v^2 (noise of slow edges takes the
/// linear term), by least squares that fade.
class ResponseTime {
 public:
  /// Adds an event. It need not be every one; a sample whose events do not follow each other at once errs more
  /// independently.
  /// @param residual_px of the event from its edge
  /// @param px_per_s speed of the edge along its normal
  void add(double residual_px, double px_per_s) noexcept {
    const double v = 1e-3 * std::abs(px_per_s), r2 = residual_px * residual_px;
    // A bounded function of the residual in place of its square, so that noise far from the edge counts little.
    const double by = 1 / (1 + r2), spread = r2 * by;
    sums_[0] += 1;
    sums_[1] += v;
    sums_[2] += v * v;
    sums_[3] += v * v * v;
    sums_[4] += v * v * v * v;
    sums_[5] += spread;
    sums_[6] += spread * v;
    sums_[7] += spread * v * v;
    sums_[8] += spread * spread;
    sums_[9] += (1 - 3 * r2) * by * by * by;  // half its second derivative: how it grows with the variance
  }

  /// Evaluates what has been added, and lets it fade.
  void evaluate() noexcept {
    const auto& [n, v, v2, v3, v4, y, yv, yv2, yy, growth] = sums_;
    if (!std::isfinite(v4 * yv2)) sums_ = {};
    if (!(n > 0 && growth > 0)) return;
    const double by = n / growth;  // from the slope of `spread` to that of the variance
    // The normal equations, without the mean and then without v.
    const double S11 = v2 - v * v / n, S12 = v3 - v * v2 / n, S22 = v4 - v2 * v2 / n;
    const double S1y = yv - v * y / n, S2y = yv2 - v2 * y / n, variance = (yy - y * y / n) / n;
    const double linear = S11 > 0 ? S12 / S11 : 0;
    const double S22_rest = S22 - linear * S12, S2y_rest = S2y - linear * S1y;
    // The slope by S2y_rest / S22_rest, with an assumption about it that counts as much as its deviation says.
    const double assumed = variance * by * by / (kUsual_ms2 * kUsual_ms2);
    const double variance_ms2 = by * S2y_rest / (std::max(0.0, S22_rest) + assumed);
    if (std::isfinite(variance_ms2)) variance_s2_ = 1e-6 * std::max(0.0, variance_ms2);
    for (double& sum : sums_) sum *= kKept;
  }

  /// T squared [s^2]; 0 where the events show none, and drawn toward it until enough motion has been seen.
  double variance_s2() const noexcept { return variance_s2_; }

 private:
  static constexpr double kKept = 0.97;      // of the sums, from one evaluation to the next
  static constexpr double kUsual_ms2 = 0.1;  // standard deviation of T^2 where nothing is known [ms^2]

  std::array<double, 10> sums_{};  // of n, v, v^2, v^3, v^4 [px/ms], spread, spread v, spread v^2, spread^2, growth
  double variance_s2_ = 0;
};

}  // namespace evmarker
