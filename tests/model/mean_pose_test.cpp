#include "evmarker/model/mean_pose.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

#include "evmarker/base/so3.hpp"
#include "message_of.hpp"
#include "random_pose.hpp"

using namespace evmarker;
using Eigen::Isometry3d;

namespace {

const Vector6d kSigma = 1e-3 * Vector6d(0.2, 0.3, 3, 20, 15, 2);

// Poses about `truth` whose errors last for `lasting` of them; some are far off.
PoseAverage average_of(const Isometry3d& truth, unsigned seed, int count, int lasting, double share_wrong,
                       bool with_covariance) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  PoseAverage average;
  Vector6d by = Vector6d::Zero();
  for (int i = 0; i < count; ++i) {
    const bool wrong = uniform(random) < share_wrong;
    // Every other error is five times as large, and said to be.
    const double size = i % 2 == 0 ? 1 : 5;
    if (i % lasting == 0) by = Vector6d::NullaryExpr([&] { return normal(random); });
    PoseEstimate pose{.T_camera_marker = truth, .quality = {}};
    pose.T_camera_marker.translation() += size * kSigma.cwiseProduct(by).head<3>();
    pose.T_camera_marker.linear() = so3_exp(size * kSigma.cwiseProduct(by).tail<3>()) * truth.linear();
    if (wrong) pose.T_camera_marker.rotate(Eigen::AngleAxisd(1.2, Eigen::Vector3d::UnitX()));
    if (with_covariance) pose.covariance = (size * kSigma).cwiseAbs2().asDiagonal();
    average.add(pose);
  }
  return average;
}

Vector6d error_in_sigmas(const MeanPose& mean, const Isometry3d& truth) {
  Vector6d by = Vector6d::Zero();
  by << mean.T.translation() - truth.translation(), so3_log(mean.T.linear() * truth.linear().transpose());
  return by.cwiseQuotient(mean.covariance.diagonal().cwiseSqrt());
}

}  // namespace

TEST_CASE("a mean is as far from the truth as its covariance says, whether errors last or some poses are wrong") {
  SeededNumbers random(3);
  const Isometry3d truth = random_pose(random, 0.6, 0.8);
  for (const auto& errors : {std::pair{1, 0.0}, std::pair{20, 0.0}, std::pair{1, 0.25}}) {
    const auto [lasting, wrong] = errors;
    double squares = 0;
    constexpr int kSeeds = 200;
    for (unsigned seed = 0; seed < kSeeds; ++seed) {
      const MeanPose mean = average_of(truth, seed, 2000, lasting, wrong, true).mean();
      squares += error_in_sigmas(mean, truth).squaredNorm() / (6 * kSeeds);
    }
    CAPTURE(errors.first);
    CAPTURE(errors.second);
    CHECK(std::sqrt(squares) == doctest::Approx(1).epsilon(0.15).scale(0));
  }
}

TEST_CASE("covariances give certain poses more weight, and the spread is that of the poses, not of the wrong ones") {
  SeededNumbers random(4);
  const Isometry3d truth = random_pose(random, 0.6, 0.8);
  double with = 0, without = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    const MeanPose weighted = average_of(truth, seed, 500, 1, 0.1, true).mean();
    const MeanPose alike = average_of(truth, seed, 500, 1, 0.1, false).mean();
    with += (weighted.T.translation() - truth.translation()).squaredNorm();
    without += (alike.T.translation() - truth.translation()).squaredNorm();
    CHECK(weighted.poses == 500);
    // Of poses with 3 and 15 mm of depth error, half each, of which the loss counts the farther ones less.
    CHECK(weighted.spread_m > 3e-3);
    CHECK(weighted.spread_m < 12e-3);
    CHECK(alike.spread_rad < 0.09);
    CHECK((alike.T.translation() - truth.translation()).norm() < 2e-3);
  }
  CHECK(with < 0.7 * without);
}

TEST_CASE("the mean of one pose is that pose, of unknown certainty, and of none there is no mean") {
  PoseAverage average;
  CHECK(message_of([&] { (void)average.mean(); }) == "mean of no poses");
  SeededNumbers random(5);
  const Isometry3d only = random_pose(random, 0.6, 0.8);
  average.add({.T_camera_marker = only, .quality = {}});
  CHECK(average.mean().T.isApprox(only, 1e-12));
  CHECK(std::isinf(average.mean().covariance(0, 0)));
}
