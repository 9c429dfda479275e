#pragma once
// Floor 2. The measurements of one Kalman update, and what they make of the state and its covariance.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/correspondences.hpp"
#include "evmarker/pose.hpp"
#include "evmarker/symmetric.hpp"
#include "evmarker/wide_vectors.hpp"

namespace evmarker {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Matrix67d = Eigen::Matrix<double, 6, 7>;

/// Covariance by blocks: p is the pose, v its velocity, o the edge offset; q = [p; o] is what events tell of. Columns
/// of six are three aligned pairs of numbers: with columns of seven, a measurement took a quarter more instructions.
struct BlockCovariance {
  Matrix67d pq = Matrix67d::Zero(), vq = Matrix67d::Zero();
  Matrix6d vv = Matrix6d::Zero();
  double oo = 0;
};

/// How far the state is from what was expected.
struct BlockError {
  Vector6d p = Vector6d::Zero(), v = Vector6d::Zero();
  double o = 0;
};

/// Collects scalar measurements d = J [p; o] of an error state and solves for it.
class KalmanMeasurements {
 public:
  /// @param row [J; d]
  /// @param weight inverse variance, up to the factor that `correct` is given
  void add(const Vector8d& row, double weight) noexcept {
    if (waiting_ == kWaiting) add_squares();
    for (std::size_t j = 0; j < 8; ++j) rows_[j][waiting_] = row(static_cast<Eigen::Index>(j));
    weights_[waiting_++] = weight;
    ++count_;
  }

