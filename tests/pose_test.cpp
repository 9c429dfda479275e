#include "evmarker/pose.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>
#include <string>

using evmarker::covariance;
using evmarker::Matrix6d;
using evmarker::PoseEstimate;
using evmarker::TrackingState;
using evmarker::Vector6d;

namespace {

// Information of metres and radians of a marker at 0.5 m: their sizes differ by orders of magnitude.
Matrix6d some_information() {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Vector6d scale(1e6, 1e6, 1e3, 1e2, 1e2, 1e4);
  const Matrix6d rows = Matrix6d::NullaryExpr([&] { return normal(random); });
  const Matrix6d full = rows.transpose() * rows + Matrix6d::Identity();
  return scale.asDiagonal() * full * scale.asDiagonal();
}

}  // namespace

TEST_CASE("states have the names of the pose table") {
  CHECK(std::string(to_string(TrackingState::converging)) == "converging");
  CHECK(std::string(to_string(TrackingState::tracking)) == "tracking");
  CHECK(std::string(to_string(TrackingState::lost)) == "lost");
}

TEST_CASE("a new estimate claims nothing") {
  const PoseEstimate pose;
  CHECK(pose.T_camera_marker.isApprox(Eigen::Isometry3d::Identity()));
  CHECK(pose.information == Matrix6d::Zero());
  CHECK_FALSE(pose.twist.has_value());
  CHECK(pose.quality.state == TrackingState::converging);
  CHECK(std::isnan(pose.quality.backtrack_px));
  CHECK(std::isnan(pose.quality.backtrack_rad));
  CHECK(std::isnan(pose.quality.backtrack_angle_rad));
  CHECK_FALSE(covariance(pose).has_value());
}

TEST_CASE("covariance is the inverse of the information") {
  PoseEstimate pose;
  pose.information = some_information();
  const auto result = covariance(pose);
  REQUIRE(result.has_value());
  CHECK((*result - result->transpose()).norm() < 1e-12 * result->norm());
  CHECK((pose.information * *result - Matrix6d::Identity()).cwiseAbs().maxCoeff() < 1e-3);  // entries up to 1e12
  const Vector6d scale = pose.information.diagonal().cwiseSqrt();
  const Matrix6d scaled = scale.asDiagonal() * *result * scale.asDiagonal();
  const Matrix6d expected =
      (scale.cwiseInverse().asDiagonal() * pose.information * scale.cwiseInverse().asDiagonal()).inverse();
  CHECK((scaled - expected).norm() < 1e-9 * expected.norm());

  pose.information = Vector6d(4, 1e12, 1e-6, 25, 100, 1).asDiagonal();
  const auto diagonal = covariance(pose);
  REQUIRE(diagonal.has_value());
  CHECK((*diagonal)(0, 0) == doctest::Approx(0.25));
  CHECK((*diagonal)(1, 1) == doctest::Approx(1e-12));
  CHECK((*diagonal)(2, 2) == doctest::Approx(1e6));
  CHECK((*diagonal)(0, 1) == 0);
}

TEST_CASE("there is no covariance while a direction is unobserved") {
  PoseEstimate pose;
  for (int i = 0; i < 6; ++i) {  // one axis
    pose.information = some_information();
    pose.information.row(i).setZero();
    pose.information.col(i).setZero();
    CHECK_FALSE(covariance(pose).has_value());
  }
  // A direction across the axes: five constraints.
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  pose.information.setZero();
  for (int i = 0; i < 5; ++i) {
    const Vector6d row = Vector6d::NullaryExpr([&] { return normal(random); });
    pose.information += row * row.transpose();
  }
  CHECK_FALSE(covariance(pose).has_value());
  const Vector6d sixth = Vector6d::NullaryExpr([&] { return normal(random); });
  pose.information += sixth * sixth.transpose();
  CHECK(covariance(pose).has_value());
}

TEST_CASE("information that is none gives no covariance and no NaN") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, infinity, -infinity, -1.0})
    for (int i = 0; i < 6; ++i) {
      CAPTURE(bad);
      CAPTURE(i);
      PoseEstimate pose;
      pose.information = some_information();
      pose.information(i, i) = bad;
      CHECK_FALSE(covariance(pose).has_value());
      pose.information = some_information();
      pose.information(i, (i + 1) % 6) = pose.information((i + 1) % 6, i) = bad * 1e18;
      CHECK_FALSE(covariance(pose).has_value());
    }
}
