#include "evmarker/update/measurement_statistics.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <initializer_list>

using namespace evmarker;

TEST_CASE("measurement statistics: the first update tells lever arm and gradient, later ones over 100 events") {
  MeasurementStatistics statistics;
  statistics.set_events_per_update(10);
  CHECK_FALSE(statistics.known());
  for (int i = 0; i < 10; ++i) statistics.add({.lever2 = 3, .gradient2 = 5});
  statistics.update_means(10);
  CHECK(statistics.known());
  CHECK(statistics.lever2() == doctest::Approx(3));
  CHECK(statistics.gradient2() == doctest::Approx(5));
  statistics.clear();
  for (int i = 0; i < 10; ++i) statistics.add({.lever2 = 4});
  statistics.update_means(10);
  CHECK(statistics.lever2() == doctest::Approx(3 + 1 - std::pow(0.99, 10)));
  CHECK(statistics.share() == doctest::Approx(1 - std::pow(0.99, 10)));
}

TEST_CASE("measurement statistics: the spread forgets half in 693 events, however many make an update") {
  for (const int n : {1, 7, 99}) {
    CAPTURE(n);
    MeasurementStatistics statistics;
    statistics.set_events_per_update(n);
    for (int update = 0; update < 693 / n; ++update) {
      for (int i = 0; i < n; ++i) statistics.add({.residual2 = 3});
      statistics.update_means(n);
      statistics.clear();
    }
    CHECK(statistics.spread_px2() == doctest::Approx(2).epsilon(0.001).scale(0));  // from 1 to 3
  }
}

TEST_CASE("measurement statistics: times are summed until they are forgotten") {
  MeasurementStatistics statistics;
  statistics.add({.since_us = 10});
  statistics.add({.since_us = 30});
  CHECK(statistics.sums().since_us == 40);
  statistics.clear();
  CHECK(statistics.sums().since_us == 0);
}
