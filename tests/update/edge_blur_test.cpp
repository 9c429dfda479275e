#include "evmarker/update/edge_blur.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

TEST_CASE("edge blur: none of a focused sensor, nor before anything is known") {
  EdgeBlur blur;
  CHECK(blur.factor() == 1);
  for (int i = 0; i < 100; ++i) blur.add(0.4);  // less than (2/3)^2
  CHECK(blur.factor() == 1);
}

TEST_CASE("edge blur: a spread that stays is blur, from the first time on") {
  EdgeBlur blur;
  for (int i = 0; i < 100; ++i) {
    blur.add(1.44);
    CHECK(blur.factor() == doctest::Approx(1.8));
  }
}

TEST_CASE("edge blur: a spread that comes and goes is none") {
  EdgeBlur blur;
  for (int i = 0; i < 200; ++i) blur.add(i % 32 < 24 ? 1.44 : 0.5);
  CHECK(blur.factor() < 1.1);
  CHECK(blur.factor() >= 1);
}

TEST_CASE("edge blur: follows a lens that is focused, and one that goes out of focus") {
  EdgeBlur blur;
  for (int i = 0; i < 100; ++i) blur.add(1.44);
  for (int i = 0; i < 64; ++i) blur.add(0.3);
  CHECK(blur.factor() == 1);
  for (int i = 0; i < 64; ++i) blur.add(1.44);
  CHECK(blur.factor() == doctest::Approx(1.8));
}
