#include "evmarker/simulation/texture.hpp"

#include <doctest/doctest.h>

#include <algorithm>

using namespace evmarker;

TEST_CASE("a texture varies within its contrast, smoothly, and moves as a whole") {
  const Background background{.mean = 0.4, .contrast = 0.5, .texture_size_px = 10, .velocity_px_per_s = {20, -10}};
  const Texture texture(background);
  double least = 1, greatest = 0, steepest = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d at(i % 150 + 0.3, i / 150 + 0.7);
    const double value = texture.intensity(at, 0);
    least = std::min(least, value);
    greatest = std::max(greatest, value);
    steepest = std::max(steepest, std::abs(texture.intensity(at + Eigen::Vector2d(0.01, 0), 0) - value) / 0.01);
    CHECK(texture.intensity(at + Eigen::Vector2d(10, -5), 0.5) == doctest::Approx(value));
  }
  CHECK(least >= 0.4 * std::exp(-0.5));
  CHECK(least < 0.4 * std::exp(-0.3));
  CHECK(greatest <= 0.4 * std::exp(0.5));
  CHECK(greatest > 0.4 * std::exp(0.3));
  CHECK(steepest < 0.4 * 2 * 0.5 * 1.875 / 10 * std::exp(0.5));
  CHECK(Texture(Background{}).intensity({3, 4}, 0) == 0.4);
  CHECK(texture.moves());
  CHECK_FALSE(Texture(Background{}).moves());
}
