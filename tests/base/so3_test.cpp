#include "evmarker/base/so3.hpp"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <random>
#include <vector>

using Eigen::Matrix3d;
using Eigen::Vector3d;
using evmarker::so3_exp;
using evmarker::so3_log;

namespace {

constexpr double kPi = std::numbers::pi;

// exp and the left Jacobian by their power series, which need no case for small angles.
Matrix3d power_series(const Vector3d& r, int offset) {
  Matrix3d k;
  k << 0, -r(2), r(1), r(2), 0, -r(0), -r(1), r(0), 0;
  Matrix3d power = Matrix3d::Identity(), sum = Matrix3d::Zero();
  double factorial = 1;
  for (int i = 2; i <= offset; ++i) factorial *= i;
  for (int i = 0; i < 60; ++i) {
    sum += power / factorial;
    power = power * k;
    factorial *= i + 1 + offset;
  }
  return sum;
}

std::vector<Vector3d> axes() {
  std::vector<Vector3d> result{Vector3d::UnitX(),  Vector3d::UnitY(),  Vector3d::UnitZ(),
                               -Vector3d::UnitX(), -Vector3d::UnitY(), -Vector3d::UnitZ()};
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 50; ++i) result.push_back(Vector3d(normal(random), normal(random), normal(random)).normalized());
  return result;
}

Matrix3d orthonormalized(const Matrix3d& R) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  evmarker::orthonormalize(T);
  return T.linear();
}

}  // namespace

TEST_CASE("exp agrees with its power series and with quaternions") {
  for (const Vector3d& axis : axes())
    for (const double angle :
         {0.0, 1e-300, 1e-12, 1e-8, 1e-5, 9.99e-3, 0.01, 0.010001, 0.5, 2.0, kPi - 1e-9, kPi, 4.0}) {
      CAPTURE(axis);
      CAPTURE(angle);
      const Matrix3d R = so3_exp(angle * axis);
      CHECK((R - power_series(angle * axis, 0)).cwiseAbs().maxCoeff() < 3e-15 * std::exp(angle));
      const Eigen::Quaterniond q(std::cos(angle / 2), std::sin(angle / 2) * axis(0), std::sin(angle / 2) * axis(1),
                                 std::sin(angle / 2) * axis(2));
      CHECK((R - q.toRotationMatrix()).cwiseAbs().maxCoeff() < 2e-15);
      CHECK((R.transpose() * R - Matrix3d::Identity()).norm() < 4e-15);
      CHECK(R.determinant() == doctest::Approx(1).epsilon(1e-14));
    }
  CHECK(so3_exp(Vector3d::Zero()) == Matrix3d::Identity());
}

TEST_CASE("exp keeps tiny rotations") {
  const Matrix3d R = so3_exp({1e-12, -2e-12, 3e-12});
  CHECK(R(2, 1) == doctest::Approx(1e-12));
  CHECK(R(0, 2) == doctest::Approx(-2e-12));
  CHECK(R(1, 0) == doctest::Approx(3e-12));
}

TEST_CASE("exp changes with its argument as the left Jacobian says") {
  constexpr double kStep = 1e-6;
  for (const Vector3d& axis : axes())
    for (const double angle : {0.0, 1e-6, 0.0099, 0.0101, 1.0, kPi - 1e-4, 3.5}) {
      CAPTURE(axis);
      CAPTURE(angle);
      const Vector3d r = angle * axis;
      Matrix3d jacobian;
      for (int i = 0; i < 3; ++i) {
        const Vector3d step = kStep * Vector3d::Unit(i);
        const Matrix3d difference = (so3_exp(r + step) - so3_exp(r - step)) / (2 * kStep) * so3_exp(r).transpose();
        jacobian.col(i) = Vector3d(difference(2, 1) - difference(1, 2), difference(0, 2) - difference(2, 0),
                                   difference(1, 0) - difference(0, 1)) /
                          2;
      }
      CHECK((jacobian - power_series(r, 1)).cwiseAbs().maxCoeff() < 1e-8);
    }
}

TEST_CASE("log gives back the rotation vector from 0 to pi") {
  for (const Vector3d& axis : axes())
    for (const double angle :
         {0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.5, 1.5, 3.0, kPi - 1e-3, kPi - 1e-6, kPi - 1e-9}) {
      CAPTURE(axis);
      CAPTURE(angle);
      const Eigen::Quaterniond q(std::cos(angle / 2), std::sin(angle / 2) * axis(0), std::sin(angle / 2) * axis(1),
                                 std::sin(angle / 2) * axis(2));
      CHECK((so3_log(so3_exp(angle * axis)) - angle * axis).norm() < 1e-14 + 1e-15 * angle);
      CHECK((so3_log(q.toRotationMatrix()) - angle * axis).norm() < 1e-14 + 1e-15 * angle);
    }
}

TEST_CASE("log at and beyond pi is the shorter way") {
  for (const Vector3d& axis : axes()) {
    CAPTURE(axis);
    const Vector3d half_turn = so3_log(2 * axis * axis.transpose() - Matrix3d::Identity());
    CHECK(half_turn.norm() == doctest::Approx(kPi).epsilon(1e-14));
    CHECK(std::abs(half_turn.dot(axis)) == doctest::Approx(kPi).epsilon(1e-14));
    for (const double angle : {kPi + 1e-6, 4.0, 6.0, 2 * kPi - 1e-6})
      CHECK((so3_log(so3_exp(angle * axis)) - (angle - 2 * kPi) * axis).norm() < 1e-13);
    for (const double angle : {1.0, 3.0, 20.0, 100.0}) CHECK(so3_log(so3_exp(angle * axis)).norm() <= kPi + 1e-15);
  }
}

