#include "evmarker/measurement_update.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <limits>
#include <random>

#include "evmarker/wide_vectors.hpp"

using evmarker::ErrorCovariance;
using evmarker::ErrorState;
using evmarker::MeasurementRows;
using evmarker::MeasurementUpdate;

namespace {

struct Problem {
  MeasurementRows rows;
  ErrorCovariance P;
  ErrorState error;
  double information = 0.7;

  explicit Problem(unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    for (std::size_t i = 0; i < MeasurementRows::kMost; ++i) {
      for (auto& numbers : rows.row) numbers[i] = normal(random);
      rows.weight[i] = 0.5 + std::abs(normal(random));
    }
    const Eigen::MatrixXd root = Eigen::MatrixXd::NullaryExpr(13, 13, [&] { return normal(random); });
    const Eigen::MatrixXd all = root * root.transpose();
    P.xx = all.topLeftCorner(12, 12);
    P.xo = all.topRightCorner(12, 1);
    P.oo = all(12, 12);
    error.x.setConstant(0.25);
    error.o = -0.5;
  }
};

// The textbook's, all at once.
void expect(Problem& problem, int first, int count) {
  Eigen::MatrixXd all(13, 13), J = Eigen::MatrixXd::Zero(count, 13), R = Eigen::MatrixXd::Zero(count, count);
  all << problem.P.xx, problem.P.xo, problem.P.xo.transpose(), problem.P.oo;
  Eigen::VectorXd state(13), innovation(count);
  state << problem.error.x, problem.error.o;
  for (int i = 0; i < count; ++i) {
    const auto place = static_cast<std::size_t>(first + i);
    for (std::size_t k = 0; k < 7; ++k) J(i, k < 6 ? static_cast<int>(k) : 12) = problem.rows.row[k][place];
    R(i, i) = 1 / (problem.information * problem.rows.weight[place]);
    innovation(i) = problem.rows.row[7][place] - J.row(i).dot(state);
  }
  const Eigen::MatrixXd gain = all * J.transpose() * (J * all * J.transpose() + R).inverse();
  state += gain * innovation;
  all -= gain * J * all;
  problem.P.xx = all.topLeftCorner(12, 12);
  problem.P.xo = all.topRightCorner(12, 1);
  problem.P.oo = all(12, 12);
  problem.error.x = state.head(12);
  problem.error.o = state(12);
}

template <std::size_t kCount>
bool take(Problem& problem, std::size_t first, bool wide) {
  if (!wide)
    return MeasurementUpdate<kCount, 128>::take(problem.rows, first, problem.information, problem.P, problem.error);
  bool taken = false;
  evmarker::in_packs([&](auto bits) __attribute__((always_inline)) {
    taken = MeasurementUpdate<kCount, bits>::take(problem.rows, first, problem.information, problem.P, problem.error);
  });
  return taken;
}

}  // namespace

TEST_CASE_TEMPLATE("measurements taken together are the textbook's, in vectors of any width", Count,
                   std::integral_constant<std::size_t, 1>, std::integral_constant<std::size_t, 2>,
                   std::integral_constant<std::size_t, 4>) {
  constexpr std::size_t kCount = Count::value;
  for (unsigned seed = 0; seed < 20; ++seed)
    for (const bool wide : {false, true}) {
      CAPTURE(wide);
      const std::size_t first = seed % 8;
      Problem expected(seed), found(seed);
      const Problem before(seed);
      expect(expected, static_cast<int>(first), static_cast<int>(kCount));
      REQUIRE((expected.error.x - before.error.x).norm() > 0.01);
      REQUIRE(take<kCount>(found, first, wide));
      CHECK((found.error.x - expected.error.x).norm() < 1e-10);
      CHECK(std::abs(found.error.o - expected.error.o) < 1e-10);
      CHECK((found.P.xx - expected.P.xx).norm() < 1e-11 * before.P.xx.norm());
      CHECK((found.P.xo - expected.P.xo).norm() < 1e-11 * before.P.xx.norm());
      CHECK(std::abs(found.P.oo - expected.P.oo) < 1e-11 * before.P.xx.norm());
    }
}

TEST_CASE("measurements that cannot be taken change nothing") {
  const auto refuses = [](auto spoil) {
    for (const bool wide : {false, true}) {
      Problem problem(1);
      spoil(problem);
      const Problem before = problem;
      CHECK_FALSE(take<4>(problem, 0, wide));
      CHECK(problem.P.xx == before.P.xx);
      CHECK(problem.P.xo == before.P.xo);
      CHECK(problem.P.oo == before.P.oo);
      CHECK(problem.error.x == before.error.x);
      CHECK(problem.error.o == before.error.o);
    }
  };
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, infinity, -infinity})
    for (std::size_t place = 0; place < 8; ++place)
      for (std::size_t i = 0; i < 4; ++i) refuses([&](Problem& problem) { problem.rows.row[place][i] = bad; });
  refuses([&](Problem& problem) { problem.P.xx(3, 3) = -1; });
  refuses([&](Problem& problem) { problem.P.oo = -1; });
  refuses([&](Problem& problem) { problem.rows.weight[2] = -1e-9; });
}
