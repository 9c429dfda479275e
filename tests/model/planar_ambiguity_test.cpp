#include "evmarker/model/planar_ambiguity.hpp"

#include <doctest/doctest.h>

#include <algorithm>

#include "evmarker/model/pose_perturbation.hpp"
#include "random_pose.hpp"

using namespace evmarker;
using Eigen::Isometry3d;
using Eigen::Vector3d;

namespace {

// A plane off the marker's origin, which it need not contain.
const ModelPlane kPlane{Vec3(0.6, 0, 0.8), Vec3(0.03, -0.05, 0.02), 0.1};

}  // namespace

TEST_CASE("the mirrored pose is rigid, tilted as much to the other side, and mirrors back") {
  SeededNumbers random(1);
  for (int i = 0; i < 100; ++i) {
    const Isometry3d T = random_pose(random, 1, 1.2), other = mirrored(T, kPlane);
    REQUIRE(is_rotation(other.linear()));
    const SeenPlane seen(T, kPlane), seen_other(other, kPlane);
    CHECK(norm(seen.centre - seen_other.centre) < 1e-12);
    CHECK(seen.tilt() == doctest::Approx(seen_other.tilt()));
    // Both normals and the direction to the camera lie in one plane, the direction in the middle.
    CHECK(dot(seen.normal, seen.to_camera) == doctest::Approx(dot(seen_other.normal, seen.to_camera)));
    CHECK(std::abs(dot(cross(seen.normal, seen.to_camera), seen_other.normal)) < 1e-12);
    CHECK(geodesic_angle(T.linear(), other.linear()) == doctest::Approx(2 * seen.tilt()));
    CHECK(mirrored(other, kPlane).isApprox(T, 1e-12));
  }
}

TEST_CASE("the images at both poses differ by the perspective only") {
  const MarkerModel square = make_square_marker(0.1);
  const auto difference_px = [&](double distance) {  // largest, for the same size in the image
    const double focal_length = 500 * distance;
    const Isometry3d T = [&] {
      Isometry3d facing = Isometry3d::Identity();
      facing.linear() = so3_exp(Vector3d(0.4, 0.2, 0)) * Eigen::DiagonalMatrix<double, 3>(1, -1, -1);
      facing.translation() = distance * Vector3d(0.1, -0.05, 1);
      return facing;
    }();
    const Isometry3d other = mirrored(T);
    double largest = 0;
    for (const Vector3d& vertex : square.vertices) {
      const Vector3d a = T * vertex, b = other * vertex;
      largest = std::max(largest, focal_length * (a.head<2>() / a.z() - b.head<2>() / b.z()).norm());
    }
    return largest;
  };
  CHECK(difference_px(1) > 0.5);
  CHECK(difference_px(1) < 2);  // of a marker of 50 px
  CHECK(difference_px(10) == doctest::Approx(difference_px(1) / 10).epsilon(0.1));
}

TEST_CASE("a motion of the mirrored pose is the derivative of mirroring") {
  SeededNumbers random(2);
  for (int i = 0; i < 20; ++i) {
    const Isometry3d T = random_pose(random, 0.7, 1.2), other = mirrored(T, kPlane);
    const Matrix6d J = mirrored_motion(T, kPlane);
    for (int k = 0; k < 6; ++k) {
      constexpr double kStep = 1e-6;
      Isometry3d moved = T;
      perturb(moved, Vector6d(kStep * Vector6d::Unit(k)));
      const Vector6d numeric = pose_difference(other, mirrored(moved, kPlane)) / kStep;
      CHECK((numeric - J.col(k)).norm() < 1e-4);
    }
  }
}

TEST_CASE("flat wireframes have a plane, others none") {
  const auto square = plane_of(make_square_marker(0.1));
  REQUIRE(square);
  CHECK(std::abs(square->normal.z) == doctest::Approx(1));
  CHECK(norm(square->centre) < 1e-12);
  CHECK(square->size == doctest::Approx(0.1));

  MarkerModel moved = make_square_marker(0.1);
  for (Vector3d& vertex : moved.vertices) vertex = so3_exp(Vector3d(0, 0.5, 0)) * vertex + Vector3d(0.3, 0, 0.1);
  const auto plane = plane_of(moved);
  REQUIRE(plane);
  CHECK(std::abs(dot(plane->normal, Vec3(so3_exp(Vector3d(0, 0.5, 0)).col(2)))) == doctest::Approx(1));
  CHECK(norm(plane->centre - Vec3(0.3, 0, 0.1)) < 1e-12);

  MarkerModel roof = make_square_marker(0.1);
  roof.vertices[0].z() += 0.01;
  CHECK_FALSE(plane_of(roof));
  CHECK_FALSE(plane_of(MarkerModel{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 1}, {1, 2}}}));
}