TEST_CASE("geodesic angle is the angle of the relative rotation") {
  const Matrix3d R = so3_exp({0.3, -0.8, 0.5});
  for (const Vector3d& axis : axes())
    for (const double angle : {0.0, 1e-9, 0.2, 3.1}) {
      CHECK(evmarker::geodesic_angle(R, R * so3_exp(angle * axis)) == doctest::Approx(angle).epsilon(1e-6));
      CHECK(evmarker::geodesic_angle(so3_exp(angle * axis) * R, R) == doctest::Approx(angle).epsilon(1e-6));
    }
}

TEST_CASE("roll, pitch and yaw compose to the rotation") {
  const auto about = [](double angle, const Vector3d& axis) { return Eigen::AngleAxisd(angle, axis); };
  for (double roll = -3; roll < 3.1; roll += 0.75)
    for (double pitch = -1.5; pitch < 1.6; pitch += 0.5)
      for (double yaw = -3; yaw < 3.1; yaw += 0.75) {
        const Matrix3d R =
            (about(yaw, Vector3d::UnitZ()) * about(pitch, Vector3d::UnitY()) * about(roll, Vector3d::UnitX()))
                .toRotationMatrix();
        CHECK((evmarker::roll_pitch_yaw(R) - Vector3d(roll, pitch, yaw)).norm() < 1e-12);
      }
  const Matrix3d nose_up = Eigen::AngleAxisd(kPi / 2, Vector3d::UnitY()).toRotationMatrix();
  CHECK(evmarker::roll_pitch_yaw(nose_up).allFinite());
  CHECK(evmarker::roll_pitch_yaw(nose_up).y() == doctest::Approx(kPi / 2));
}

TEST_CASE("angles wrap into one turn") {
  for (int turns = -3; turns <= 3; ++turns)
    for (double angle = -3.1; angle < 3.11; angle += 0.1)
      CHECK(evmarker::wrap_angle(angle + 2 * kPi * turns) == doctest::Approx(angle).epsilon(1e-9));
  CHECK(std::abs(evmarker::wrap_angle(kPi)) == doctest::Approx(kPi));
  CHECK(evmarker::wrap_angle(kPi + 0.1) == doctest::Approx(0.1 - kPi));
}

TEST_CASE("a matrix slightly off SO(3) comes back to the nearest rotation") {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (const Vector3d& axis : axes()) {
    const Matrix3d R = so3_exp(2 * axis);
    const Matrix3d off = R + 1e-6 * Matrix3d::NullaryExpr([&] { return normal(random); });
    const Eigen::JacobiSVD<Matrix3d> svd(off, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Matrix3d nearest = svd.matrixU() * svd.matrixV().transpose();
    REQUIRE((off - nearest).norm() > 1e-7);
    CHECK((orthonormalized(off) - nearest).norm() < 1e-10);
  }
  CHECK((orthonormalized(so3_exp({1, 2, 3})) - so3_exp({1, 2, 3})).norm() < 1e-15);
}

TEST_CASE("many turns in place are one, and stay a rotation") {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << 1, 2, 3;
  const Vector3d step(1e-2, 2e-2, -1e-2);
  evmarker::turn(T, step);
  CHECK((T.linear() - so3_exp(step)).norm() < 1e-15);
  for (int i = 1; i < 100000; ++i) {
    evmarker::turn(T, step);
    evmarker::orthonormalize(T);
  }
  CHECK((T.linear() - so3_exp(100000 * step)).norm() < 1e-9);
  CHECK((T.linear().transpose() * T.linear() - Matrix3d::Identity()).norm() < 1e-14);
  CHECK(T.translation() == Vector3d(1, 2, 3));
}

TEST_CASE("products and inverses of matrices and rigid motions are Eigen's") {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Vector3d(normal(random), normal(random), normal(random)); };
  const auto motion = [&] {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = so3_exp(vector());
    T.translation() = vector();
    return T;
  };
  for (int i = 0; i < 100; ++i) {
    const Eigen::Isometry3d A = motion(), B = motion();
    CHECK(evmarker::product(A, B).isApprox(A * B, 1e-14));
    CHECK(evmarker::inverse(A).isApprox(A.inverse(), 1e-14));
    const Matrix3d a = A.linear(), b = B.linear();
    CHECK(evmarker::product(a, b).isApprox(a * b, 1e-14));
    CHECK(evmarker::transposed_product(a, b).isApprox(a.transpose() * b, 1e-14));
    CHECK(evmarker::product_with_transposed(a, b).isApprox(a * b.transpose(), 1e-14));
    const Eigen::Matrix<double, 6, 6> M = Eigen::Matrix<double, 6, 6>::NullaryExpr([&] { return normal(random); });
    const Eigen::Matrix<double, 6, 1> v = Eigen::Matrix<double, 6, 1>::NullaryExpr([&] { return normal(random); });
    CHECK(Eigen::Matrix<double, 6, 1>(evmarker::product(M, evmarker::Vec6(v))).isApprox(M * v, 1e-14));
  }
}
