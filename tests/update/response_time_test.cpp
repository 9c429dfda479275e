#include "evmarker/update/response_time.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>

using namespace evmarker;

namespace {

// After `evaluations` of a thousand events each, of edges of up to `px_per_s`, by a pixel whose response is late by an
// exponential time of mean T; a share of the events is noise.
double estimated_s(double T_s, double px_per_s, int evaluations, double noise_share = 0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal;
  ResponseTime response;
  for (int evaluation = 0; evaluation < evaluations; ++evaluation) {
    for (int i = 0; i < 1000; ++i) {
      const double v = px_per_s * unit(random), late_s = T_s > 0 ? -T_s * std::log(1 - unit(random)) : 0;
      // The pose follows the mean of the events: only their deviation from it shows.
      const double residual =
          unit(random) < noise_share ? 4 * (2 * unit(random) - 1) : 0.5 * normal(random) + v * (late_s - T_s);
      response.add(residual, unit(random) < 0.5 ? v : -v);
    }
    response.evaluate();
  }
  return std::sqrt(response.variance_s2());
}

}  // namespace

TEST_CASE("response time: that of a pixel of first order shows in the growth of the spread") {
  CHECK(estimated_s(0.5e-3, 1000, 100) == doctest::Approx(0.5e-3).epsilon(0.15));
  CHECK(estimated_s(0.3e-3, 1000, 100) == doctest::Approx(0.3e-3).epsilon(0.2));
  CHECK(estimated_s(0.3e-3, 2000, 100) == doctest::Approx(0.3e-3).epsilon(0.2));
  CHECK(estimated_s(0.5e-3, 1000, 100, 0.1) == doctest::Approx(0.5e-3).epsilon(0.25));
}

TEST_CASE("response time: little is claimed where there is none, and nothing where motion is too slow to tell") {
  double sum = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) sum += estimated_s(0, 1000, 30, 0, seed);
  CHECK(sum / 20 < 0.15e-3);
  CHECK(estimated_s(0.5e-3, 50, 3) < 0.3e-3);
  CHECK(estimated_s(0.5e-3, 1000, 0) == 0);
}

TEST_CASE("response time: numbers that are not finite are forgotten") {
  ResponseTime response;
  response.add(std::numeric_limits<double>::infinity(), 100);
  response.add(0.1, std::numeric_limits<double>::infinity());
  response.evaluate();
  CHECK(response.variance_s2() == 0);
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (int evaluation = 0; evaluation < 100; ++evaluation) {
    for (int i = 0; i < 1000; ++i) response.add(normal(random) * std::hypot(0.5, 0.0005 * i), i);
    response.evaluate();
  }
  CHECK(response.variance_s2() > 0);
}
