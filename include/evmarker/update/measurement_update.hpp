#pragma once
// What a few measurements, taken one after the other, make of an error state and its covariance.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "evmarker/simd/pack.hpp"
#include "evmarker/update/error_state.hpp"

namespace evmarker {

/// Scalar measurements d = J [pose; b] of an error state, number by number.
struct MeasurementRows {
  static constexpr std::size_t kMost = 32;
  static constexpr std::size_t kStates = 6 + kBiases, kNumbers = kStates + 1;  ///< of J, and with d
  using Numbers = std::array<double, kMost>;

  alignas(64) std::array<Numbers, kNumbers> row{};  ///< [J; d]
  alignas(64) Numbers weight{};                     ///< inverse variance, up to a factor
};

/// Takes up to four measurements as the textbook does it one after the other, but they wait for each other only where
/// they must, and the covariance is read and written once.
template <std::size_t kCount, std::size_t kBits>
class MeasurementUpdate {
 public:
  /// @param first of the measurements
  /// @param information of a measurement of weight 1
  /// @return false, and nothing has changed, if a number is not finite or the covariance not positive definite
  [[gnu::always_inline]] static bool take(const MeasurementRows& rows, std::size_t first, double information,
                                          ErrorCovariance& P, ErrorState& error) noexcept {
    MeasurementUpdate update;
    update.expect(rows, first, information, P, error);
    update.separate();
    if (!update.good(P)) return false;
    update.apply(P, error);
    return true;
  }

 private:
  using Column = Pack<12, kBits>;
  // A number of each measurement. One or two are read as they were written: read as a whole vector, they would have to
  // wait until they have left for memory.
  using Each = Pack<kCount, (kCount > 2 ? kBits : 64)>;

  static constexpr std::size_t kPose = 6, kMeasured = MeasurementRows::kStates;  // places in a row

  // P J^T, the innovations d - J e, and what they are expected to vary by: S = J P J^T + R.
  [[gnu::always_inline]] void expect(const MeasurementRows& rows, std::size_t first, double information,
                                     const ErrorCovariance& P, const ErrorState& error) noexcept {
    const auto of_each = [&](std::size_t place) __attribute__((always_inline)) {
      return Each(&rows.row[place][first]);
    };
    innovation_ = of_each(kMeasured);
#pragma GCC unroll 2
    for (std::size_t b = 0; b < kBiases; ++b) {
      innovation_.subtract(error.b[b], of_each(kPose + b));
#pragma GCC unroll 2
      for (std::size_t c = 0; c < kBiases; ++c) PJ_b_[b].add(P.bb[b][c], of_each(kPose + c));
#pragma GCC unroll 8
      for (std::size_t k = 0; k < kPose; ++k) PJ_b_[b].add(P.xb[b].data()[k], of_each(k));
    }
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kPose; ++k) innovation_.subtract(error.x.data()[k], of_each(k));
#pragma GCC unroll 8
    for (std::size_t k = 0; k < MeasurementRows::kStates; ++k) {
      const Column column(k < kPose ? P.xx.data() + 12 * k : P.xb[k - kPose].data());
#pragma GCC unroll 4
      for (std::size_t m = 0; m < kCount; ++m) PJ_[m].add(rows.row[k][first + m], column);
    }
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
#pragma GCC unroll 8
      for (std::size_t k = 0; k < kPose; ++k) S_[m].add(PJ_[m][k], of_each(k));
#pragma GCC unroll 2
      for (std::size_t b = 0; b < kBiases; ++b) S_[m].add(PJ_b_[b][m], of_each(kPose + b));
      variance_[m] = 1 / (information * rows.weight[first + m]);
    }
  }

  // From what each tells is subtracted what those before it have told, so that they are independent.
  [[gnu::always_inline]] void separate() noexcept {
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      variance_[m] += S_[m][m];
      inverse_[m] = 1 / variance_[m];
      told_[m] = inverse_[m] * innovation_[m];
      for (std::size_t b = 0; b < kBiases; ++b) b_[b][m] = PJ_b_[b][m];
      gain_[m] = PJ_[m];
      gain_[m].scale(inverse_[m]);
      Each shared = S_[m];
      shared.scale(inverse_[m]);
#pragma GCC unroll 4
      for (std::size_t later = m + 1; later < kCount; ++later) {
        S_[later].subtract(shared[later], S_[m]);
        PJ_[later].subtract(shared[later], PJ_[m]);
      }
#pragma GCC unroll 2
      for (std::size_t b = 0; b < kBiases; ++b) PJ_b_[b].subtract(b_[b][m], shared);
      const double innovation = innovation_[m];
      innovation_.subtract(innovation, shared);
    }
  }

  // Whether all variances are positive, and stay so.
  [[gnu::always_inline]] bool good(const ErrorCovariance& P) const noexcept {
    bool positive = true;
    double told = 0;
    std::array<double, kBiases> bias;
    for (std::size_t b = 0; b < kBiases; ++b) bias[b] = P.bb[b][b];
    Column less;
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      positive = positive && variance_[m] > 0;
      less.add_product(PJ_[m], gain_[m]);
      for (std::size_t b = 0; b < kBiases; ++b) bias[b] -= inverse_[m] * b_[b][m] * b_[b][m];
      told += std::abs(told_[m]);
    }
    double least = std::min(bias[0], bias[1]);
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kPose; ++k) least = std::min(least, P.xx.data()[12 * k + k] - less[k]);
    return positive && least > 0 && told < std::numeric_limits<double>::infinity();
  }

  [[gnu::always_inline]] void apply(ErrorCovariance& P, ErrorState& error) const noexcept {
    Column x(error.x.data());
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      x.add(told_[m], PJ_[m]);
#pragma GCC unroll 2
      for (std::size_t b = 0; b < kBiases; ++b) {
        error.b[b] += told_[m] * b_[b][m];
#pragma GCC unroll 2
        for (std::size_t c = 0; c < kBiases; ++c) P.bb[b][c] -= inverse_[m] * b_[b][m] * b_[c][m];
      }
    }
    x.store(error.x.data());
#pragma GCC unroll 16
    for (std::size_t k = 0; k < 12 + kBiases; ++k) {
      double* const place = k < 12 ? P.xx.data() + 12 * k : P.xb[k - 12].data();
      Column column(place);
#pragma GCC unroll 4
      for (std::size_t m = 0; m < kCount; ++m) column.subtract(k < 12 ? PJ_[m][k] : b_[k - 12][m], gain_[m]);
      column.store(place);
    }
  }

  std::array<Column, kCount> PJ_;    // P J^T, of x
  std::array<Column, kCount> gain_;  // the same by the variance
  std::array<Each, kBiases> PJ_b_;   // and of b
  Each innovation_;
  std::array<Each, kCount> S_;
  std::array<double, kCount> variance_, inverse_, told_;
  std::array<std::array<double, kCount>, kBiases> b_;
};

}  // namespace evmarker
