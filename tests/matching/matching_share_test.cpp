#include "evmarker/matching/matching_share.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "evmarker/model/marker_model.hpp"
#include "simulated.hpp"

using namespace evmarker;

namespace {

MatchingShare first_estimate(const ModelMatcher& matcher) {
  MatchingShare share;
  share.restart(matcher);
  return share;
}

// At 1 m and 500 px of focal length, a marker of so many pixels.
ModelMatcher facing_square(double side_px, double max_distance_px) {
  ModelMatcher matcher(make_square_marker(side_px / 500), 500, {.max_distance_px = max_distance_px});
  Eigen::Isometry3d facing = Eigen::Isometry3d::Identity();
  facing.linear() = Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()).toRotationMatrix();
  facing.translation().z() = 1;
  REQUIRE(matcher.project(facing));
  return matcher;
}

}  // namespace

TEST_CASE("a third of the area near long edges matches: what is near lies up to three matching distances away") {
  for (const double distance_px : {1.0, 2.0, 4.0}) {
    CAPTURE(distance_px);
    const auto share = first_estimate(facing_square(200, distance_px)).share();
    REQUIRE(share);
    CHECK(*share > 0.3);  // corners are near, and match two edges equally well
    CHECK(*share < 0.37);
    MESSAGE(*share);
  }
}

TEST_CASE("refined, it is what a count of many random points gives, also where cells are small") {
  const MarkerModel model = make_code_marker(0.1, simulated::code());
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  double worst_at_first = 0;
  for (int pose = 0; pose < 8; ++pose) {
    CAPTURE(pose);
    ModelMatcher matcher(model, 300);
    REQUIRE(matcher.project(facing_pose({0.1 * unit(random), 0.1 * unit(random), 0.5}, {0.5 * unit(random), 0, 0})));
    int matching = 0, near = 0;
    const Box box = matcher.reach();
    Correspondence correspondence;
    for (int i = 0; i < 200000; ++i) {
      const MatchResult match = matcher.match(
          {box.low.x + unit(random) * box.width(), box.low.y + unit(random) * box.height()}, correspondence);
      matching += match == MatchResult::matched;
      near += match != MatchResult::far;
    }
    REQUIRE(near > 50000);
    const double truth = static_cast<double>(matching) / near;
    MatchingShare share = first_estimate(matcher);
    worst_at_first = std::max(worst_at_first, std::abs(*share.share() - truth));
    CHECK_FALSE(share.is_refined());
    for (int calls = 0; calls < 1000 && !share.is_refined(); ++calls) share.refine(matcher);
    CHECK(share.is_refined());
    CHECK(std::abs(*share.share() - truth) < 0.01);
  }
  MESSAGE("the first estimates are off by up to " << worst_at_first);
  CHECK(worst_at_first > 0.01);  // otherwise there would be nothing to refine
  CHECK(worst_at_first < 0.06);
}

TEST_CASE("a marker that was never projected has no share") {
  CHECK_FALSE(first_estimate(ModelMatcher(make_square_marker(0.1), 500)).share());
}
