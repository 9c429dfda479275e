#include "evmarker/model/start_covariance.hpp"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>

#include "evmarker/model/pose_perturbation.hpp"
#include "evmarker/simulation/trajectory.hpp"

using namespace evmarker;

namespace {

constexpr double kFocal = 533;

Eigen::Vector2d image(const Eigen::Isometry3d& T, const Eigen::Vector3d& vertex) {
  return kFocal * (T * vertex).hnormalized();
}

// Root mean square change of the vertices' images [px] over poses drawn with the covariance.
double drawn_px(const MarkerModel& model, const Eigen::Isometry3d& T, const Matrix6d& covariance) {
  const Matrix6d root = covariance.llt().matrixL();
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  double squares = 0;
  int count = 0;
  for (int i = 0; i < 4000; ++i) {
    Eigen::Isometry3d moved = T;
    // Small steps, in which the images move in proportion.
    constexpr double kStep = 1e-3;
    perturb(moved, kStep * root * Vector6d::NullaryExpr([&] { return normal(random); }));
    for (const Eigen::Vector3d& vertex : model.vertices) {
      squares += (image(moved, vertex) - image(T, vertex)).squaredNorm() / (kStep * kStep);
      ++count;
    }
  }
  return std::sqrt(squares / count);
}

}  // namespace

TEST_CASE("a start pose has its vertices so many pixels off, whatever the model, its distance and size") {
  MarkerModel cube = make_square_marker(0.1);
  for (int i = 0; i < 4; ++i)
    cube.vertices.push_back(cube.vertices[static_cast<std::size_t>(i)] + Eigen::Vector3d(0, 0, 0.1));
  for (const double scale : {0.1, 1.0, 20.0})
    for (const double sigma_px : {0.5, 2.0}) {
      MarkerModel model = cube;
      for (Eigen::Vector3d& vertex : model.vertices) vertex *= scale;
      const Eigen::Isometry3d T = facing_pose(scale * Eigen::Vector3d(0.05, 0.02, 0.3), {0.4, 0.3, 0.2});
      const Matrix6d P = start_covariance(model, kFocal, T, sigma_px);
      CHECK(P == P.transpose());
      CHECK(drawn_px(model, T, P) == doctest::Approx(sigma_px).epsilon(0.05));
    }
}

TEST_CASE("a small marker's depth is known badly, its tilt not at all: to 0.1 rad") {
  const MarkerModel marker = make_square_marker(0.1);
  const Eigen::Isometry3d near = facing_pose({0, 0, 0.25}), far = facing_pose({0, 0, 2.5});  // 213 and 21 px
  const Matrix6d P_near = start_covariance(marker, kFocal, near, 2), P_far = start_covariance(marker, kFocal, far, 2);
  CHECK(drawn_px(marker, far, P_far) < 2);
  // Corners 10.66 px from the centre along each axis, 2 px off: 6 unknowns share the 4 times 2 px, squared, evenly, and
  // a change of the depth moves all 8 coordinates.
  const double share = 2 / 10.66 * std::sqrt(4.0 / 6 / 8);
  CHECK(std::sqrt(P_far(2, 2)) == doctest::Approx(2.5 * share).epsilon(0.02));
  CHECK(std::sqrt(P_near(2, 2)) < 0.0025);
  CHECK(std::sqrt(P_far(3, 3)) == doctest::Approx(0.1).epsilon(0.02));
  CHECK(std::sqrt(P_near(3, 3)) < 0.05);
}

TEST_CASE("a pose that does not put all vertices in front of the camera has no covariance") {
  CHECK(start_covariance(make_square_marker(0.1), kFocal, facing_pose({0, 0, -0.3}), 2).isZero());
}
