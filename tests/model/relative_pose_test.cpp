#include "evmarker/model/relative_pose.hpp"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <random>

#include "evmarker/base/so3.hpp"
#include "random_pose.hpp"

using namespace evmarker;
using Eigen::Isometry3d;

namespace {

// Motion of a body by constant rates of the perturbation: translation of its origin, rotation about it.
Isometry3d after(const Isometry3d& T, const Vector6d& rate, double seconds) {
  Isometry3d moved = T;
  moved.translation() += seconds * rate.head<3>();
  moved.linear() = so3_exp(seconds * rate.tail<3>()) * T.linear();
  return moved;
}

Vector6d perturbation(const Isometry3d& from, const Isometry3d& to) {
  Vector6d by;
  by << to.translation() - from.translation(), so3_log(to.linear() * from.linear().transpose());
  return by;
}

PoseEstimate some_estimate(MarkerId id, unsigned seed) {
  SeededNumbers random(seed);
  PoseEstimate pose{.id = id, .t = 5000, .T_camera_marker = random_pose(random, 0.6, 0.8), .quality = {}};
  Matrix6d root = Matrix6d::NullaryExpr([&] { return random(-1, 1); });
  const Vector6d scale = 1e-3 * Vector6d(0.2, 0.2, 2, 10, 10, 1);
  pose.covariance = scale.asDiagonal() * (root * root.transpose()) * scale.asDiagonal();
  pose.twist = Vector6d::NullaryExpr([&] { return random(-2, 2); });
  pose.quality.state = TrackingState::tracking;
  pose.quality.health = 0.9;
  return pose;
}

// Draws poses by their covariances and compares the scatter of what is made of them.
void check_covariance(const PoseEstimate& a, const PoseEstimate& b, const PoseEstimate& result,
                      const std::function<Isometry3d(const Isometry3d&, const Isometry3d&)>& combine) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto drawn = [&](const PoseEstimate& pose) {
    const Vector6d by = Eigen::LLT<Matrix6d>(*pose.covariance).matrixL() *
                        Vector6d(Vector6d::NullaryExpr([&] { return normal(random); }));
    return after(pose.T_camera_marker, by, 1);
  };
  constexpr int kDraws = 40000;
  Matrix6d scatter = Matrix6d::Zero();
  for (int i = 0; i < kDraws; ++i) {
    const Isometry3d T_a = drawn(a), T_b = drawn(b);
    const Vector6d by = perturbation(result.T_camera_marker, combine(T_a, T_b));
    scatter += by * by.transpose() / kDraws;
  }
  const Vector6d sigma = scatter.diagonal().cwiseSqrt();
  const Matrix6d difference = *result.covariance - scatter;
  for (int i = 0; i < 6; ++i)
    for (int k = 0; k < 6; ++k) CHECK(std::abs(difference(i, k)) < 0.03 * sigma(i) * sigma(k));
}

}  // namespace

TEST_CASE("the inverse of a pose is the camera's: pose, velocity by differentiation, covariance by Monte Carlo") {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const PoseEstimate pose = some_estimate(7, seed), camera = inverse(pose);
    CHECK((pose.T_camera_marker * camera.T_camera_marker).isApprox(Isometry3d::Identity(), 1e-12));
    CHECK(camera.id == 7);
    CHECK(camera.t == 5000);
    CHECK(camera.quality.health == 0.9);
    const auto at = [&](double s) { return after(pose.T_camera_marker, *pose.twist, s).inverse(); };
    constexpr double kStep = 1e-5;
    const Vector6d rate = perturbation(at(-kStep), at(kStep)) / (2 * kStep);
    CHECK((rate - *camera.twist).norm() < 1e-6);
    check_covariance(pose, pose, camera, [](const Isometry3d& T, const Isometry3d&) { return T.inverse(); });
    CHECK((*inverse(camera).covariance - *pose.covariance).norm() < 1e-9 * pose.covariance->norm());
    CHECK((*inverse(camera).twist - *pose.twist).norm() < 1e-9);
  }
}

TEST_CASE("the pose of one marker in the other's frame, its velocity and its covariance") {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const PoseEstimate a = some_estimate(1, seed), b = some_estimate(2, seed + 100), result = relative_pose(a, b);
    CHECK((a.T_camera_marker * result.T_camera_marker).isApprox(b.T_camera_marker, 1e-12));
    CHECK(result.id == 2);
    CHECK(result.t == b.t);
    CHECK(result.quality.state == TrackingState::tracking);
    CHECK(result.quality.health == doctest::Approx(0.81));
    const auto at = [&](double s) {
      return Isometry3d(after(a.T_camera_marker, *a.twist, s).inverse() * after(b.T_camera_marker, *b.twist, s));
    };
    constexpr double kStep = 1e-5;
    const Vector6d rate = perturbation(at(-kStep), at(kStep)) / (2 * kStep);
    CHECK((rate - *result.twist).norm() < 1e-6);
    check_covariance(a, b, result,
                     [](const Isometry3d& T_a, const Isometry3d& T_b) { return Isometry3d(T_a.inverse() * T_b); });
  }
}

TEST_CASE("a relative pose is only as good as the worse of both, and claims no more than both") {
  PoseEstimate a = some_estimate(1, 1), b = some_estimate(2, 2);
  for (const auto [of_a, of_b, of_both] :
       {std::array{TrackingState::tracking, TrackingState::converging, TrackingState::converging},
        std::array{TrackingState::lost, TrackingState::tracking, TrackingState::lost},
        std::array{TrackingState::lost, TrackingState::converging, TrackingState::lost},
        std::array{TrackingState::converging, TrackingState::lost, TrackingState::lost}}) {
    a.quality.state = of_a;
    b.quality.state = of_b;
    CHECK(relative_pose(a, b).quality.state == of_both);
    CHECK(relative_pose(b, a).quality.state == of_both);
  }
  b.covariance.reset();
  b.twist.reset();
  CHECK_FALSE(relative_pose(a, b).covariance);
  CHECK_FALSE(relative_pose(a, b).twist);
  CHECK_FALSE(inverse(b).covariance);
}
