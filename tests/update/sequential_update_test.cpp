#include "evmarker/update/sequential_update.hpp"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <limits>
#include <random>

#include "evmarker/simd/wide_vectors.hpp"

using evmarker::ErrorCovariance;
using evmarker::ErrorState;
using evmarker::kBiases;
using evmarker::MeasurementRows;
using evmarker::SequentialUpdate;
namespace simd = evmarker::simd;

namespace {

constexpr Eigen::Index kStates = 12 + kBiases;  // [x; b]

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
    const Eigen::MatrixXd root = Eigen::MatrixXd::NullaryExpr(kStates, kStates, [&] { return normal(random); });
    set_covariance(root * root.transpose());
    error.x.setConstant(0.25);
    error.b = {-0.5, 0.75, 0.5};
  }

  // Of [x; b].
  void set_covariance(const Eigen::MatrixXd& all) {
    P.xx = all.topLeftCorner(12, 12);
    for (std::size_t b = 0; b < kBiases; ++b) {
      const auto i = static_cast<Eigen::Index>(12 + b);
      P.xb[b] = all.block(0, i, 12, 1);
      for (std::size_t c = 0; c < kBiases; ++c) P.bb[b][c] = all(i, static_cast<Eigen::Index>(12 + c));
    }
  }
};

// The textbook's, all at once.
void expect(Problem& problem, int first, int count) {
  Eigen::MatrixXd all(kStates, kStates), J = Eigen::MatrixXd::Zero(count, kStates),
                                         R = Eigen::MatrixXd::Zero(count, count);
  const ErrorCovariance& P = problem.P;
  Eigen::VectorXd state(kStates), innovation(count);
  all.topLeftCorner(12, 12) = P.xx;
  state.head(12) = problem.error.x;
  for (std::size_t b = 0; b < kBiases; ++b) {
    const auto i = static_cast<Eigen::Index>(12 + b);
    all.block(0, i, 12, 1) = P.xb[b];
    all.block(i, 0, 1, 12) = P.xb[b].transpose();
    for (std::size_t c = 0; c < kBiases; ++c) all(i, static_cast<Eigen::Index>(12 + c)) = P.bb[b][c];
    state(i) = problem.error.b[b];
  }
  for (int i = 0; i < count; ++i) {
    const auto place = static_cast<std::size_t>(first + i);
    for (std::size_t k = 0; k < MeasurementRows::kStates; ++k)
      J(i, static_cast<int>(k < 6 ? k : 6 + k)) = problem.rows.row[k][place];
    R(i, i) = 1 / (problem.information * problem.rows.weight[place]);
    innovation(i) = problem.rows.row[MeasurementRows::kStates][place] - J.row(i).dot(state);
  }
  const Eigen::MatrixXd gain = all * J.transpose() * (J * all * J.transpose() + R).inverse();
  state += gain * innovation;
  all -= gain * J * all;
  problem.set_covariance(all);
  problem.error.x = state.head(12);
  for (std::size_t b = 0; b < kBiases; ++b) problem.error.b[b] = state(static_cast<Eigen::Index>(12 + b));
}

template <std::size_t kCount>
bool take(Problem& problem, std::size_t first, bool wide) {
  if (!wide)
    return SequentialUpdate<kCount, 128>::apply(problem.rows, first, problem.information, problem.P, problem.error);
  bool taken = false;
  simd::in_packs([&](auto bits) __attribute__((always_inline)) {
    taken = SequentialUpdate<kCount, bits>::apply(problem.rows, first, problem.information, problem.P, problem.error);
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
      CHECK((found.P.xx - expected.P.xx).norm() < 1e-11 * before.P.xx.norm());
      for (std::size_t b = 0; b < kBiases; ++b) {
        REQUIRE(std::abs(expected.error.b[b] - before.error.b[b]) > 1e-4);
        CHECK(std::abs(found.error.b[b] - expected.error.b[b]) < 1e-10);
        CHECK((found.P.xb[b] - expected.P.xb[b]).norm() < 1e-11 * before.P.xx.norm());
        for (std::size_t c = 0; c < kBiases; ++c)
          CHECK(std::abs(found.P.bb[b][c] - expected.P.bb[b][c]) < 1e-11 * before.P.xx.norm());
      }
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
      CHECK(problem.P.xb == before.P.xb);
      CHECK(problem.P.bb == before.P.bb);
      CHECK(problem.error.x == before.error.x);
      CHECK(problem.error.b == before.error.b);
    }
  };
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, infinity, -infinity})
    for (std::size_t place = 0; place < MeasurementRows::kNumbers; ++place)
      for (std::size_t i = 0; i < 4; ++i) refuses([&](Problem& problem) { problem.rows.row[place][i] = bad; });
  refuses([&](Problem& problem) { problem.P.xx(3, 3) = -1; });
  for (std::size_t b = 0; b < kBiases; ++b) refuses([&](Problem& problem) { problem.P.bb[b][b] = -1; });
  refuses([&](Problem& problem) { problem.rows.weight[2] = -1e-9; });
  // A bias that correlates with the pose by more than its variance allows: S stays positive, what is left of the
  // variance does not.
  for (std::size_t b = 0; b < kBiases; ++b)
    refuses([&](Problem& problem) {
      problem.P.bb[b][b] = 1e-9;
      problem.rows.row[6 + b].fill(0);
    });
}
