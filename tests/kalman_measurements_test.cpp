#include "evmarker/kalman_measurements.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>

using evmarker::ErrorCovariance;
using evmarker::ErrorState;
using evmarker::KalmanMeasurements;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using evmarker::Vector8d;

namespace {

// Of the thirteen states [pose; offset; velocity], of which measurements tell of the first seven.
ErrorCovariance blocks(const Eigen::MatrixXd& P) {
  ErrorCovariance result;
  result.xx << P.topLeftCorner(6, 6), P.topRightCorner(6, 6), P.bottomLeftCorner(6, 6), P.bottomRightCorner(6, 6);
  result.xo << P.block(0, 6, 6, 1), P.block(7, 6, 6, 1);
  result.oo = P(6, 6);
  return result;
}

}  // namespace

TEST_CASE("few or many measurements: the textbook's posterior of all thirteen states") {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  const auto matrix = [&](int rows, int columns) -> Eigen::MatrixXd {
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
  };
  KalmanMeasurements measurements;
  for (const int n : {0, 1, 3, 4, 5, 10, 11, 50, 2, 6, 12, 13, 32, 33,
                      100}) {  // the same object all the time: nothing stays from before
    CAPTURE(n);
    const Eigen::MatrixXd root = matrix(13, 13), P0 = root * root.transpose() + Eigen::MatrixXd::Identity(13, 13);
    const Vector6d moved = matrix(6, 1);
    const double offset = normal(random);
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
      innovation(i) = row(7) - row.head<6>().dot(moved) - row(6) * offset;
    }
    CHECK(measurements.count() == n);
    ErrorCovariance found = blocks(P0);
    ErrorState error;
    error.x.head<6>() = moved;
    error.o = offset;
    REQUIRE(measurements.correct(found, error, information));
    const Eigen::MatrixXd S = J * P0 * J.transpose() + R;
    const Eigen::MatrixXd gain = P0 * J.transpose() * S.inverse(), P = P0 - gain * J * P0;
    const Eigen::VectorXd expected = gain * innovation;
    const ErrorCovariance posterior = blocks(P);
    CHECK((n == 0 || expected.norm() > 0.01));
    CHECK((error.x.head<6>() - moved - expected.head<6>()).norm() < 1e-9);
    CHECK(std::abs(error.o - offset - expected(6)) < 1e-9);
    CHECK((error.x.tail<6>() - expected.tail<6>()).norm() < 1e-9);
    CHECK((found.xx - posterior.xx).norm() < 1e-9 * P0.norm());
    CHECK((found.xo - posterior.xo).norm() < 1e-9 * P0.norm());
    CHECK(std::abs(found.oo - posterior.oo) < 1e-9 * P0.norm());
  }
}

TEST_CASE("many measurements that tell of a few directions only leave what is known of the others") {
  KalmanMeasurements measurements;
  Vector8d one, two;
  one << 1, 2, 0, 0, 0, 3, 1, 0.5;
  two << 0, 2, -1, 0, 0, 0, 1, -0.25;
  for (int i = 0; i < 30; ++i) measurements.add(i % 3 == 0 ? one : two, 2);
  ErrorCovariance P = blocks(4 * Eigen::MatrixXd::Identity(13, 13));
  ErrorState error;
  REQUIRE(measurements.correct(P, error, 1));
  // The means of ten and of twenty, each as good as all that they are the mean of.
  Eigen::Matrix<double, 2, 7> J;
  J << one.head<7>().transpose(), two.head<7>().transpose();
  const Eigen::Matrix2d S = 4 * J * J.transpose() + Eigen::Vector2d(1.0 / 20, 1.0 / 40).asDiagonal().toDenseMatrix();
  const Eigen::Matrix<double, 7, 2> gain = 4 * J.transpose() * S.inverse();
  const Eigen::Matrix<double, 7, 1> expected = gain * Eigen::Vector2d(0.5, -0.25);
  const Eigen::Matrix<double, 7, 7> left = 4 * (Eigen::Matrix<double, 7, 7>::Identity() - gain * J);
  CHECK((error.x.head<6>() - expected.head<6>()).norm() < 1e-12);
  CHECK(std::abs(error.o - expected(6)) < 1e-12);
  CHECK((P.xx.topLeftCorner<6, 6>() - left.topLeftCorner<6, 6>()).norm() < 1e-12);
  CHECK((P.xo.head<6>() - left.topRightCorner<6, 1>()).norm() < 1e-12);
  CHECK(P.xx(3, 3) == doctest::Approx(4));  // of which nothing was told
}

TEST_CASE("a covariance that is none is told, by either way, and left as it was") {
  for (const int n : {1, 20}) {
    CAPTURE(n);
    KalmanMeasurements measurements;
    for (int i = 0; i < n; ++i) measurements.add(Vector8d::Unit(i % 7), 1);
    const ErrorCovariance good = blocks(Eigen::MatrixXd::Identity(13, 13));
    ErrorCovariance covariance = good;
    ErrorState error;
    CHECK(measurements.correct(covariance, error, 1));
    CHECK(covariance.xx(0, 0) < 0.6);
    ErrorCovariance bad = good;
    bad.xx(3, 3) = -1;
    covariance = bad;
    error = {};
    CHECK_FALSE(measurements.correct(covariance, error, 1));
    CHECK(covariance.xx == bad.xx);
    CHECK(covariance.xo == bad.xo);
    CHECK(covariance.oo == bad.oo);
    CHECK((error.x.isZero() && error.o == 0));
  }
}

TEST_CASE("a measurement that is none is left out of the few") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const auto corrected = [&](bool with_bad) {
      KalmanMeasurements measurements;
      measurements.add(Vector8d::Unit(0) + 0.1 * Vector8d::Unit(7), 1);
      if (with_bad) measurements.add(bad * Vector8d::Ones(), 1);
      measurements.add(Vector8d::Unit(2) + 0.2 * Vector8d::Unit(7), 1);
      ErrorCovariance P = blocks(Eigen::MatrixXd::Identity(13, 13));
      ErrorState error;
      REQUIRE(measurements.correct(P, error, 1));
      CHECK(P.xx(2, 2) == doctest::Approx(0.5));
      return error.x;
    };
    REQUIRE(corrected(false)(2) == doctest::Approx(0.1));
    CHECK((corrected(true) - corrected(false)).norm() < 1e-15);
  }
}
