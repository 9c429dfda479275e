#include "evmarker/update/edge_scatter.hpp"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

using namespace evmarker;

namespace {

using Row7 = Eigen::Matrix<double, 7, 1>;

EdgeScatter::Row as_array(const Row7& row) {
  EdgeScatter::Row all;
  Eigen::Map<Row7>(all.data()) = row;
  return all;
}

// Edges of a body that all have their own row, a 7th of the events each.
std::vector<Row7> rows_of_edges(int edges, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::vector<Row7> rows(static_cast<std::size_t>(edges));
  for (Row7& row : rows) {
    for (int i = 0; i < 6; ++i) row(i) = 100 * normal(random);
    row(6) = 1;
  }
  return rows;
}

}  // namespace

TEST_CASE("edge scatter: the covariance is that of poses fitted to edges that err") {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  constexpr double kSigma_px = 0.05;
  const std::vector<Row7> rows = rows_of_edges(40, random);
  Eigen::Matrix<double, 7, 7> H = Eigen::Matrix<double, 7, 7>::Zero();
  for (const Row7& row : rows) H += row * row.transpose();
  const Eigen::LDLT<Eigen::Matrix<double, 7, 7>> solver(H);
  // Truth: the poses that a least squares fit finds for 3000 draws of the edges' errors.
  Matrix6d truth = Matrix6d::Zero();
  for (int draw = 0; draw < 3000; ++draw) {
    Row7 b = Row7::Zero();
    for (const Row7& row : rows) b += kSigma_px * normal(random) * row;
    const Vector6d pose = solver.solve(b).head<6>();
    truth += pose * pose.transpose() / 3000;
  }
  EdgeScatter scatter;
  CHECK(scatter.covariance() == Matrix6d::Zero());
  for (int evaluation = 0; evaluation < 40; ++evaluation) {
    for (std::size_t edge = 0; edge < rows.size(); ++edge) {
      const double shared = kSigma_px * normal(random);
      for (int event = 0; event < 100; ++event) {
        const double residual = shared + 0.1 * normal(random);
        scatter.add(static_cast<int>(edge), residual, 0.7);
        if (event % 8 == 0) scatter.add_row(as_array(rows[edge]), residual, 0.7);
      }
    }
    scatter.evaluate();
  }
  CHECK(std::sqrt(scatter.variance_px2()) == doctest::Approx(kSigma_px).epsilon(0.1).scale(0));
  const Matrix6d ratio = scatter.covariance() * truth.inverse();
  CHECK(ratio.trace() / 6 == doctest::Approx(1).epsilon(0.2).scale(0));
  CHECK(scatter.share_of_known_dark_sides() == doctest::Approx(1));
}

TEST_CASE("edge scatter: errors of single events average out, those of edges do not") {
  const auto scatter_of = [](double shared_px, int events) {
    std::mt19937 random(6);
    std::normal_distribution<double> normal;
    const std::vector<Row7> rows = rows_of_edges(20, random);
    EdgeScatter scatter;
    for (std::size_t edge = 0; edge < rows.size(); ++edge)
      for (int event = 0; event < events; ++event) {
        const double residual = (edge % 2 == 0 ? 1 : -1) * shared_px + 0.5 * normal(random);
        scatter.add(static_cast<int>(edge), residual, 1);
        scatter.add_row(as_array(rows[edge]), residual, 1);
      }
    scatter.evaluate();
    return scatter.variance_px2();
  };
  CHECK(scatter_of(0, 1000) < 0.5 * 0.25 / 1000);  // their noise is taken out
  CHECK(scatter_of(0, 10000) < 0.5 * 0.25 / 10000);
  CHECK(scatter_of(0.1, 1000) == doctest::Approx(0.01).epsilon(0.1).scale(0));
  CHECK(scatter_of(0.1, 10000) == doctest::Approx(0.01).epsilon(0.1).scale(0));
}

TEST_CASE("edge scatter: how much the noise of events averages out, beside edges that are off") {
  // @param residual of the event i of an edge
  const auto noise_of = [](double shared_px, auto residual) {
    std::mt19937 random(8);
    const std::vector<Row7> rows = rows_of_edges(20, random);
    EdgeScatter scatter;
    CHECK(scatter.event_noise() == 1);
    for (int motion = 0; motion < 40; ++motion) {
      for (const bool second : {false, true}) {
        CHECK(scatter.in_second_half() == second);
        for (std::size_t edge = 0; edge < rows.size(); ++edge)
          for (int event = 0; event < 60; ++event) {
            const double r = (edge % 2 == 0 ? 1 : -1) * shared_px + residual(event, random);
            scatter.add(static_cast<int>(edge), r, 0.7);
            scatter.add_row(as_array(rows[edge]), r, 0.7);
          }
        if (!second) scatter.end_first_half();
      }
      scatter.evaluate();
    }
    CHECK(scatter.variance_px2() == doctest::Approx(shared_px * shared_px).epsilon(0.1).scale(1e-3));
    return scatter.event_noise();
  };
  std::normal_distribution<double> normal(0, 0.5);
  const auto independent = [&](int, auto& random) { return normal(random); };
  CHECK(noise_of(0, independent) == doctest::Approx(1).epsilon(0.1));
  CHECK(noise_of(0.1, independent) == doctest::Approx(1).epsilon(0.1));
  double latest = 0;
  const auto by_fours = [&](int event, auto& random) { return event % 4 == 0 ? latest = normal(random) : latest; };
  CHECK(noise_of(0.1, by_fours) == doctest::Approx(4).epsilon(0.1));
  // As they lie on an ideal edge.
  const auto even = [&](int event, auto&) { return event % 20 / 20.0 - 0.475; };
  CHECK(noise_of(0.1, even) < 1e-6);
}

TEST_CASE("edge scatter: without events, or with edges that leave a direction open, it stays as it was") {
  EdgeScatter scatter;
  scatter.evaluate();
  CHECK(scatter.covariance() == Matrix6d::Zero());
  for (int i = 0; i < 100; ++i) {
    scatter.add(i, 0.1, 1);
    scatter.add_row({100, 0, 0, 0, 0, 0, 1}, 0, 1);  // all events tell one direction only
  }
  scatter.evaluate();
  CHECK(scatter.covariance() == Matrix6d::Zero());
  CHECK(scatter.variance_px2() == doctest::Approx(0.01));
}

TEST_CASE("edge scatter: too few rows tell nothing yet, and count once there are enough") {
  std::mt19937 random(7);
  const std::vector<Row7> rows = rows_of_edges(40, random);
  EdgeScatter scatter;
  const auto add = [&](std::size_t first, std::size_t end) {
    for (std::size_t edge = first; edge < end; ++edge) {
      scatter.add(static_cast<int>(edge), edge % 2 == 0 ? 0.1 : -0.1, 1);
      scatter.add_row(as_array(rows[edge]), 0, 1);  // no noise
    }
    scatter.evaluate();
  };
  add(0, 20);
  CHECK(scatter.covariance() == Matrix6d::Zero());
  add(20, 40);
  CHECK(scatter.covariance().trace() > 0);
  CHECK(scatter.variance_px2() == doctest::Approx(0.01));
}
