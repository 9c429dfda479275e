#pragma once
// The scalar measurements of one Kalman update.
#include <algorithm>
#include <array>
#include <cstddef>

#include "evmarker/simd/lanes.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/sequential_update.hpp"

namespace evmarker {

/// The row [J; d] of a measurement d = J [pose; b], b the biases.
using MeasurementRow = std::array<double, MeasurementRows::kNumbers>;

/// Collects scalar measurements d = J [pose; b] of an error state, and corrects the state by all of them.
class KalmanMeasurements {
 public:
  /// Adds a measurement, which must be finite.
  /// @param weight inverse variance, up to the factor `information` of `correct`
  void add(const MeasurementRow& row, double weight) noexcept {
    if (waiting_ == kMost) add_squares();
    for (std::size_t j = 0; j < kNumbers; ++j) rows_.row[j][waiting_] = row[j];
    rows_.weight[waiting_++] = weight;
    ++count_;
  }

  /// Adds the measurements in the first `count` lanes, which must be finite; the other lanes are ignored.
  [[gnu::always_inline]] void add(const std::array<simd::Lanes, MeasurementRows::kNumbers>& rows,
                                  const simd::Lanes& weights, std::size_t count) noexcept {
    if (waiting_ + simd::kLanes > kMost) add_squares();
    for (std::size_t j = 0; j < kNumbers; ++j)
      for (std::size_t i = 0; i < simd::kLanes; ++i) rows_.row[j][waiting_ + i] = rows[j][i];
    for (std::size_t i = 0; i < simd::kLanes; ++i) rows_.weight[waiting_ + i] = weights[i];
    waiting_ += count;
    count_ += static_cast<int>(count);
  }

  /// Discards all measurements.
  void clear() noexcept {
    count_ = 0;
    waiting_ = 0;
    squares_begun_ = false;
  }

  int count() const noexcept { return count_; }

  /// Corrects an error state and its covariance by all measurements; to be followed by `clear`.
  /// @param information inverse variance of a measurement of weight 1
  /// @return false, and nothing has changed, if none could be applied: the covariance was not positive definite, or the
  /// measurements were not finite; true if at least one was, or if there are none
  [[gnu::noinline]] bool correct(ErrorCovariance& P, ErrorState& error, double information) noexcept {
    if (count_ == 0) return true;
    if (count_ > kFew) {
      add_squares();
      condense();
    }
    bool applied = false;
    simd::in_packs([&](auto bits) __attribute__((always_inline)) {
      constexpr std::size_t kBits = bits, kTogether = kBits > 128 ? 4 : 2;  // as many as fit into the registers
      std::size_t i = 0;
      for (; i + kTogether <= waiting_; i += kTogether) applied |= apply<kTogether, kBits>(i, information, P, error);
      if constexpr (kTogether > 2)
        if (i + 2 <= waiting_) {
          applied |= apply<2, kBits>(i, information, P, error);
          i += 2;
        }
      if (i < waiting_) applied |= apply<1, kBits>(i, information, P, error);
    });
    return applied;
  }

 private:
  static constexpr std::size_t kMost = MeasurementRows::kMost, kNumbers = MeasurementRows::kNumbers,
                               kStates = MeasurementRows::kStates;
  static constexpr int kFew = 12;  // measurements; with more, condensing them first is faster, by timing
  // There are squares only of more than kFew measurements, so that `correct` never leaves them out.
  static_assert(kMost - simd::kLanes >= static_cast<std::size_t>(kFew));
  static constexpr double kRounding = 1e-14;  // relative error that rounding may leave of a sum of squares

  // Applies `kCount` measurements together; if that fails, one by one, without those that fail again. Returns false if
  // none was applied.
  template <std::size_t kCount, std::size_t kBits>
  [[gnu::always_inline]] bool apply(std::size_t first, double information, ErrorCovariance& P,
                                    ErrorState& error) const noexcept {
    if (SequentialUpdate<kCount, kBits>::apply(rows_, first, information, P, error)) [[likely]]
      return true;
    return kCount > 1 && apply_one_by_one(first, kCount, information, P, error);
  }

