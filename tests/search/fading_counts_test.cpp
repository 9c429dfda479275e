#include "evmarker/search/fading_counts.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

using namespace evmarker;

TEST_CASE("counts and their total fade by each scale's time constant") {
  FadingCounts counts(3);
  for (int i = 0; i < 4; ++i) counts.add(0, 1000);
  for (int scale = 0; scale < FadingCounts::kScales; ++scale) CHECK(counts.count(0, scale) == 4);
  const Timestamp later = 1000 + 16000;
  counts.add(1, later);
  for (int scale = 0; scale < FadingCounts::kScales; ++scale) {
    CAPTURE(scale);
    const double left = 4 * std::exp(-16000 / FadingCounts::time_constant_us(scale));
    CHECK(counts.count(0, scale) == doctest::Approx(left).epsilon(1e-4));
    CHECK(counts.count(1, scale) == 1);
    CHECK(counts.count(2, scale) == 0);
    CHECK(counts.total(scale) == doctest::Approx(1 + left).epsilon(1e-4));
  }
  CHECK(FadingCounts::time_constant_us(0) == 1000);
  CHECK(FadingCounts::time_constant_us(FadingCounts::kScales - 1) == 1024000);
}

TEST_CASE("the total is the sum of the cells, whatever the order of events within a second") {
  FadingCounts counts(50);
  std::mt19937 random(1);
  Timestamp t = -5000000;
  for (int i = 0; i < 5000; ++i) {
    t += static_cast<int>(random() % 2000);
    counts.add(random() % 50, t - (i % 7 == 0 ? 300 : 0));
  }
  for (int scale = 0; scale < FadingCounts::kScales; ++scale) {
    double sum = 0;
    for (std::size_t cell = 0; cell < 50; ++cell) sum += counts.count(cell, scale);
    CHECK(sum > 0.5);
    CHECK(sum == doctest::Approx(counts.total(scale)).epsilon(1e-3).scale(0));
  }
}

TEST_CASE("a restart and a clock that is set back forget everything") {
  FadingCounts counts(2);
  counts.add(0, 5000000);
  counts.restart();
  CHECK(counts.count(0, 5) == 0);
  CHECK(counts.total(5) == 0);
  counts.add(0, 5000000);
  counts.add(1, 1000);
  CHECK(counts.count(0, 5) == 0);
  CHECK(counts.total(5) == 1);
  counts.add(1, 2000);
  CHECK(counts.count(1, 5) == doctest::Approx(2).epsilon(0.01).scale(0));
}
