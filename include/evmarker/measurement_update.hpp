#pragma once
// Floor 2. What a few measurements, one after the other, make of an error state and its covariance.
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "evmarker/error_state.hpp"
#include "evmarker/pack.hpp"

namespace evmarker {

/// Scalar measurements d = J [pose; o] of an error state, number by number.
struct MeasurementRows {
  static constexpr std::size_t kMost = 32;
  using Numbers = std::array<double, kMost>;
  static constexpr std::size_t kOffset = 6, kMeasured = 7;  ///< o's number in J, and d

  alignas(64) std::array<Numbers, 8> J_d{};  ///< [J; d]
  alignas(64) Numbers weight{};              ///< inverse variance
};

/// Up to four measurements, taken as the textbook does it one after the other, but so that they wait for each other
/// only where they must: the covariance is read and written once.
template <std::size_t kCount, std::size_t kBits>
class MeasurementUpdate {
 public:
  /// False changes nothing: a number is not finite, or the covariance is not positive definite.
  [[gnu::always_inline]] static bool take(const MeasurementRows& rows, std::size_t first, double information,
                                          ErrorCovariance& P, ErrorState& error) noexcept {
    MeasurementUpdate update;
    update.expect(rows, first, information, P, error);
    update.one_after_the_other();
    if (!update.good(P)) return false;
    update.apply(P, error);
    return true;
  }

 private:
  using State = StatePack<kBits>;
  using Each = Pack<kCount == 1 ? 1 : 4, kCount == 1 ? 64 : kBits>;  // a number of each measurement; those from kCount on mean nothing

  static constexpr std::size_t kOffset = MeasurementRows::kOffset, kPose = 6;

  // P J^T, the innovations d - J e and their covariance S = J P J^T + R.
  [[gnu::always_inline]] void expect(const MeasurementRows& rows, std::size_t first, double information, const ErrorCovariance& P,
                                     const ErrorState& error) noexcept {
    const auto number = [&](std::size_t k) { return Each(&rows.J_d[k][first]); };
    gain_o_.add(P.oo, number(kOffset));
    innovation_ = number(MeasurementRows::kMeasured);
    innovation_.take(error.o, number(kOffset));
#pragma GCC unroll 16
    for (std::size_t k = 0; k < kPose; ++k) {
      gain_o_.add(P.xo.data()[k], number(k));
      innovation_.take(error.x.data()[k], number(k));
    }
#pragma GCC unroll 16
    for (std::size_t k = 0; k <= kPose; ++k) {
      const State column(k < kPose ? P.xx.data() + 12 * k : P.xo.data());
#pragma GCC unroll 16
      for (std::size_t m = 0; m < kCount; ++m) gain_[m].add(rows.J_d[k][first + m], column);
    }
#pragma GCC unroll 16
    for (std::size_t m = 0; m < kCount; ++m) {
      variance_[m] = 1 / (information * rows.weight[first + m]);
#pragma GCC unroll 16
      for (std::size_t k = 0; k < kPose; ++k) S_[m].add(gain_[m][k], number(k));
      S_[m].add(gain_o_[m], number(kOffset));
    }
  }

  // What each tells is taken from those after it: they are left with what they tell besides.
  [[gnu::always_inline]] void one_after_the_other() noexcept {
#pragma GCC unroll 16
    for (std::size_t m = 0; m < kCount; ++m) {
      variance_[m] += S_[m][m];
      inverse_[m] = 1 / variance_[m];
      Each share = S_[m];
      share *= inverse_[m];
#pragma GCC unroll 16
      for (std::size_t later = m + 1; later < kCount; ++later) {
        S_[later].take(share[later], S_[m]);
        gain_[later].take(share[later], gain_[m]);
      }
      const double o = gain_o_[m], d = innovation_[m];
      if (m + 1 < kCount) {
        gain_o_.take(o, share);
        innovation_.take(d, share);
      }
      o_[m] = o;
      step_[m] = inverse_[m] * d;
    }
  }

  // Whether all variances are, and those of the measured states stay, positive.
  [[gnu::always_inline]] bool good(const ErrorCovariance& P) const noexcept {
    double least = P.oo, most = 0;
#pragma GCC unroll 16
    for (std::size_t m = 0; m < kCount; ++m) {
      least -= inverse_[m] * o_[m] * o_[m];
      most += std::abs(step_[m]);
    }
    bool positive = least > 0;
#pragma GCC unroll 16
    for (std::size_t m = 0; m < kCount; ++m) positive = positive && variance_[m] > 0;
#pragma GCC unroll 16
    for (std::size_t k = 0; k < kPose; ++k) {
      double left = P.xx.data()[13 * k];
#pragma GCC unroll 16
      for (std::size_t m = 0; m < kCount; ++m) left -= inverse_[m] * gain_[m][k] * gain_[m][k];
      positive = positive && left > 0;
    }
    return positive && most < std::numeric_limits<double>::infinity();
  }

  [[gnu::always_inline]] void apply(ErrorCovariance& P, ErrorState& error) const noexcept {
    State scaled[kCount], x(error.x.data());
#pragma GCC unroll 16
    for (std::size_t m = 0; m < kCount; ++m) {
      x.add(step_[m], gain_[m]);
      error.o += step_[m] * o_[m];
      scaled[m] = gain_[m];
      scaled[m] *= inverse_[m];
    }
    x.store(error.x.data());
#pragma GCC unroll 16
    for (std::size_t k = 0; k <= 12; ++k) {
      double* const place = k < 12 ? P.xx.data() + 12 * k : P.xo.data();
      State column(place);
#pragma GCC unroll 16
      for (std::size_t m = 0; m < kCount; ++m) column.take(k < 12 ? gain_[m][k] : o_[m], scaled[m]);
      column.store(place);
    }
#pragma GCC unroll 16
    for (std::size_t m = 0; m < kCount; ++m) P.oo -= inverse_[m] * o_[m] * o_[m];
  }

  State gain_[kCount];     // P J^T of x
  Each gain_o_;            // and of o
  Each innovation_;
  Each S_[kCount];
  double variance_[kCount], inverse_[kCount], step_[kCount], o_[kCount];
};

}  // namespace evmarker
