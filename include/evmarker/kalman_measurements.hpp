#pragma once
// Floor 2. The measurements of one Kalman update, and what they make of the state and its covariance.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/pose.hpp"
#include "evmarker/symmetric.hpp"

namespace evmarker {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

using Matrix67d = Eigen::Matrix<double, 6, 7>;

/// Covariance by blocks: p is the pose, v its velocity, o the edge offset; q = [p; o] is what events tell of. The op
/// block is that of po. Columns have an even length: arithmetic in pairs of numbers needs no remainder.
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
    rows_[static_cast<std::size_t>(waiting_++)] = {row, weight};
    ++count_;
  }

  void clear() noexcept {
    if (count_ > kFew) squares_.setZero();
    count_ = waiting_ = 0;
  }

  int count() const noexcept { return count_; }

  /// Turns a prior covariance and the expected error of its mean into the posterior's. False if the covariance was not
  /// positive definite or a number was not finite: then both are of no use.
  /// @param information of a measurement of weight 1
  bool correct(BlockCovariance& P, BlockError& error, double information) noexcept {
    if (count_ <= kFew) return one_by_one(P, error, information);
    add_squares();
    return together(P, error, information);
  }

 private:
  static constexpr int kFew = 10;      // measured: of more, all at once is faster
  static constexpr int kWaiting = 32;  // of so many, what is done once for all does not matter

  struct Row {
    Vector8d row;
    double weight;
  };

  // Adds w [J; d] [J; d]^T of the rows that wait: by two columns, and so many at a time that sums stay in registers.
  void add_squares() noexcept {
    add_columns<0, 2>();
    add_columns<2, 8>();
    waiting_ = 0;
  }

  template <int From, int To>
  void add_columns() noexcept {
    Eigen::Matrix<double, 8, To - From> sums = Eigen::Matrix<double, 8, To - From>::Zero();
    for (int i = 0; i < waiting_; ++i) {
      const auto& [row, weight] = rows_[static_cast<std::size_t>(i)];
      const Vector8d weighted = weight * row;
      add_column<From, From, To>(sums, weighted, row);
    }
    for (int j = From; j < To; ++j) squares_.col(j) += sums.col(j - From);
  }

  template <int J, int From, int To>
  static void add_column(Eigen::Matrix<double, 8, To - From>& sums, const Vector8d& weighted,
                         const Vector8d& row) noexcept {
    constexpr int kRows = 8 - J / 2 * 2;
    sums.col(J - From).template tail<kRows>() += row(J) * weighted.template tail<kRows>();
    if constexpr (J + 1 < To) add_column<J + 1, From, To>(sums, weighted, row);
  }

  // One after the other: exact, and cheaper while they are few. One that cannot be taken is left out.
  bool one_by_one(BlockCovariance& P, BlockError& error, double information) const noexcept {
    int left_out = 0;
    for (int i = 0; i < count_; ++i) left_out += !take(rows_[static_cast<std::size_t>(i)], P, error, information);
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

  // Two functions, and not inline: in one, compilers keep all of P from the first half for the second, on the stack.
  struct Gain {
    Vector6d P_p, P_v;     // P J^T
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
    for_lower<7>([&](int i, int j) { H(i, j) = H(j, i) = information * squares_(i, j); });
    for (int j = 0; j < 7; ++j) b(j) = information * squares_(7, j) - H(6, j) * error.o;
    for (int j = 0; j < 7; ++j)
      for (int i = 0; i < 6; ++i) b(j) -= H(i, j) * error.p(i);
    for_lower<6>([&](int i, int j) { Q(i, j) = P.pq(i, j); });
    for (int j = 0; j < 6; ++j) Q(6, j) = P.pq(j, 6);
    Q(6, 6) = P.oo;

    // Q <- (Q^-1 + H)^-1. The rest follows as far as it correlates with q: (I - P H) of P_vq and P_vv.
    bool good = invert_lower(Q);
    for_lower<7>([&](int i, int j) { Q(i, j) += H(i, j); });
    good = invert_lower(Q) && good;
    if (!good || !std::isfinite(b.sum())) return false;

    mirror_lower(Q);
    P.pq = Q.topRows<6>();
    P.oo = Q(6, 6);
    const Matrix67d P_vq_H = product(P.vq, H);
    P.vq -= product(P_vq_H, Q);
    for (int k = 0; k < 7; ++k)
      for (int j = 0; j < 6; ++j) P.vv.col(j) -= P.vq(j, k) * P_vq_H.col(k);
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

  std::array<Row, kWaiting> rows_{};  // that are not in the sums yet
  Eigen::Matrix<double, 8, 8> squares_ =
      Eigen::Matrix<double, 8, 8>::Zero();  // lower triangle: sum of w [J; d] [J; d]^T, of more than a few
  int count_ = 0, waiting_ = 0;
};

}  // namespace evmarker
