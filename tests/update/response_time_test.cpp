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
  return response.delay_s();
}

}  // namespace

TEST_CASE(
    "response time: that of a pixel of first order shows in the growth of the spread, without a usual dead time") {
  // The part of it that is claimed: never more, and more than half of a long one.
  const auto part = [](double T_s, double px_per_s, double noise_share = 0) {
    return estimated_s(T_s, px_per_s, 100, noise_share) / T_s;
  };
  for (const double measured : {part(0.5e-3, 1000), part(0.8e-3, 1000), part(0.5e-3, 1000, 0.1)}) {
    CHECK(measured > 0.6);
    CHECK(measured < 0.8);
  }
  for (const double measured : {part(0.3e-3, 1000), part(0.3e-3, 2000)}) {
    CHECK(measured > 0.4);
    CHECK(measured < 0.6);
  }
}

TEST_CASE("response time: little is claimed where there is none, and nothing where motion is too slow to tell") {
  double sum = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) sum += estimated_s(0, 1000, 30, 0, seed);
  CHECK(sum / 20 < 0.02e-3);
  CHECK(estimated_s(0.5e-3, 50, 3) < 0.3e-3);
  CHECK(estimated_s(0.5e-3, 1000, 0) == 0);
}

TEST_CASE("response time: noise, of which slow edges have the larger share, is no delay") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal;
  for (const double noise_px_s : {10.0, 30.0, 60.0}) {
    CAPTURE(noise_px_s);
    ResponseTime response;
    for (int evaluation = 0; evaluation < 100; ++evaluation) {
      for (int i = 0; i < 1000; ++i) {
        const double v = 1000 * unit(random), noise_share = noise_px_s / (noise_px_s + v);
        response.add(unit(random) < noise_share ? 2 * (2 * unit(random) - 1) : 0.5 * normal(random), v);
      }
      response.evaluate();
    }
    CHECK(response.delay_s() == 0);
    CHECK(std::sqrt(response.delay_variance_s2()) < 0.2e-3);
  }
}

TEST_CASE(
    "response time: that of very slow pixels shows soon, though events beyond the matching distance are not seen") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal;
  constexpr double kT_s = 2e-3, kMaxDistance_px = 2;
  ResponseTime response;
  const auto add = [&](int events) {
    for (int i = 0; i < events;) {
      const double v = 800 * unit(random),
                   residual = 0.5 * normal(random) + v * kT_s * (-std::log(1 - unit(random)) - 1);
      if (std::abs(residual) > kMaxDistance_px) continue;
      response.add(residual, v);
      ++i;
    }
  };
  add(1000);
  CHECK(response.delay_s() == 0);
  add(100);  // the first estimate does not wait for an evaluation
  CHECK(response.delay_s() > 0.5e-3);
  for (int i = 0; i < 10; ++i) {
    add(1000);
    response.evaluate();
  }
  CHECK(response.delay_s() > 0.8e-3);
  CHECK(response.delay_s() < kT_s);
}

TEST_CASE("response time: few slow edges that spread differently are no delay of milliseconds") {
  // The variance of the events of one edge is larger than that of the other by 0.1 px^2, and it is a little faster: as
  // if by a response time of 1.6 ms.
  for (unsigned seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    ResponseTime response;
    const auto add_event = [&](double sigma_px, double speed) {
      const double residual_px = sigma_px * normal(random);
      response.add(residual_px, speed + 20 * normal(random));
    };
    for (int i = 0; i < 8000; ++i) {
      add_event(0.5, 150);
      add_event(0.59, 250);
    }
    response.evaluate();
    CHECK(response.delay_s() < 0.75e-3);
  }
}

TEST_CASE("response time: numbers that are not finite are forgotten") {
  ResponseTime response;
  response.add(std::numeric_limits<double>::infinity(), 100);
  response.add(0.1, std::numeric_limits<double>::infinity());
  response.evaluate();
  CHECK(response.delay_s() == 0);
  CHECK(response.delay_variance_s2() == 0);
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (int evaluation = 0; evaluation < 100; ++evaluation) {
    for (int i = 0; i < 1000; ++i) response.add(normal(random) * std::hypot(0.5, 0.0005 * i), i);
    response.evaluate();
  }
  CHECK(response.delay_variance_s2() > 0);
}
