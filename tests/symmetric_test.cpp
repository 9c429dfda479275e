#include "evmarker/symmetric.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>

using namespace evmarker;

TEST_CASE_TEMPLATE("the inverse is that of a general solver, whatever the upper triangle holds", Size,
                   std::integral_constant<int, 1>, std::integral_constant<int, 3>, std::integral_constant<int, 6>,
                   std::integral_constant<int, 7>) {
  constexpr int N = Size::value;
  using Matrix = Eigen::Matrix<double, N, N>;
  std::mt19937 random(41);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 200; ++trial) {
    const Matrix root = Matrix::NullaryExpr([&] { return normal(random); });
    const Eigen::Matrix<double, N, 1> units = Eigen::Matrix<double, N, 1>::NullaryExpr(
        [&] { return std::pow(10.0, 3 * normal(random)); });  // metres beside pixels
    const Matrix scaled = root * root.transpose() + 0.1 * Matrix::Identity();
    const Matrix A = units.asDiagonal() * scaled * units.asDiagonal();
    Matrix inverse = A;
    inverse.template triangularView<Eigen::StrictlyUpper>().setConstant(std::numeric_limits<double>::quiet_NaN());
    REQUIRE(invert_lower(inverse));
    mirror_lower(inverse);
    CHECK(inverse == inverse.transpose());
    const Matrix unscaled = units.asDiagonal() * inverse * units.asDiagonal();
    const Matrix expected = Eigen::MatrixXd(scaled).fullPivLu().inverse();
    CHECK((unscaled - expected).norm() < 1e-10 * expected.norm());

    Matrix twice = A;  // back again: -(-A^-1)^-1
    REQUIRE(sweep_lower(twice));
    Matrix negative = twice;
    CHECK_FALSE(sweep_lower(negative));
    REQUIRE(sweep_lower(twice, -1));
    mirror_lower(twice);
    CHECK((units.asDiagonal().inverse() * (twice - A) * units.asDiagonal().inverse()).norm() < 1e-10 * scaled.norm());
  }
}

TEST_CASE("a matrix that is not positive definite is told") {
  const Eigen::Matrix3d indefinite{{2, 3, 0}, {3, 2, 0}, {0, 0, 1}};
  const Eigen::Matrix3d singular{{1, 1, 0}, {1, 1, 0}, {0, 0, 1}};
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (Eigen::Matrix3d A : {indefinite, singular, Eigen::Matrix3d(-Eigen::Matrix3d::Identity()),
                            Eigen::Matrix3d(Eigen::Matrix3d::Constant(nan))})
    CHECK_FALSE(invert_lower(A));
}
