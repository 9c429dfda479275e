#include "evmarker/update/kalman_measurements.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <limits>
#include <random>

using evmarker::ErrorCovariance;
using evmarker::ErrorState;
using evmarker::KalmanMeasurements;
using evmarker::kBiases;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using evmarker::MeasurementRow;

namespace {

constexpr int kMeasured = 6 + static_cast<int>(kBiases), kStates = kMeasured + 6;
using Row = Eigen::Matrix<double, kMeasured + 1, 1>;

MeasurementRow measurement(const Row& row) {
  MeasurementRow result;
  std::copy(row.begin(), row.end(), result.begin());
  return result;
}

// Of the states [pose; biases; velocity], of which measurements tell of pose and biases.
ErrorCovariance blocks(const Eigen::MatrixXd& P) {
  ErrorCovariance result;
  result.xx << P.topLeftCorner(6, 6), P.topRightCorner(6, 6), P.bottomLeftCorner(6, 6), P.bottomRightCorner(6, 6);
  for (int b = 0; b < static_cast<int>(kBiases); ++b) {
    const auto place = static_cast<std::size_t>(b);
    result.xb[place] << P.block(0, 6 + b, 6, 1), P.block(kMeasured, 6 + b, 6, 1);
    for (int c = 0; c < static_cast<int>(kBiases); ++c) result.bb[place][static_cast<std::size_t>(c)] = P(6 + b, 6 + c);
  }
  return result;
}

}  // namespace

TEST_CASE("few or many measurements: the textbook's posterior of all states") {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  const auto matrix = [&](int rows, int columns) -> Eigen::MatrixXd {
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
  };
  KalmanMeasurements measurements;
  for (const int n : {0, 1, 3, 4, 5, 10, 11, 50, 2, 6, 12, 13, 32, 33,
                      100}) {  // the same object all the time: nothing stays from before
    CAPTURE(n);
    const Eigen::MatrixXd root = matrix(kStates, kStates),
                          P0 = root * root.transpose() + Eigen::MatrixXd::Identity(kStates, kStates);
    const Vector6d moved = matrix(6, 1);
    const Eigen::VectorXd biases = matrix(kBiases, 1);
    const double information = 0.7;
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(n, kStates), R = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd innovation(n);
    measurements.clear();
    for (int i = 0; i < n; ++i) {
      const Row row = matrix(kMeasured + 1, 1);
      const double weight = 0.5 + std::abs(normal(random));
      measurements.add(measurement(row), weight);
      J.row(i).head<kMeasured>() = row.head<kMeasured>();
      R(i, i) = 1 / (information * weight);
      innovation(i) = row(kMeasured) - row.head<6>().dot(moved) - row.segment<kBiases>(6).dot(biases);
    }
    CHECK(measurements.count() == n);
    ErrorCovariance found = blocks(P0);
    ErrorState error;
    error.x.head<6>() = moved;
    for (std::size_t b = 0; b < kBiases; ++b) error.b[b] = biases(static_cast<Eigen::Index>(b));
    REQUIRE(measurements.correct(found, error, information));
    const Eigen::MatrixXd S = J * P0 * J.transpose() + R;
    const Eigen::MatrixXd gain = P0 * J.transpose() * S.inverse(), P = P0 - gain * J * P0;
    const Eigen::VectorXd expected = gain * innovation;
    const ErrorCovariance posterior = blocks(P);
    CHECK((n == 0 || expected.norm() > 0.01));
    CHECK((error.x.head<6>() - moved - expected.head<6>()).norm() < 1e-9);
    CHECK((error.x.tail<6>() - expected.tail<6>()).norm() < 1e-9);
    CHECK((found.xx - posterior.xx).norm() < 1e-9 * P0.norm());
    for (std::size_t b = 0; b < kBiases; ++b) {
      const auto place = static_cast<Eigen::Index>(b);
      CHECK(std::abs(error.b[b] - biases(place) - expected(6 + place)) < 1e-9);
      CHECK((found.xb[b] - posterior.xb[b]).norm() < 1e-9 * P0.norm());
      for (std::size_t c = 0; c < kBiases; ++c) CHECK(std::abs(found.bb[b][c] - posterior.bb[b][c]) < 1e-9 * P0.norm());
    }
  }
}

