#pragma once
// Floor 2. The measurements of one Kalman update, and what they make of the state and its covariance.
#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "evmarker/pose.hpp"
#include "evmarker/symmetric.hpp"

namespace evmarker {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

/// Covariance by blocks: p is the pose, v its velocity, o the edge offset; events tell of pose and offset. All columns
/// are of six, which is three pairs of numbers: arithmetic in pairs needs no remainder.
struct BlockCovariance {
  Matrix6d pp = Matrix6d::Zero(), vp = Matrix6d::Zero(), vv = Matrix6d::Zero();
  Vector6d po = Vector6d::Zero(), vo = Vector6d::Zero();
  double oo = 0;
};

/// How far a state is from what was expected, by the same blocks.
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
    if (count_ < kFew) {
      rows_[static_cast<std::size_t>(count_)] = {row, weight};
    } else {
      if (count_ == kFew)
        for (const Row& first : rows_) sum_of_squares(first.weight * first.row, first.row);
      sum_of_squares(weight * row, row);
    }
    ++count_;
  }

  void clear() noexcept {
    if (count_ > kFew) squares_.setZero();
    count_ = 0;
  }

  int count() const noexcept { return count_; }

  /// Turns a prior covariance and the expected error of its mean into the posterior's. False if the covariance was not
  /// positive definite or a number was not finite: then both are of no use.
  /// @param information of a measurement of weight 1
  bool correct(BlockCovariance& P, BlockError& error, double information) const noexcept {
    return count_ <= kFew ? one_by_one(P, error, information) : together(P, error, information);
  }

 private:
  static constexpr int kFew = 10;  // measured: of more, all at once is faster

  struct Row {
    Vector8d row;
    double weight;
  };

  // squares_ += a b^T in the lower triangle, by two columns.
  void sum_of_squares(const Vector8d& a, const Vector8d& b) noexcept {
    squares_.col(0) += b(0) * a;
    squares_.col(1) += b(1) * a;
    squares_.col(2).tail<6>() += b(2) * a.tail<6>();
    squares_.col(3).tail<6>() += b(3) * a.tail<6>();
    squares_.col(4).tail<4>() += b(4) * a.tail<4>();
    squares_.col(5).tail<4>() += b(5) * a.tail<4>();
    squares_.col(6).tail<2>() += b(6) * a.tail<2>();
    squares_.col(7).tail<2>() += b(7) * a.tail<2>();
  }

  // A x by columns: each is used as it lies in memory.
  static Vector6d product(const Matrix6d& A, const double* x) noexcept {
    const Vector6d even = x[0] * A.col(0) + x[2] * A.col(2) + x[4] * A.col(4);
    return even + (x[1] * A.col(1) + x[3] * A.col(3) + x[5] * A.col(5));
  }

  // One after the other: exact, and cheaper while they are few.
  bool one_by_one(BlockCovariance& P, BlockError& error, double information) const noexcept {
    for (int i = 0; i < count_; ++i) {
      const auto& [row, weight] = rows_[static_cast<std::size_t>(i)];
      const Vector6d J = row.head<6>();
      const double s = row(6);
      const Vector6d P_p = product(P.pp, row.data()) + s * P.po;  // P J^T
      const Vector6d P_v = product(P.vp, row.data()) + s * P.vo;
      const double P_o = J.dot(P.po) + s * P.oo;
      const double variance = 1 / (information * weight) + (J.dot(P_p) + s * P_o);
      const double innovation = row(7) - (J.dot(error.p) + s * error.o);
      const double inverse = 1 / variance, step = inverse * innovation;
      error.p += step * P_p;
      error.v += step * P_v;
      error.o += step * P_o;
      const Vector6d gain_p = inverse * P_p, gain_v = inverse * P_v;
      for (int k = 0; k < 6; ++k) {
        P.pp.col(k) -= P_p(k) * gain_p;
        P.vp.col(k) -= P_p(k) * gain_v;
        P.vv.col(k) -= P_v(k) * gain_v;
      }
      P.po -= P_o * gain_p;
      P.vo -= P_o * gain_v;
      P.oo -= P_o * P_o * inverse;
    }
    return P.pp.diagonal().minCoeff() > 0 && P.oo > 0;
  }

  // All at once by their information H and b about [p; o].
  bool together(BlockCovariance& P, BlockError& error, double information) const noexcept {
    Matrix7d H, Q;
    for_lower<7>([&](int i, int j) { H(i, j) = H(j, i) = information * squares_(i, j); });
    for_lower<6>([&](int i, int j) { Q(i, j) = P.pp(i, j); });
    Q.row(6).head<6>() = P.po.transpose();
    Q(6, 6) = P.oo;

    // Q <- (Q^-1 + H)^-1. The rest follows as far as it correlates with q: (I - P H) of P_vq and P_vv.
    bool good = invert_lower(Q);
    for_lower<7>([&](int i, int j) { Q(i, j) += H(i, j); });
    good = invert_lower(Q) && good;
    mirror_lower(Q);

    Eigen::Matrix<double, 6, 7> P_vq_H, P_vq;
    P_vq << P.vp, P.vo;
    for (int j = 0; j < 7; ++j) P_vq_H.col(j) = product(P.vp, &H(0, j)) + H(6, j) * P.vo;
    for (int j = 0; j < 7; ++j) {
      Vector6d c = Q(0, j) * P_vq_H.col(0);
      for (int k = 1; k < 7; ++k) c += Q(k, j) * P_vq_H.col(k);
      P_vq.col(j) -= c;
    }
    for (int k = 0; k < 7; ++k)
      for (int j = 0; j < 6; ++j) P.vv.col(j) -= P_vq(j, k) * P_vq_H.col(k);
    Vector7d b;
    for (int j = 0; j < 7; ++j) {
      b(j) = information * squares_(7, j) - H(6, j) * error.o;
      for (int i = 0; i < 6; ++i) b(j) -= H(i, j) * error.p(i);
    }
    for (int k = 0; k < 7; ++k) {
      error.p += b(k) * Q.col(k).head<6>();
      error.v += b(k) * P_vq.col(k);
      error.o += b(k) * Q(6, k);
    }
    P.pp = Q.topLeftCorner<6, 6>();
    P.po = Q.col(6).head<6>();
    P.oo = Q(6, 6);
    P.vp = P_vq.leftCols<6>();
    P.vo = P_vq.col(6);
    return good;
  }

  std::array<Row, kFew> rows_{};  // the first ones
  Eigen::Matrix<double, 8, 8> squares_ =
      Eigen::Matrix<double, 8, 8>::Zero();  // lower triangle: sum of w [J; d] [J; d]^T, of more than a few
  int count_ = 0;
};

}  // namespace evmarker
