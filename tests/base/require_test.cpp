#include "evmarker/base/require.hpp"

#include <doctest/doctest.h>

#include <limits>
#include <stdexcept>

using evmarker::Require;

TEST_CASE("what is refused is named with its value, as it was given") {
  const Require require("camera");
  CHECK_NOTHROW(require(true, "fx", -1));
  CHECK_THROWS_WITH_AS(require(false, "image width", 0), "camera: image width is 0", std::invalid_argument);
  CHECK_THROWS_WITH(require(false, "fx", -2.5), "camera: fx is -2.5");
}

TEST_CASE("positive numbers and those that are not negative are finite") {
  const Require require("filter");
  for (const double value : {1e-300, 1.0}) CHECK_NOTHROW(require.positive(value, "x"));
  for (const double value : {0.0, 1.0}) CHECK_NOTHROW(require.not_negative(value, "x"));
  const double infinity = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  for (const double value : {-1.0, infinity, -infinity, nan}) {
    CHECK_THROWS_AS(require.positive(value, "x"), std::invalid_argument);
    CHECK_THROWS_AS(require.not_negative(value, "x"), std::invalid_argument);
  }
  CHECK_THROWS_WITH(require.positive(0, "x"), "filter: x is 0");
}