TEST_CASE("many measurements that tell of a few directions only leave what is known of the others") {
  KalmanMeasurements measurements;
  Row one, two;  // both ON
  one << 1, 2, 0, 0, 0, 3, 1, -1, 0.5, 0.5;
  two << 0, 2, -1, 0, 0, 0, 1, -1, 0.5, -0.25;
  for (int i = 0; i < 30; ++i) measurements.add(measurement(i % 3 == 0 ? one : two), 2);
  ErrorCovariance P = blocks(4 * Eigen::MatrixXd::Identity(kStates, kStates));
  ErrorState error;
  REQUIRE(measurements.correct(P, error, 1));
  // The means of ten and of twenty, each as good as all that they are the mean of.
  Eigen::Matrix<double, 2, kMeasured> J;
  J << one.head<kMeasured>().transpose(), two.head<kMeasured>().transpose();
  const Eigen::Matrix2d S = 4 * J * J.transpose() + Eigen::Vector2d(1.0 / 20, 1.0 / 40).asDiagonal().toDenseMatrix();
  const Eigen::Matrix<double, kMeasured, 2> gain = 4 * J.transpose() * S.inverse();
  const Eigen::Matrix<double, kMeasured, 1> expected = gain * Eigen::Vector2d(0.5, -0.25);
  const Eigen::Matrix<double, kMeasured, kMeasured> left =
      4 * (Eigen::Matrix<double, kMeasured, kMeasured>::Identity() - gain * J);
  CHECK((error.x.head<6>() - expected.head<6>()).norm() < 1e-12);
  CHECK((P.xx.topLeftCorner<6, 6>() - left.topLeftCorner<6, 6>()).norm() < 1e-12);
  for (int b = 0; b < static_cast<int>(kBiases); ++b) {
    const auto place = static_cast<std::size_t>(b);
    CHECK(std::abs(error.b[place] - expected(6 + b)) < 1e-12);
    CHECK((P.xb[place].head<6>() - left.block<6, 1>(0, 6 + b)).norm() < 1e-12);
    for (std::size_t c = 0; c < kBiases; ++c)
      CHECK(std::abs(P.bb[place][c] - left(6 + b, 6 + static_cast<int>(c))) < 1e-12);
  }
  // ON events alone tell only the difference of offset and trail.
  CHECK(P.bb[0][0] > 1);
  CHECK(P.bb[0][0] + P.bb[1][1] - 2 * P.bb[0][1] < 0.99 * 8);
  CHECK(P.xx(3, 3) == doctest::Approx(4));  // of which nothing was told
}

TEST_CASE("a covariance that is none is told, by either way, and left as it was") {
  for (const int n : {1, 20}) {
    CAPTURE(n);
    KalmanMeasurements measurements;
    for (int i = 0; i < n; ++i) measurements.add(measurement(Row::Unit(i % kMeasured)), 1);
    const ErrorCovariance good = blocks(Eigen::MatrixXd::Identity(kStates, kStates));
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
    CHECK(covariance.xb == bad.xb);
    CHECK(covariance.bb == bad.bb);
    CHECK((error.x.isZero() && error.b == std::array<double, kBiases>{}));
  }
}

TEST_CASE("a measurement that is none is left out of the few") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const auto corrected = [&](bool with_bad) {
      KalmanMeasurements measurements;
      measurements.add(measurement(Row::Unit(0) + 0.1 * Row::Unit(kMeasured)), 1);
      if (with_bad) measurements.add(measurement(bad * Row::Ones()), 1);
      measurements.add(measurement(Row::Unit(2) + 0.2 * Row::Unit(kMeasured)), 1);
      ErrorCovariance P = blocks(Eigen::MatrixXd::Identity(kStates, kStates));
      ErrorState error;
      REQUIRE(measurements.correct(P, error, 1));
      CHECK(P.xx(2, 2) == doctest::Approx(0.5));
      return error.x;
    };
    REQUIRE(corrected(false)(2) == doctest::Approx(0.1));
    CHECK((corrected(true) - corrected(false)).norm() < 1e-15);
  }
}
