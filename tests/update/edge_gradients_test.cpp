#include "evmarker/update/edge_gradients.hpp"

#include <doctest/doctest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstddef>

using namespace evmarker;

namespace {

double px(const EdgeGradients& gradients, const Eigen::Matrix<double, 6, 1>& step) {
  return std::sqrt(gradients.px2([&](std::size_t k, std::size_t i) {
    return step(static_cast<Eigen::Index>(k)) * step(static_cast<Eigen::Index>(i));
  }));
}

constexpr double kFocal = 500, kHalf = 0.05, kDistance = 1;

// Of a square that faces the camera: by x, y and z for its right, upper, left and lower edge, as x = f X / Z.
void add_square(EdgeGradients& gradients) {
  constexpr double kAcross = kFocal / kDistance, kAlong = -kFocal * kHalf / (kDistance * kDistance);
  gradients.add({kAcross, 0, kAlong, 0, 0, 0});
  gradients.add({0, kAcross, kAlong, 0, 0, 0});
  gradients.add({-kAcross, 0, kAlong, 0, 0, 0});
  gradients.add({0, -kAcross, kAlong, 0, 0, 0});
}

}  // namespace

TEST_CASE("edge gradients: a square's edges show a motion across the line of sight, and little of one along it") {
  EdgeGradients gradients;
  CHECK_FALSE(gradients.known());
  for (int i = 0; i < 200; ++i) add_square(gradients);
  REQUIRE(gradients.known());
  using Step = Eigen::Matrix<double, 6, 1>;
  // Half of the edges are along the motion: the root of a half of f / Z. The fading weights the last ones more.
  CHECK(px(gradients, 0.01 * Step::Unit(0)) == doctest::Approx(0.01 * kFocal * std::sqrt(0.5)).epsilon(0.03).scale(0));
  CHECK(px(gradients, 0.01 * Step::Unit(2)) == doctest::Approx(0.01 * kFocal * kHalf).scale(0));
  CHECK(px(gradients, 0.01 * Step::Unit(3)) == 0);
  // What is opposite cancels: a step along both is the root of the sum of the squares.
  CHECK(px(gradients, 0.01 * (Step::Unit(1) + Step::Unit(2))) ==
        doctest::Approx(0.01 * kFocal * std::sqrt(0.5 + kHalf * kHalf)).epsilon(0.03).scale(0));
}

TEST_CASE(
    "edge gradients: what is in sight no more is forgotten within a few hundred events, of which an eighth is "
    "sampled") {
  EdgeGradients gradients;
  for (int i = 0; i < 1000; ++i) gradients.add({1000, 0, 0, 0, 0, 0});
  CHECK(px(gradients, Eigen::Matrix<double, 6, 1>::Unit(0)) == doctest::Approx(1000).scale(0));
  for (int i = 0; i < 64; ++i) gradients.add({0, 0, 10, 0, 0, 0});
  CHECK(px(gradients, Eigen::Matrix<double, 6, 1>::Unit(0)) < 1000 * std::exp(-1) * 1.02);
  CHECK(px(gradients, Eigen::Matrix<double, 6, 1>::Unit(0)) > 1000 * std::exp(-1) * 0.95);
}
