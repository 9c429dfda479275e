#include "evmarker/update/dark_response.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <random>

using namespace evmarker;

namespace {

constexpr double kMaxDistance_px = 2, kOfEdges_px4 = 0.01 / 40;

// Of edges of up to 0.5 px/ms: pixels that brighten are late by an exponential time of mean `bright_ms`, pixels that
// darken by one of mean `dark_ms`, about which the pose lies in the mean; they err by `on_px` and `off_px` beside.
struct Pixels {
  double bright_ms = 0, dark_ms = 0, on_px = 0.5, off_px = 0.5;
};

DarkResponse response_of(const Pixels& pixels, int events, unsigned seed, double of_edges_px4 = kOfEdges_px4) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal;
  DarkResponse response;
  for (int i = 0; i < events; ++i) {
    const bool on = i % 2 == 0;
    const double speed = 0.5 * unit(random), T = on ? pixels.bright_ms : pixels.dark_ms,
                 late_ms = -T * std::log(1 - unit(random)) - T;
    const double residual = (on ? pixels.on_px : pixels.off_px) * normal(random) + speed * late_ms,
                 r2 = residual * residual;
    if (std::abs(residual) < kMaxDistance_px) response.add(on, r2 / (1 + r2), speed * speed);
  }
  response.estimate(kMaxDistance_px, of_edges_px4);
  return response;
}

}  // namespace

TEST_CASE("dark response: the time constant of pixels that darken lies between its bounds, which are near each other") {
  for (const double dark_ms : {0.7, 1.0, 1.5})
    for (unsigned seed = 1; seed <= 5; ++seed) {
      CAPTURE(dark_ms);
      CAPTURE(seed);
      const DarkResponse response = response_of({.bright_ms = dark_ms / 18, .dark_ms = dark_ms}, 30000, seed);
      CHECK(response.least_s() > 1e-3 * (dark_ms - 0.45));
      CHECK(response.least_s() < 1e-3 * dark_ms);
      CHECK(response.most_s() > 0.8e-3 * dark_ms);
      CHECK(response.most_s() < 1e-3 * (dark_ms + 0.25));
    }
}

TEST_CASE("dark response: none where all events spread alike, nor where ON events spread farther") {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    CAPTURE(seed);
    CHECK(response_of({}, 3000, seed).least_s() == 0);
    CHECK(response_of({.bright_ms = 1, .dark_ms = 1}, 3000, seed).least_s() < 0.4e-3);
    CHECK(response_of({.on_px = 0.55}, 3000, seed).most_s() == 0);
  }
}

TEST_CASE("dark response: few edges, which differ for other reasons, show none") {
  const Pixels off_is_wider{.off_px = 0.55};
  CHECK(response_of(off_is_wider, 30000, 1, 0).least_s() > 0);
  CHECK(response_of(off_is_wider, 30000, 1, 0.01).least_s() == 0);
  CHECK(response_of({.dark_ms = 1}, 0, 1).most_s() == 0);
  CHECK(response_of({.dark_ms = 1}, 1, 1).most_s() == 0);  // one polarity
}
