#include "evmarker/simulation/random.hpp"

#include <doctest/doctest.h>

#include <set>
#include <vector>

using evmarker::Random;

TEST_CASE("mix_bits is SplitMix64's finaliser") {
  // The first outputs of the published generator seeded with 1234567.
  std::uint64_t state = 1234567;
  CHECK(evmarker::mix_bits(state += 0x9E3779B97F4A7C15u) == 6457827717110365317u);
  CHECK(evmarker::mix_bits(state += 0x9E3779B97F4A7C15u) == 3203168211198807973u);
}

TEST_CASE("streams are fixed by seed and keys and differ from each other") {
  CHECK(Random(1, 2, 3).bits() == Random(1, 2, 3).bits());
  std::set<std::uint64_t> firsts;
  for (std::uint64_t seed = 0; seed < 20; ++seed)
    for (std::uint64_t key = 0; key < 20; ++key)
      for (std::uint64_t subkey = 0; subkey < 20; ++subkey) firsts.insert(Random(seed, key, subkey).bits());
  CHECK(firsts.size() == 8000);
}

TEST_CASE("distributions have their moments") {
  constexpr int kCount = 200000;
  struct Moments {
    double mean = 0, square = 0;
  } uniform, exponential, gaussian;
  const auto add = [](Moments& m, double v) {
    m.mean += v / kCount;
    m.square += v * v / kCount;
  };
  double least = 1, greatest = 0, within_sigma = 0;
  for (std::uint64_t key = 0; key < kCount; ++key) {  // the first number of many streams, as the pixels use them
    Random random(7, key);
    const double u = random.uniform();
    least = std::fmin(least, u);
    greatest = std::fmax(greatest, u);
    add(uniform, u);
    add(exponential, random.exponential());
    const double g = random.gaussian();
    add(gaussian, g);
    within_sigma += std::abs(g) < 1 ? 1.0 / kCount : 0;
  }
  CHECK(least >= 0);
  CHECK(least < 1e-4);
  CHECK(greatest < 1);
  CHECK(greatest > 1 - 1e-4);
  CHECK(uniform.mean == doctest::Approx(0.5).epsilon(0.01).scale(0));
  CHECK(uniform.square == doctest::Approx(1.0 / 3).epsilon(0.01).scale(0));
  CHECK(exponential.mean == doctest::Approx(1).epsilon(0.01).scale(0));
  CHECK(exponential.square == doctest::Approx(2).epsilon(0.03).scale(0));
  CHECK(std::abs(gaussian.mean) < 0.01);
  CHECK(gaussian.square == doctest::Approx(1).epsilon(0.01).scale(0));
  CHECK(within_sigma == doctest::Approx(0.6827).epsilon(0.01).scale(0));
}
