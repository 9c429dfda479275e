#include "evmarker/tracking/update_interval.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

TEST_CASE("update interval: an automatic one is a tenth of the edges' length, and follows what pixels make of it") {
  UpdateInterval interval(kAutomatic);
  CHECK(interval.events() == 100);
  CHECK(interval.adapt(400, 0));
  CHECK(interval.events() == 40);
  CHECK_FALSE(interval.adapt(440, 0));  // not for every small change
  CHECK(interval.events() == 40);
  CHECK(interval.adapt(400, 2));
  CHECK(interval.events() == 80);
  CHECK(interval.adapt(1e6, 2));
  CHECK(interval.events() == 100);
  CHECK(interval.adapt(0, 2));
  CHECK(interval.events() == 1);
}

TEST_CASE("update interval: a number that is set stays") {
  UpdateInterval interval(7);
  CHECK_FALSE(interval.adapt(1e6, 4));
  CHECK(interval.events() == 7);
}
