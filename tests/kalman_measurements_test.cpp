#include "evmarker/kalman_measurements.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <random>

using evmarker::BlockCovariance;
using evmarker::KalmanMeasurements;
using evmarker::Vector6d;
using evmarker::Vector8d;

namespace {

BlockCovariance blocks(const Eigen::MatrixXd& P) {
  BlockCovariance covariance;
  covariance.qq = P.topLeftCorner(7, 7);
  covariance.vq = P.bottomLeftCorner(6, 7);
  covariance.vv = P.bottomRightCorner(6, 6);
  return covariance;
}

}  // namespace

TEST_CASE("few or many measurements: the textbook's posterior of all thirteen states") {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  const auto matrix = [&](int rows, int columns) -> Eigen::MatrixXd {
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
  };
  KalmanMeasurements measurements;
  for (const int n : {0, 1, 3, 10, 11, 50, 2, 12}) {  // the same object all the time: nothing stays from before
    CAPTURE(n);
    const Eigen::MatrixXd root = matrix(13, 13), P0 = root * root.transpose() + Eigen::MatrixXd::Identity(13, 13);
    const Vector6d moved = matrix(6, 1);
    const double information = 0.7;
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(n, 13), R = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd innovation(n);
    measurements.clear();
    for (int i = 0; i < n; ++i) {
      const Vector8d row = matrix(8, 1);
      const double weight = 0.5 + std::abs(normal(random));
      measurements.add(row, weight);
      J.row(i).head(7) = row.head<7>();
      R(i, i) = 1 / (information * weight);
      innovation(i) = row(7) - row.head<6>().dot(moved);
    }
    CHECK(measurements.count() == n);
    const auto found = measurements.correction(blocks(P0), moved, information);
    const Eigen::MatrixXd S = J * P0 * J.transpose() + R;
    const Eigen::MatrixXd gain = P0 * J.transpose() * S.inverse(), P = P0 - gain * J * P0;
    const Eigen::VectorXd expected = gain * innovation;
    const BlockCovariance posterior = blocks(P);
    REQUIRE(found.good);
    CHECK((n == 0 || expected.norm() > 0.01));
    CHECK((found.dq - expected.head<7>()).norm() < 1e-9);
    CHECK((found.dv - expected.tail<6>()).norm() < 1e-9);
    CHECK((found.P.qq - posterior.qq).norm() < 1e-9 * P0.norm());
    CHECK((found.P.vq - posterior.vq).norm() < 1e-9 * P0.norm());
    CHECK((found.P.vv - posterior.vv).norm() < 1e-9 * P0.norm());
  }
}

TEST_CASE("a covariance that is none is not good, by either way") {
  for (const int n : {1, 20}) {
    KalmanMeasurements measurements;
    for (int i = 0; i < n; ++i) measurements.add(Vector8d::Unit(i % 7), 1);
    BlockCovariance covariance = blocks(Eigen::MatrixXd::Identity(13, 13));
    CHECK(measurements.correction(covariance, Vector6d::Zero(), 1).good);
    covariance.qq(3, 3) = -1;
    CHECK_FALSE(measurements.correction(covariance, Vector6d::Zero(), 1).good);
  }
}
