#include "evmarker/kalman_measurements.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>

using evmarker::BlockCovariance;
using evmarker::BlockError;
using evmarker::KalmanMeasurements;
using evmarker::Vector6d;
using evmarker::Vector8d;

namespace {

BlockCovariance blocks(const Eigen::MatrixXd& P) {
  return {P.topLeftCorner(6, 7), P.bottomLeftCorner(6, 7), P.bottomRightCorner(6, 6), P(6, 6)};
}

}  // namespace

TEST_CASE("few or many measurements: the textbook's posterior of all thirteen states") {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  const auto matrix = [&](int rows, int columns) -> Eigen::MatrixXd {
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
  };
  KalmanMeasurements measurements;
  for (const int n :
       {0, 1, 3, 10, 11, 50, 2, 12, 32, 33, 100}) {  // the same object all the time: nothing stays from before
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
    BlockCovariance found = blocks(P0);
    BlockError error;
    error.p = moved;
    REQUIRE(measurements.correct(found, error, information));
    const Eigen::MatrixXd S = J * P0 * J.transpose() + R;
    const Eigen::MatrixXd gain = P0 * J.transpose() * S.inverse(), P = P0 - gain * J * P0;
    const Eigen::VectorXd expected = gain * innovation;
    const BlockCovariance posterior = blocks(P);
    CHECK((n == 0 || expected.norm() > 0.01));
    CHECK((error.p - moved - expected.head<6>()).norm() < 1e-9);
    CHECK(std::abs(error.o - expected(6)) < 1e-9);
    CHECK((error.v - expected.tail<6>()).norm() < 1e-9);
    CHECK((found.pq - posterior.pq).norm() < 1e-9 * P0.norm());
    CHECK((found.vq - posterior.vq).norm() < 1e-9 * P0.norm());
    CHECK((found.vv - posterior.vv).norm() < 1e-9 * P0.norm());
    CHECK(std::abs(found.oo - posterior.oo) < 1e-9 * P0.norm());
  }
}

TEST_CASE("a covariance that is none is told, by either way, and left as it was") {
  for (const int n : {1, 20}) {
    CAPTURE(n);
    KalmanMeasurements measurements;
    for (int i = 0; i < n; ++i) measurements.add(Vector8d::Unit(i % 7), 1);
    const BlockCovariance good = blocks(Eigen::MatrixXd::Identity(13, 13));
    BlockCovariance covariance = good;
    BlockError error;
    CHECK(measurements.correct(covariance, error, 1));
    CHECK(covariance.pq(0, 0) < 0.6);
    BlockCovariance bad = good;
    bad.pq(3, 3) = -1;
    covariance = bad;
    error = {};
    CHECK_FALSE(measurements.correct(covariance, error, 1));
    CHECK(covariance.pq == bad.pq);
    CHECK(covariance.vq == bad.vq);
    CHECK(covariance.vv == bad.vv);
    CHECK(covariance.oo == bad.oo);
    CHECK((error.p.isZero() && error.v.isZero() && error.o == 0));
  }
}

TEST_CASE("a measurement that is none is left out of the few") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const auto corrected = [&](bool with_bad) {
      KalmanMeasurements measurements;
      measurements.add(Vector8d::Unit(0) + 0.1 * Vector8d::Unit(7), 1);
      if (with_bad) measurements.add(bad * Vector8d::Ones(), 1);
      measurements.add(Vector8d::Unit(2) + 0.2 * Vector8d::Unit(7), 1);
      BlockCovariance P = blocks(Eigen::MatrixXd::Identity(13, 13));
      BlockError error;
      REQUIRE(measurements.correct(P, error, 1));
      CHECK(P.pq(2, 2) == doctest::Approx(0.5));
      return error.p;
    };
    REQUIRE(corrected(false)(2) == doctest::Approx(0.1));
    CHECK(corrected(true) == corrected(false));
  }
}
