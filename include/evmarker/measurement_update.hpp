#pragma once
// Floor 2. What a few measurements, taken one after the other, make of an error state and its covariance.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>

#include "evmarker/error_state.hpp"
#include "evmarker/pack.hpp"

namespace evmarker {

/// Scalar measurements d = J [pose; o] of an error state, number by number.
struct MeasurementRows {
  static constexpr std::size_t kMost = 32;
  using Numbers = std::array<double, kMost>;

  alignas(64) std::array<Numbers, 8> row{};  ///< [J; d]
  alignas(64) Numbers weight{};              ///< inverse variance, up to a factor
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

  static constexpr std::size_t kPose = 6, kOffset = 6, kMeasured = 7;  // places in a row

  // P J^T, the innovations d - J e, and what they are expected to vary by: S = J P J^T + R.
  [[gnu::always_inline]] void expect(const MeasurementRows& rows, std::size_t first, double information,
                                     const ErrorCovariance& P, const ErrorState& error) noexcept {
    const auto of_each = [&](std::size_t place) __attribute__((always_inline)) {
      return Each(&rows.row[place][first]);
    };
    innovation_ = of_each(kMeasured);
    innovation_.subtract(error.o, of_each(kOffset));
    PJ_o_.add(P.oo, of_each(kOffset));
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kPose; ++k) {
      innovation_.subtract(error.x.data()[k], of_each(k));
      PJ_o_.add(P.xo.data()[k], of_each(k));
    }
#pragma GCC unroll 8
    for (std::size_t k = 0; k <= kPose; ++k) {
      const Column column(k == kOffset ? P.xo.data() : P.xx.data() + 12 * k);
#pragma GCC unroll 4
      for (std::size_t m = 0; m < kCount; ++m) PJ_[m].add(rows.row[k][first + m], column);
    }
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
#pragma GCC unroll 8
      for (std::size_t k = 0; k < kPose; ++k) S_[m].add(PJ_[m][k], of_each(k));
      S_[m].add(PJ_o_[m], of_each(kOffset));
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
      o_[m] = PJ_o_[m];
      gain_[m] = PJ_[m];
      gain_[m].scale(inverse_[m]);
      Each shared = S_[m];
      shared.scale(inverse_[m]);
#pragma GCC unroll 4
      for (std::size_t later = m + 1; later < kCount; ++later) {
        S_[later].subtract(shared[later], S_[m]);
        PJ_[later].subtract(shared[later], PJ_[m]);
      }
      PJ_o_.subtract(o_[m], shared);
      const double innovation = innovation_[m];
      innovation_.subtract(innovation, shared);
    }
  }

  // Whether all variances are positive, and stay so.
  [[gnu::always_inline]] bool good(const ErrorCovariance& P) const noexcept {
    bool positive = true;
    double o = P.oo, told = 0;
    Column less;
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      positive = positive && variance_[m] > 0;
      less.add_product(PJ_[m], gain_[m]);
      o -= inverse_[m] * o_[m] * o_[m];
      told += std::abs(told_[m]);
    }
    double least = o;
#pragma GCC unroll 8
    for (std::size_t k = 0; k < kPose; ++k) least = std::min(least, P.xx.data()[12 * k + k] - less[k]);
    return positive && least > 0 && told < std::numeric_limits<double>::infinity();
  }

  [[gnu::always_inline]] void apply(ErrorCovariance& P, ErrorState& error) const noexcept {
    Column x(error.x.data());
#pragma GCC unroll 4
    for (std::size_t m = 0; m < kCount; ++m) {
      x.add(told_[m], PJ_[m]);
      error.o += told_[m] * o_[m];
      P.oo -= inverse_[m] * o_[m] * o_[m];
    }
    x.store(error.x.data());
#pragma GCC unroll 16
    for (std::size_t k = 0; k <= 12; ++k) {
      double* const place = k < 12 ? P.xx.data() + 12 * k : P.xo.data();
      Column column(place);
#pragma GCC unroll 4
      for (std::size_t m = 0; m < kCount; ++m) column.subtract(k < 12 ? PJ_[m][k] : o_[m], gain_[m]);
      column.store(place);
    }
  }

  std::array<Column, kCount> PJ_;    // P J^T, of x
  std::array<Column, kCount> gain_;  // the same by the variance
  Each PJ_o_;                        // and of o
  Each innovation_;
  std::array<Each, kCount> S_;
  std::array<double, kCount> variance_, inverse_, told_, o_;
};

}  // namespace evmarker
