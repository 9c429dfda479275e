#pragma once
// The sequential Kalman update: scalar measurements, one after the other.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "evmarker/simd/pack.hpp"
#include "evmarker/update/error_state.hpp"

namespace evmarker {

/// Scalar measurements d = J [pose; b] of an error state: one array for each component.
struct MeasurementRows {
  static constexpr std::size_t kMost = 32;
  static constexpr std::size_t kStates = 6 + kBiases;  ///< length of J: pose and biases; events do not measure velocity
  static constexpr std::size_t kNumbers = kStates + 1;  ///< length of [J; d]
  using Numbers = std::array<double, kMost>;

  alignas(64) std::array<Numbers, kNumbers> row{};  ///< row[k][m]: element k of [J; d] of measurement m
  alignas(64) Numbers weight{};                     ///< inverse variance, up to a factor
};

/// Applies up to four measurements d = J e to an error state e = [x; b] with covariance P, one after the other:
///
///     S = J P J^T + R
///     K = P J^T / S
///     e += K (d - J e)
///     P -= K J P
///
/// P is read and written once for all of them: P J^T and the innovations d - J e of all measurements are computed from
/// the prior. Then each measurement in turn corrects those of the ones after it.
template <std::size_t kCount, std::size_t kBits>
class SequentialUpdate {
 public:
  /// @param first of the measurements
  /// @param information of a measurement of weight 1
  /// @return false, and nothing has changed, if an innovation is not finite, or an S or a posterior variance of pose or
  /// biases is not positive
  [[gnu::always_inline]] static bool apply(const MeasurementRows& rows, std::size_t first, double information,
                                           ErrorCovariance& P, ErrorState& error) noexcept {
    SequentialUpdate update;
    update.compute_from_prior(rows, first, information, P, error);
    update.condition();
    if (!update.valid(P)) return false;
    update.correct(P, error);
    return true;
  }

 private:
  using Column = simd::Pack<12, kBits>;
  // One number per measurement. One or two are loaded singly, as they were stored: a vector load that spans several
  // recent stores would have to wait until these have reached the cache.
  using Each = simd::Pack<kCount, (kCount > 2 ? kBits : 64)>;

  static constexpr std::size_t kPose = 6;                      // elements of the pose in J, the biases follow
  static constexpr std::size_t kD = MeasurementRows::kStates;  // place of d

