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

/// Covariance by blocks: q is what events tell of, pose and edge offset; v the velocity.
struct BlockCovariance {
  Matrix7d qq = Matrix7d::Zero();
  Eigen::Matrix<double, 6, 7> vq = Eigen::Matrix<double, 6, 7>::Zero();
  Matrix6d vv = Matrix6d::Zero();
};

/// Collects scalar measurements d = J q of an error state and solves for it.
class KalmanMeasurements {
 public:
  /// @param row [J; d]
  /// @param weight inverse variance, up to the factor that `correction` is given
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

  struct Correction {
    BlockCovariance P;
    Vector7d dq = Vector7d::Zero();
    Vector6d dv = Vector6d::Zero();
    bool good = true;  ///< false if a covariance was not positive definite: then the numbers mean nothing
  };

  /// The posterior of a prior covariance and an expected error of (`moved`; 0).
  /// @param information of a measurement of weight 1
  Correction correction(const BlockCovariance& prior, const Vector6d& moved, double information) const noexcept {
    return count_ <= kFew ? one_by_one(prior, moved, information) : together(prior, moved, information);
  }

 private:
  static constexpr int kFew = 10;  // measured: of so many, all at once is as fast

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

  // One after the other: exact, and cheaper while they are few.
  Correction one_by_one(const BlockCovariance& prior, const Vector6d& moved, double information) const noexcept {
    Correction after{prior};
    auto& [P, dq, dv, good] = after;
    for (int i = 0; i < count_; ++i) {
      const auto& [row, weight] = rows_[static_cast<std::size_t>(i)];
      Vector7d P_q_J = row(0) * P.qq.col(0);
      Vector6d P_v_J = row(0) * P.vq.col(0);
      for (int k = 1; k < 7; ++k) {
        P_q_J += row(k) * P.qq.col(k);
        P_v_J += row(k) * P.vq.col(k);
      }
      double variance = 1 / (information * weight), innovation = row(7);
      for (int k = 0; k < 7; ++k) {
        variance += row(k) * P_q_J(k);
        innovation -= row(k) * (dq(k) + (k < 6 ? moved(k) : 0));
      }
      const double inverse = 1 / variance;
      const Vector7d gain_q = inverse * P_q_J;
      const Vector6d gain_v = inverse * P_v_J;
      dq += innovation * gain_q;
      dv += innovation * gain_v;
      for (int k = 0; k < 7; ++k) {
        P.qq.col(k) -= P_q_J(k) * gain_q;
        P.vq.col(k) -= P_q_J(k) * gain_v;
      }
      for (int k = 0; k < 6; ++k) P.vv.col(k) -= P_v_J(k) * gain_v;
    }
    good = P.qq.diagonal().minCoeff() > 0;
    return after;
  }

  // All at once by their information H and b about q.
  Correction together(const BlockCovariance& prior, const Vector6d& moved, double information) const noexcept {
    Matrix7d H;
    Vector7d b;
    for (int i = 0; i < 7; ++i) b(i) = information * squares_(7, i);
    for (int i = 0; i < 7; ++i)
      for (int j = 0; j <= i; ++j) H(i, j) = H(j, i) = information * squares_(i, j);
    for (int j = 0; j < 7; ++j)
      for (int i = 0; i < 6; ++i) b(j) -= H(i, j) * moved(i);

    // P_qq <- (P_qq^-1 + H)^-1. The rest follows as far as it correlates with q: (I - P H) of P_vq and P_vv.
    Correction after{prior};
    auto& [P, dq, dv, good] = after;
    good = invert_lower(P.qq);
    for_lower<7>([&](int i, int j) { after.P.qq(i, j) += H(i, j); });
    good = invert_lower(P.qq) && good;
    mirror_lower(P.qq);
    const auto P_vq_H = product(prior.vq, H);
    P.vq -= product(P_vq_H, P.qq);
    for (int k = 0; k < 7; ++k)
      for (int j = 0; j < 6; ++j) P.vv.col(j) -= P.vq(j, k) * P_vq_H.col(k);
    for (int k = 0; k < 7; ++k) {
      for (int i = 0; i < 7; ++i) dq(i) += P.qq(i, k) * b(k);
      dv += b(k) * P.vq.col(k);
    }
    return after;
  }

  static Eigen::Matrix<double, 6, 7> product(const Eigen::Matrix<double, 6, 7>& A, const Matrix7d& B) noexcept {
    Eigen::Matrix<double, 6, 7> AB;
    for (int j = 0; j < 7; ++j) {
      Vector6d column = B(0, j) * A.col(0);
      for (int k = 1; k < 7; ++k) column += B(k, j) * A.col(k);
      AB.col(j) = column;
    }
    return AB;
  }

  std::array<Row, kFew> rows_{};  // the first ones
  Eigen::Matrix<double, 8, 8> squares_ =
      Eigen::Matrix<double, 8, 8>::Zero();  // lower triangle: sum of w [J; d] [J; d]^T, of more than a few
  int count_ = 0;
};

}  // namespace evmarker