  [[gnu::noinline]] bool apply_one_by_one(std::size_t first, std::size_t count, double information, ErrorCovariance& P,
                                          ErrorState& error) const noexcept {
    bool applied = false;
    for (std::size_t i = first; i < first + count; ++i)
      applied |= SequentialUpdate<1, 128>::apply(rows_, i, information, P, error);
    return applied;
  }

  // Adds w [J; d] [J; d]^T of the waiting rows to the squares, lane by lane. Then no row is waiting.
  [[gnu::noinline]] void add_squares() noexcept {
    simd::in_wide_vectors([&]() __attribute__((always_inline)) {
      for (std::size_t i = waiting_; i % simd::kLanes != 0; ++i) {
        rows_.weight[i] = 0;
        for (std::size_t j = 0; j < kNumbers; ++j) rows_.row[j][i] = 0;
      }
      for (std::size_t from = 0; from < waiting_; from += simd::kLanes) add_squares(from);
    });
    waiting_ = 0;
    squares_begun_ = true;
  }

  [[gnu::always_inline]] void add_squares(std::size_t from) noexcept {
    alignas(64) std::array<simd::Lanes, kNumbers> row, weighted;
    for (std::size_t j = 0; j < kNumbers; ++j)
      for (std::size_t i = 0; i < simd::kLanes; ++i) {
        row[j][i] = rows_.row[j][from + i];
        weighted[j][i] = rows_.weight[from + i] * row[j][i];
      }
    const double kept = squares_begun_ || from > 0 ? 1 : 0;
    std::size_t place = 0;
#pragma GCC unroll 10
    for (std::size_t j = 0; j < kNumbers; ++j)
#pragma GCC unroll 10
      for (std::size_t k = j; k < kNumbers; ++k, ++place)
        for (std::size_t i = 0; i < simd::kLanes; ++i)
          squares_[place][i] = kept * squares_[place][i] + weighted[j][i] * row[k][i];
  }

  // Replaces all measurements by nine with the same information. These are the first nine columns of L in S = L D
  // L^T, where S is the sum of w [J; d] [J; d]^T, and their weights are on the diagonal of D. A direction without
  // information gets weight 0.
  [[gnu::noinline]] void condense() noexcept {
    double S[kNumbers][kNumbers], L[kNumbers][kNumbers], D[kNumbers];  // S[k], L[k]: column k
    std::size_t place = 0;
#pragma GCC unroll 10
    for (std::size_t k = 0; k < kNumbers; ++k)
#pragma GCC unroll 10
      for (std::size_t i = k; i < kNumbers; ++i) S[k][i] = simd::sum(squares_[place++]);
#pragma GCC unroll 10
    for (std::size_t k = 0; k < kNumbers; ++k) D[k] = kRounding * S[k][k];  // at first, what rounding may leave of S
#pragma GCC unroll 10
    for (std::size_t k = 0; k < kStates; ++k) {
      const bool observed = S[k][k] > D[k];
      const double inverse = observed ? 1 / S[k][k] : 0;
      D[k] = observed ? S[k][k] : 0;
#pragma GCC unroll 10
      for (std::size_t i = k; i < kNumbers; ++i) L[k][i] = inverse * S[k][i];
#pragma GCC unroll 10
      for (std::size_t j = k + 1; j < kNumbers; ++j)
#pragma GCC unroll 10
        for (std::size_t i = j; i < kNumbers; ++i) S[j][i] -= L[k][j] * S[k][i];
    }
#pragma GCC unroll 10
    for (std::size_t k = 0; k < kStates; ++k) rows_.weight[k] = D[k];
#pragma GCC unroll 10
    for (std::size_t i = 0; i < kNumbers; ++i)
#pragma GCC unroll 10
      for (std::size_t k = 0; k < kStates; ++k) rows_.row[i][k] = i < k ? 0 : L[k][i];
    waiting_ = kStates;
  }

  MeasurementRows rows_;  // waiting: not yet added to the squares
  // Lower triangle, by columns, of the sum of w [J; d] [J; d]^T in each lane; void until `squares_begun_`.
  alignas(64) std::array<simd::Lanes, kNumbers*(kNumbers + 1) / 2> squares_{};
  bool squares_begun_ = false;
  int count_ = 0;            // measurements since `clear`
  std::size_t waiting_ = 0;  // rows in `rows_`
};

}  // namespace evmarker