  /// The same for the first `count` of a lane each; the others must be finite.
  [[gnu::always_inline]] void add(const std::array<Lanes, 8>& rows, const Lanes& weights, std::size_t count) noexcept {
    if (waiting_ + kLanes > kWaiting) add_squares();
    for (std::size_t j = 0; j < 8; ++j)
      for (std::size_t i = 0; i < kLanes; ++i) rows_[j][waiting_ + i] = rows[j][i];
    for (std::size_t i = 0; i < kLanes; ++i) weights_[waiting_ + i] = weights[i];
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
  bool correct(BlockCovariance& P, BlockError& error, double information) noexcept {
    if (count_ <= kFew) return one_by_one(P, error, information);
    add_squares();
    return together(P, error, information);
  }

 private:
  static constexpr int kFew = 10;  // measured: from 12 on, all at once is faster
  static constexpr std::size_t kWaiting = 4 * kLanes;

  // Adds w [J; d] [J; d]^T of the rows that wait to the lower triangle, lane by lane.
  [[gnu::noinline]] void add_squares() noexcept {
    in_wide_vectors([&]() __attribute__((always_inline)) {
      for (std::size_t i = waiting_; i % kLanes != 0; ++i) {
        weights_[i] = 0;
        for (std::size_t j = 0; j < 8; ++j) rows_[j][i] = 0;
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
        row[j][i] = rows_[j][from + i];
        weighted[j][i] = weights_[from + i] * row[j][i];
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

  struct Row {
    Vector8d row;
    double weight;
  };

  Row row(int i) const noexcept {
    const auto place = static_cast<std::size_t>(i);
    Row row;
    for (std::size_t j = 0; j < 8; ++j) row.row(static_cast<Eigen::Index>(j)) = rows_[j][place];
    row.weight = weights_[place];
    return row;
  }

  // One after the other: exact, and cheaper while they are few. One that cannot be taken is left out.
  bool one_by_one(BlockCovariance& P, BlockError& error, double information) const noexcept {
    int left_out = 0;
    for (int i = 0; i < count_; ++i) left_out += !take(row(i), P, error, information);
    return count_ == 0 || left_out < count_;
  }

  // One measurement. False changes nothing.
  static bool take(const Row& measurement, BlockCovariance& P, BlockError& error, double information) noexcept {
    Gain gain;
    if (!gain.find(measurement, P, error, information)) return false;
    gain.apply(P);
    error.p += gain.step * gain.P_p;
    error.v += gain.step * gain.P_v;
    error.o += gain.step * gain.P_o;
    return true;
  }

  // P J^T and what it takes from P. Two functions, not inline: in one, GCC saves all of P on the stack for the second
  // half.
  struct Gain {
    Vector6d P_p, P_v;        // P J^T
    Vector6d less_p, less_v;  // -P J^T / variance
    double P_o, less_o, step;

    [[gnu::noinline]] bool find(const Row& measurement, const BlockCovariance& P, const BlockError& error,
                                double information) noexcept {
      const auto& [row, weight] = measurement;
      const double s = row(6);
      P_p = row(0) * P.pq.col(0);
      P_v = row(0) * P.vq.col(0);
#pragma GCC unroll 8
      for (int k = 1; k < 7; ++k) {
        P_p += row(k) * P.pq.col(k);
        P_v += row(k) * P.vq.col(k);
      }
      const Vector6d J = row.head<6>();
      P_o = J.dot(P.pq.col(6)) + s * P.oo;
      const double variance = 1 / (information * weight) + J.dot(P_p) + s * P_o;
      const double inverse = 1 / variance;
      step = inverse * (row(7) - s * error.o - J.dot(error.p));
      less_p = -inverse * P_p;
      less_v = -inverse * P_v;
      less_o = -inverse * P_o;
      double least = P.oo + P_o * less_o;
      for (int k = 0; k < 6; ++k) least = std::min(least, P.pq(k, k) + P_p(k) * less_p(k));
      return least > 0 && variance > 0 && std::isfinite(variance + step);
    }

    [[gnu::noinline]] void apply(BlockCovariance& P) const noexcept {
#pragma GCC unroll 8
      for (int k = 0; k < 6; ++k) {
        P.pq.col(k) += P_p(k) * less_p;
        P.vq.col(k) += P_p(k) * less_v;
        P.vv.col(k) += P_v(k) * less_v;
      }
      P.pq.col(6) += P_o * less_p;
      P.vq.col(6) += P_o * less_v;
      P.oo += P_o * less_o;
    }
  };

  // All at once by their information H and b about [p; o].
  bool together(BlockCovariance& P, BlockError& error, double information) const noexcept {
    Matrix7d H, Q;
    Vector7d b;
    in_wide_vectors([&]() __attribute__((always_inline)) {
      std::size_t place = 0;
      for (int j = 0; j < 7; ++j) {
        for (int i = j; i < 7; ++i) H(i, j) = H(j, i) = information * sum(squares_[place++]);
        b(j) = information * sum(squares_[place++]);
      }
    });
    b -= error.o * H.col(6);
    for (int k = 0; k < 6; ++k) b -= error.p(k) * H.col(k);

    // P_qq <- (P_qq^-1 + H)^-1. The signs of the two sweeps cancel.
    for_lower<6>([&](int i, int j) { Q(i, j) = P.pq(i, j); });
    for (int j = 0; j < 6; ++j) Q(6, j) = P.pq(j, 6);
    Q(6, 6) = P.oo;
    bool good = sweep_lower(Q);
    for_lower<7>([&](int i, int j) { Q(i, j) -= H(i, j); });
    good = sweep_lower(Q, -1) && good;
    if (!good || !std::isfinite(b.sum())) return false;
    mirror_lower(Q);
    P.pq = Q.topRows<6>();
    P.oo = Q(6, 6);

    // The rest follows as far as it correlates with q: P_vq -= P_vq H P_qq, P_vv -= P_vq H P_qv.
    const Matrix67d P_vq_H = product(P.vq, H);
    P.vq -= product(P_vq_H, Q);
    for (int j = 0; j < 6; ++j) {
      Vector6d column = P.vv.col(j);
      for (int k = 0; k < 7; ++k) column -= P.vq(j, k) * P_vq_H.col(k);
      P.vv.col(j) = column;
    }
    for (int k = 0; k < 7; ++k) {
      error.p += b(k) * P.pq.col(k);
      error.v += b(k) * P.vq.col(k);
      error.o += b(k) * Q(6, k);
    }
    return true;
  }

  static Matrix67d product(const Matrix67d& A, const Matrix7d& B) noexcept {
    Matrix67d AB;
    for (int j = 0; j < 7; ++j) {
      Vector6d column = B(0, j) * A.col(0);
      for (int k = 1; k < 7; ++k) column += B(k, j) * A.col(k);
      AB.col(j) = column;
    }
    return AB;
  }

  // That are not in the squares yet, number by number.
  alignas(64) std::array<std::array<double, kWaiting>, 8> rows_{};
  alignas(64) std::array<double, kWaiting> weights_{};
  alignas(
      64) std::array<Lanes, 36> squares_{};  // lower triangle, by columns, of the sum of w [J; d] [J; d]^T, if begun
  bool squares_begun_ = false;
  int count_ = 0;
  std::size_t waiting_ = 0;
};

}  // namespace evmarker
