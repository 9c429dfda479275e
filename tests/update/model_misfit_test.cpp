#include "evmarker/update/model_misfit.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

TEST_CASE("model misfit: a model that says all that events do adds nothing to the covariance") {
  ModelMisfit misfit;
  CHECK(misfit.along_motion_px2() == 0);
  CHECK(misfit.of_edge_px2() == 0);
  misfit.measure_spread(0.5, 2, 0);
  CHECK(misfit.along_motion_px2() == 0);
  CHECK(misfit.of_edge_px2() == 0);
  CHECK_FALSE(misfit.events_fill_distance());
}

TEST_CASE("model misfit: two trails that differ shift the pose and each edge, one that both agree on only the pose") {
  ModelMisfit misfit;
  misfit.compare_trails(0.4, 0.4);
  CHECK(misfit.along_motion_px2() == doctest::Approx(0.01));  // a quarter of 0.4, squared
  CHECK(misfit.of_edge_px2() == 0);
  misfit.compare_trails(0.1, 0.4);
  CHECK(misfit.along_motion_px2() == doctest::Approx(0.01 + 0.09));
  CHECK(misfit.of_edge_px2() == doctest::Approx((0.09 - 0.01) / 4));
  misfit.compare_trails(0.31, 0.4);  // no more than the width may tell wrong
  CHECK(misfit.along_motion_px2() == doctest::Approx(0.01 + 0.0081));
  CHECK(misfit.of_edge_px2() == 0);
  // It is the last comparison that counts.
  misfit.compare_trails(0.4, 0.4);
  CHECK(misfit.of_edge_px2() == 0);
}

TEST_CASE("model misfit: spread that nothing explains shifts the pose in full, an edge by a quarter") {
  ModelMisfit misfit;
  misfit.measure_spread(1.0, 2, 0);
  UnexplainedSpread spread;
  spread.measure(1.0, 2, 0);
  REQUIRE(spread.px2() > 0.5);
  CHECK(misfit.along_motion_px2() == spread.px2());
  CHECK(misfit.of_edge_px2() == spread.px2() / 4);
  misfit.compare_trails(0.1, 0.4);
  CHECK(misfit.along_motion_px2() == doctest::Approx(spread.px2() + 0.1));
  misfit.measure_spread(1.33, 2, 0);
  CHECK(misfit.events_fill_distance());
}
