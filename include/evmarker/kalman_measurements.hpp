#pragma once
// Floor 3. The measurements of one Kalman update.
#include <algorithm>
#include <array>
#include <cstddef>

#include "evmarker/lanes.hpp"
#include "evmarker/measurement_update.hpp"
#include "evmarker/wide_vectors.hpp"

namespace evmarker {

using Vector8d = Eigen::Matrix<double, 8, 1>;

/// Collects scalar measurements d = J [p; o] of an error state and solves for it.
class KalmanMeasurements {
 public:
  /// @param row [J; d]
  /// @param weight inverse variance, up to the factor that `correct` is given
  void add(const Vector8d& row, double weight) noexcept {
    if (waiting_ == kMost) add_squares();
    for (std::size_t j = 0; j < 8; ++j) rows_.J_d[j][waiting_] = row(static_cast<Eigen::Index>(j));
    rows_.weight[waiting_++] = weight;
    ++count_;
  }

  /// The same for the first `count` of a lane each; the others must be finite.
  [[gnu::always_inline]] void add(const std::array<Lanes, 8>& rows, const Lanes& weights, std::size_t count) noexcept {
    if (waiting_ + kLanes > kMost) add_squares();
    for (std::size_t j = 0; j < 8; ++j)
      for (std::size_t i = 0; i < kLanes; ++i) rows_.J_d[j][waiting_ + i] = rows[j][i];
    for (std::size_t i = 0; i < kLanes; ++i) rows_.weight[waiting_ + i] = weights[i];
    waiting_ += count;
    count_ += static_cast<int>(count);
  }

  void clear() noexcept {
    count_ = 0;
    waiting_ = 0;
    squares_begun_ = false;
  }

  int count() const noexcept { return count_; }

  /// Turns a prior covariance and the expected error of its mean into the posterior's. False, and nothing has changed,
  /// if the covariance was not positive definite or no measurement was finite.
  /// @param information of a measurement of weight 1
  [[gnu::noinline]] bool correct(ErrorCovariance& P, ErrorState& error, double information) noexcept {
    if (count_ == 0) return true;
    if (count_ > kFew) add_squares();
    bool any = false;
    in_packs([&](auto bits) __attribute__((always_inline)) {
      constexpr std::size_t kBits = bits.value;
      if (count_ > kFew) condense();
      constexpr std::size_t kAbreast = kBits > 128 ? 4 : 2;  // of four, not all numbers fit into sixteen registers
      std::size_t first = 0;
      for (; first + kAbreast <= waiting_; first += kAbreast)
        any |= take<kAbreast, kBits>(first, P, error, information);
      for (; first + 2 <= waiting_; first += 2) any |= take<2, kBits>(first, P, error, information);
      if (first < waiting_) any |= take<1, kBits>(first, P, error, information);
    });
    return any;
  }

 private:
  static constexpr std::size_t kMost = MeasurementRows::kMost;
  static constexpr int kFew = 12;  // measured
  static constexpr double kNothing = 1e-14;  // of a square: what rounding leaves

  // One that cannot be taken is left out.
  template <std::size_t kCount, std::size_t kBits>
  [[gnu::always_inline]] bool take(std::size_t first, ErrorCovariance& P, ErrorState& error,
                                   double information) const noexcept {
    if (MeasurementUpdate<kCount, kBits>::take(rows_, first, information, P, error)) [[likely]] return true;
    bool any = false;
    if constexpr (kCount > 1)
      for (std::size_t i = first; i < first + kCount; ++i) any |= take_one<kBits>(i, P, error, information);
    return any;
  }
  template <std::size_t kBits>
  [[gnu::noinline]] bool take_one(std::size_t i, ErrorCovariance& P, ErrorState& error,
                                   double information) const noexcept {
    return take<1, 128>(i, P, error, information);
  }

  // Adds w [J; d] [J; d]^T of the rows that wait to the lower triangle, lane by lane.
  [[gnu::noinline]] void add_squares() noexcept {
    in_wide_vectors([&]() __attribute__((always_inline)) {
      for (std::size_t i = waiting_; i % kLanes != 0; ++i) {
        rows_.weight[i] = 0;
        for (std::size_t j = 0; j < 8; ++j) rows_.J_d[j][i] = 0;
      }
      for (std::size_t from = 0; from < waiting_; from += kLanes) add_squares(from);
    });
    waiting_ = 0;
    squares_begun_ = true;
  }

  [[gnu::always_inline]] void add_squares(std::size_t from) noexcept {
    alignas(64) std::array<Lanes, 8> row, weighted;
    for (std::size_t j = 0; j < 8; ++j)
      for (std::size_t i = 0; i < kLanes; ++i) {
        row[j][i] = rows_.J_d[j][from + i];
        weighted[j][i] = rows_.weight[from + i] * row[j][i];
      }
    const double kept = squares_begun_ || from > 0 ? 1 : 0;
    std::size_t place = 0;
#pragma GCC unroll 8
    for (std::size_t j = 0; j < 8; ++j)
#pragma GCC unroll 8
      for (std::size_t k = j; k < 8; ++k, ++place)
        for (std::size_t i = 0; i < kLanes; ++i)
          squares_[place][i] = kept * squares_[place][i] + weighted[j][i] * row[k][i];
  }

  // Seven measurements that tell the same as the squares S = sum of w [J; d] [J; d]^T: with S = L D L^T, the columns of
  // L, weighted by D. Directions of which nothing is told have no weight.
  [[gnu::always_inline]] void condense() noexcept {
    double S[8][8];
    std::size_t place = 0;
#pragma GCC unroll 8
    for (std::size_t j = 0; j < 8; ++j)
#pragma GCC unroll 8
      for (std::size_t i = j; i < 8; ++i) S[j][i] = sum(squares_[place++]);
    double all[8];
    for (std::size_t k = 0; k < 8; ++k) all[k] = S[k][k];
    waiting_ = 7;
#pragma GCC unroll 8
    for (std::size_t k = 0; k < 7; ++k) {
      const double D = S[k][k], inverse = D > kNothing * all[k] ? 1 / D : 0;
      rows_.weight[k] = D > kNothing * all[k] ? D : 0;
#pragma GCC unroll 8
      for (std::size_t i = 0; i < 8; ++i) rows_.J_d[i][k] = i < k ? 0 : inverse * S[k][i];
#pragma GCC unroll 8
      for (std::size_t j = k + 1; j < 8; ++j)
#pragma GCC unroll 8
        for (std::size_t i = j; i < 8; ++i) S[j][i] -= rows_.J_d[j][k] * S[k][i];
    }
  }

  // That are not in the squares yet, number by number.
  MeasurementRows rows_;
  alignas(
      64) std::array<Lanes, 36> squares_{};  // lower triangle, by columns, of the sum of w [J; d] [J; d]^T, if begun
  bool squares_begun_ = false;
  int count_ = 0;
  std::size_t waiting_ = 0;
};

}  // namespace evmarker
