#include "evmarker/matching/matching_share.hpp"

#include <doctest/doctest.h>

#include <numbers>

#include "evmarker/model/marker_model.hpp"

using evmarker::make_square_marker;
using evmarker::matching_share;
using evmarker::ModelMatcher;

namespace {

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
    const auto share = matching_share(facing_square(200, distance_px));
    REQUIRE(share);
    CHECK(*share > 0.3);  // corners are near, and match two edges equally well
    CHECK(*share < 0.37);
    MESSAGE(*share);
  }
}

TEST_CASE("a marker that was never projected has no share") {
  CHECK_FALSE(matching_share(ModelMatcher(make_square_marker(0.1), 500)));
}
