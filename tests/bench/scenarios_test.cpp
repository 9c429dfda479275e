#include "../../bench/scenarios.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

using namespace evmarker;

TEST_CASE("scenarios keep their places, on which what they draw depends, and new ones come after them") {
  const std::vector<std::string> names{"near",     "fast",         "far",       "dim",        "tilt",       "occluded",
                                       "clutter",  "several",      "distorted", "hd",         "slow",       "leaving",
                                       "shaking",  "low_contrast", "uneven",    "dim_sensor", "refractory", "defocus",
                                       "davis346", "dvs128",       "fisheye",   "rests",      "leak"};
  const auto scenarios = bench::scenarios();
  REQUIRE(scenarios.size() == names.size());
  for (std::size_t i = 0; i < names.size(); ++i) CHECK(scenarios[i].name == names[i]);
}

TEST_CASE("every scenario can be simulated, with the markers in sight at the start and another one for another seed") {
  for (const bench::Scenario& scenario : bench::scenarios()) {
    CAPTURE(scenario.name);
    const bench::Situation situation = scenario.make(1), other = scenario.make(2);
    CHECK_NOTHROW(validate(situation.scene));
    CHECK_NOTHROW(validated(situation.simulator));
    CHECK(bench::visible_share(situation, 0, 0) > 0.5);
    CHECK_FALSE(situation.truth(0, 100000).isApprox(other.truth(0, 100000)));
    CHECK(situation.truth(0, 100000).isApprox(scenario.make(1).truth(0, 100000)));
  }
}

TEST_CASE("rests: moves are interrupted four times, for 0.05 s to 2.5 s") {
  const auto scenarios = bench::scenarios();
  const bench::Situation situation = std::ranges::find(scenarios, "rests", &bench::Scenario::name)->make(3);
  std::vector<double> rests;
  double begin = 0;
  for (Timestamp t = 1000; t < 5800000; t += 1000) {
    const bool still = situation.truth(0, t).isApprox(situation.truth(0, t - 1000), 1e-9);
    if (!still && static_cast<double>(t) - begin > 30000) rests.push_back(1e-6 * (static_cast<double>(t) - begin));
    if (!still) begin = static_cast<double>(t);
  }
  std::ranges::sort(rests);
  REQUIRE(rests.size() == 4);
  for (const auto& [index, expected] : {std::pair{0, 0.05}, {1, 0.25}, {2, 1.0}, {3, 2.5}})
    CHECK(std::abs(rests[static_cast<std::size_t>(index)] - expected) < 0.015);
}
