#include "evmarker/edge_coverage.hpp"

#include <doctest/doctest.h>

#include <vector>

#include "evmarker/so3.hpp"
#include "evmarker/trajectory.hpp"

using namespace evmarker;

namespace {

constexpr double kFocal = 533;
const MarkerModel kSquare = make_square_marker(0.1);  // top, right, bottom, left: 89 px each at 0.6 m

Eigen::Isometry3d at(double x_px, double y_px) { return facing_pose({x_px * 0.6 / kFocal, y_px * 0.6 / kFocal, 0.6}); }

// Moves the square by a pixel at a time; every segment makes so many events on the way.
std::optional<double> silent_share(EdgeCoverage& coverage, const std::vector<int>& events, const Eigen::Vector2d& way,
                                   const MarkerModel& model = kSquare) {
  coverage.silent_share(model, at(0, 0));
  for (std::size_t segment = 0; segment < events.size(); ++segment)
    for (int i = 0; i < events[segment]; ++i) coverage.add(static_cast<int>(segment));
  return coverage.silent_share(model, at(way.x(), way.y()));
}

}  // namespace

TEST_CASE("edges that all make events are not silent, and one without events weighs by the area that it swept") {
  EdgeCoverage coverage(kSquare, kFocal);
  CHECK_FALSE(coverage.silent_share(kSquare, at(0, 0)));  // the first question only says where it is
  CHECK_FALSE(coverage.due());
  CHECK(silent_share(coverage, {800, 800, 800, 800}, {3, 3}).value() == 0);
  EdgeCoverage hidden(kSquare, kFocal);
  CHECK(silent_share(hidden, {800, 0, 800, 0}, {3, 3}).value() == doctest::Approx(0.5));
  EdgeCoverage one(kSquare, kFocal);
  CHECK(silent_share(one, {800, 800, 800, 50}, {3, 3}).value() == doctest::Approx(0.25));
}

TEST_CASE("edges along the motion need no events") {
  EdgeCoverage coverage(kSquare, kFocal);
  CHECK(silent_share(coverage, {0, 800, 0, 800}, {4, 0}).value() == 0);
  EdgeCoverage hidden(kSquare, kFocal);
  CHECK(silent_share(hidden, {0, 800, 0, 0}, {4, 0}).value() == doctest::Approx(0.5));
}

TEST_CASE("without enough motion there is no answer, and its events count on") {
  EdgeCoverage coverage(kSquare, kFocal);
  CHECK_FALSE(silent_share(coverage, {400, 400, 0, 400}, {0.5, 0.5}));
  CHECK_FALSE(coverage.due());
  for (int i = 0; i < 400; ++i) coverage.add(2);
  CHECK(coverage.due());
  CHECK(coverage.silent_share(kSquare, at(3, 3)).value() == 0);
}

TEST_CASE("a side that is turned away is not expected to make events") {
  MarkerModel turned = kSquare;
  turned.segments[3].face_normal = -Eigen::Vector3d::UnitZ();
  EdgeCoverage coverage(turned, kFocal);
  CHECK(silent_share(coverage, {800, 800, 800, 0}, {3, 3}, turned).value() == 0);
}
