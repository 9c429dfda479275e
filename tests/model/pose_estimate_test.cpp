#include "evmarker/model/pose_estimate.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>
#include <string>

#include "evmarker/model/information.hpp"

using evmarker::information;
using evmarker::Matrix6d;
using evmarker::PoseEstimate;
using evmarker::TrackingState;
using evmarker::Vector6d;

namespace {

// Of a marker at 0.5 m in metres and radians: their sizes differ by orders of magnitude.
Matrix6d some_covariance() {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Vector6d scale(1e-6, 1e-6, 1e-3, 1e-2, 1e-2, 1e-4);
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
  CHECK_FALSE(pose.covariance.has_value());
  CHECK_FALSE(pose.twist.has_value());
  CHECK(pose.quality.state == TrackingState::converging);
  CHECK(std::isnan(pose.quality.backtrack_px));
  CHECK(std::isnan(pose.quality.backtrack_rad));
  CHECK(std::isnan(pose.quality.backtrack_angle_rad));
  CHECK(information(pose) == Matrix6d::Zero());
}

TEST_CASE("the information is the inverse of the covariance") {
  PoseEstimate pose;
  pose.covariance = some_covariance();
  const Matrix6d result = information(pose);
  CHECK(result == result.transpose());
  const Vector6d scale = pose.covariance->diagonal().cwiseSqrt(), inverse = scale.cwiseInverse();
  const Matrix6d expected = (inverse.asDiagonal() * *pose.covariance * inverse.asDiagonal()).fullPivLu().inverse();
  CHECK((scale.asDiagonal() * result * scale.asDiagonal() - expected).norm() < 1e-9 * expected.norm());

  pose.covariance = Vector6d(4, 1e12, 1e-6, 25, 100, 1).asDiagonal();
  CHECK(information(pose)(0, 0) == doctest::Approx(0.25));
  CHECK(information(pose)(1, 1) == doctest::Approx(1e-12));
  CHECK(information(pose)(2, 2) == doctest::Approx(1e6));
  CHECK(information(pose)(0, 1) == 0);
}

TEST_CASE("a covariance that is none informs of nothing") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  PoseEstimate pose;
  for (const double bad : {nan, infinity, -infinity, -1.0, 0.0})
    for (int i = 0; i < 6; ++i) {
      CAPTURE(bad);
      CAPTURE(i);
      pose.covariance = some_covariance();
      (*pose.covariance)(i, i) = bad;
      if (bad == infinity) {  // of this axis alone
        CHECK(information(pose).allFinite());
        CHECK(information(pose).row(i).isZero());
      } else {
        CHECK(information(pose).isZero());
      }
      if (bad == 0) continue;
      pose.covariance = some_covariance();
      (*pose.covariance)(i, (i + 1) % 6) = (*pose.covariance)((i + 1) % 6, i) = bad * 1e18;
      CHECK(information(pose).isZero());
    }
}
