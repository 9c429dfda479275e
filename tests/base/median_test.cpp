#include "evmarker/base/median.hpp"

#include <doctest/doctest.h>

using evmarker::median;

TEST_CASE("as many values lie below the median as above, and of two in the middle it is the upper one") {
  CHECK(median({5}) == 5);
  CHECK(median({7, -1, 3}) == 3);
  CHECK(median({4, 2}) == 4);
  CHECK(median({1, 100, 3, 2, 1, 50}) == 3);
}