  // Of the prior: P J^T, the innovations d - J e, J P J^T of every pair of measurements, and R.
  [[gnu::always_inline]] void compute_from_prior(const MeasurementRows& rows, std::size_t first, double information,
                                                 const ErrorCovariance& P, const ErrorState& error) noexcept {
    const auto of_each = [&](std::size_t place) __attribute__((always_inline)) {
      return Each(&rows.row[place][first]);
    };
    innovation_ = of_each(kD);
#pragma GCC unroll 3
    for (std::size_t b = 0; b < kBiases; ++b) {
      innovation_.subtract(error.b[b], of_each(kPose + b));
#pragma GCC unroll 3
      for (std::size_t c = 0; c < kBiases; ++c) PJ_b_[b].add(P.bb[b][c], of_each(kPose + c));
#pragma GCC unroll 8
      for (std::size_t k = 0; k < kPose; ++k) PJ_b_[b].add(P.xb[b].data()[k], of_each(k));
    }
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kPose; ++k) innovation_.subtract(error.x.data()[k], of_each(k));
#pragma GCC unroll 9
    for (std::size_t k = 0; k < MeasurementRows::kStates; ++k) {
      const Column column(k < kPose ? P.xx.data() + 12 * k : P.xb[k - kPose].data());
#pragma GCC unroll 4
      for (std::size_t m = 0; m < kCount; ++m) PJ_[m].add(rows.row[k][first + m], column);
    }
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
#pragma GCC unroll 8
      for (std::size_t k = 0; k < kPose; ++k) JPJ_[m].add(PJ_[m][k], of_each(k));
#pragma GCC unroll 3
      for (std::size_t b = 0; b < kBiases; ++b) JPJ_[m].add(PJ_b_[b][m], of_each(kPose + b));
      S_[m] = 1 / (information * rows.weight[first + m]);  // R; `condition` adds J P J^T
    }
  }

  // Each measurement in turn corrects P J^T and the innovations of those after it. JPJ_, PJ_b_ and innovation_ are
  // scratch: what they hold of a measurement is right at its turn only, and is copied then.
  [[gnu::always_inline]] void condition() noexcept {
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      S_[m] += JPJ_[m][m];
      by_S_[m] = 1 / S_[m];
      innovation_by_S_[m] = by_S_[m] * innovation_[m];
      for (std::size_t b = 0; b < kBiases; ++b) PJ_b_at_turn_[b][m] = PJ_b_[b][m];
      gain_[m] = PJ_[m];
      gain_[m].scale(by_S_[m]);
      Each effect = JPJ_[m];
      effect.scale(by_S_[m]);
#pragma GCC unroll 4
      for (std::size_t later = m + 1; later < kCount; ++later) {
        JPJ_[later].subtract(effect[later], JPJ_[m]);
        PJ_[later].subtract(effect[later], PJ_[m]);
      }
#pragma GCC unroll 3
      for (std::size_t b = 0; b < kBiases; ++b) PJ_b_[b].subtract(PJ_b_at_turn_[b][m], effect);
      const double innovation = innovation_[m];
      innovation_.subtract(innovation, effect);
    }
  }

  // True if S and the posterior variances of pose and biases are positive and the innovations finite. The velocity is
  // not checked.
  [[gnu::always_inline]] bool valid(const ErrorCovariance& P) const noexcept {
    bool positive = true;
    double innovations = 0;
    std::array<double, kBiases> bias;
    for (std::size_t b = 0; b < kBiases; ++b) bias[b] = P.bb[b][b];
    Column reduction;
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      positive = positive && S_[m] > 0;
      reduction.add_product(PJ_[m], gain_[m]);
      for (std::size_t b = 0; b < kBiases; ++b) bias[b] -= by_S_[m] * PJ_b_at_turn_[b][m] * PJ_b_at_turn_[b][m];
      innovations += std::abs(innovation_by_S_[m]);
    }
    double least = bias[0];
#pragma GCC unroll 3
    for (std::size_t b = 1; b < kBiases; ++b) least = std::min(least, bias[b]);
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kPose; ++k) least = std::min(least, P.xx.data()[12 * k + k] - reduction[k]);
    return positive && least > 0 && innovations < std::numeric_limits<double>::infinity();
  }

  [[gnu::always_inline]] void correct(ErrorCovariance& P, ErrorState& error) const noexcept {
    Column x(error.x.data());
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      x.add(innovation_by_S_[m], PJ_[m]);
#pragma GCC unroll 3
      for (std::size_t b = 0; b < kBiases; ++b) {
        error.b[b] += innovation_by_S_[m] * PJ_b_at_turn_[b][m];
#pragma GCC unroll 3
        for (std::size_t c = 0; c < kBiases; ++c) P.bb[b][c] -= by_S_[m] * PJ_b_at_turn_[b][m] * PJ_b_at_turn_[c][m];
      }
    }
    x.store(error.x.data());
#pragma GCC unroll 16
    for (std::size_t k = 0; k < 12 + kBiases; ++k) {
      double* const place = k < 12 ? P.xx.data() + 12 * k : P.xb[k - 12].data();
      Column column(place);
#pragma GCC unroll 4
      for (std::size_t m = 0; m < kCount; ++m) column.subtract(k < 12 ? PJ_[m][k] : PJ_b_at_turn_[k - 12][m], gain_[m]);
      column.store(place);
    }
  }

  std::array<Column, kCount> PJ_;    // P J^T, rows of x
  std::array<Each, kBiases> PJ_b_;   // rows of b, of each measurement
  std::array<Column, kCount> gain_;  // K, rows of x
  Each innovation_;                  // d - J e
  std::array<Each, kCount> JPJ_;     // of every pair of measurements
  std::array<double, kCount> S_, by_S_, innovation_by_S_;
  std::array<std::array<double, kCount>, kBiases> PJ_b_at_turn_;
};

}  // namespace evmarker
