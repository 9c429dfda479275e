#include "evmarker/base/cholesky.hpp"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

using evmarker::Cholesky;

TEST_CASE("Cholesky: solutions are those of Eigen, of matrices of any scale") {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (const double scale : {1e-8, 1.0, 1e9})
    for (int round = 0; round < 100; ++round) {
      Eigen::Matrix<double, 7, 7> root;
      for (double& x : root.reshaped()) x = normal(random);
      const Eigen::Matrix<double, 7, 7> A = scale * root * root.transpose();
      Eigen::Matrix<double, 7, 1> b;
      for (double& x : b) x = normal(random);

      Cholesky<7>::Matrix lower{};
      Cholesky<7>::Vector right;
      for (std::size_t k = 0; k < 7; ++k) {
        for (std::size_t i = 0; i <= k; ++i) lower[k][i] = A(static_cast<int>(k), static_cast<int>(i));
        right[k] = b(static_cast<int>(k));
      }
      const Eigen::Matrix<double, 7, 1> expected = A.fullPivLu().solve(b);
      const Cholesky<7>::Vector x = Cholesky<7>(lower).solve(right);
      const double condition = std::pow(root.norm() * root.inverse().norm(), 2);
      for (int i = 0; i < 7; ++i)
        CHECK(std::abs(x[static_cast<std::size_t>(i)] - expected(i)) < 1e-14 * condition * expected.norm());
    }
}

TEST_CASE("Cholesky: without a solution, all of it is not a number") {
  for (const double last : {-1.0, 0.5}) {  // determinants -2 and -.5
    const Cholesky<2>::Vector x = Cholesky<2>({{{1, 0}, {1, last}}}).solve({1, 1});
    CHECK(std::isnan(x[0]));
    CHECK(std::isnan(x[1]));
  }
  const Cholesky<2>::Vector x = Cholesky<2>({{{4, 0}, {2, 5}}}).solve({8, 8});
  CHECK(x[0] == doctest::Approx(1.5));
  CHECK(x[1] == doctest::Approx(1));
}
