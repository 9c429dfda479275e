#include "../../bench/random_scene.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <set>
#include <string>

using namespace evmarker;

TEST_CASE("scenes drawn at random can be simulated, keep their marker in sight, differ, and come again") {
  std::set<std::string> dictionaries;
  std::set<int> widths;
  double smallest_px = 1e9, largest_px = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    CAPTURE(seed);
    const bench::Situation situation = bench::random_scene(seed), again = bench::random_scene(seed);
    CHECK_NOTHROW(validate(situation.scene));
    CHECK_NOTHROW(validated(situation.simulator));
    int in_sight = 0;
    for (const double t : {0.0, 0.3, 0.6, 0.9}) in_sight += bench::visible_share(situation, 0, t) > 0.5;
    CHECK(in_sight >= 3);
    CHECK(situation.truth(0, 600000).isApprox(again.truth(0, 600000), 0));
    CHECK(situation.camera.focal_length() != bench::random_scene(seed + 1).camera.focal_length());
    dictionaries.insert(situation.dictionary);
    widths.insert(situation.camera.sensor_size().width);
    const double side_px =
        situation.camera.focal_length() * situation.marker_length() / situation.truth(0, 0).translation().z();
    smallest_px = std::min(smallest_px, side_px);
    largest_px = std::max(largest_px, side_px);
  }
  CHECK(dictionaries.size() == 4);
  CHECK(widths.size() == 5);  // of six sensors, two are 640 px wide
  CHECK(smallest_px < 40);
  CHECK(largest_px > 150);
}
