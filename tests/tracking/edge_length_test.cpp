#include "evmarker/tracking/edge_length.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <numbers>

#include "evmarker/base/so3.hpp"
#include "evmarker/simulation/trajectory.hpp"
#include "tracking/facing_square.hpp"

using namespace evmarker;
using namespace evmarker::test;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

// A square that is seen from the front, and the opposite side of the same body.
MarkerModel plate(double length, double thickness) {
  MarkerModel model = make_square_marker(length);
  const int front = static_cast<int>(model.vertices.size());
  const auto segments = model.segments;
  for (int i = 0; i < front; ++i)
    model.vertices.push_back(model.vertices[static_cast<std::size_t>(i)] - thickness * Eigen::Vector3d::UnitZ());
  for (auto& segment : model.segments) segment.face_normal = Eigen::Vector3d::UnitZ();
  for (MarkerSegment segment : segments) {
    segment.from += front;
    segment.to += front;
    segment.face_normal = -Eigen::Vector3d::UnitZ();
    model.segments.push_back(segment);
  }
  return model;
}

Eigen::Isometry3d tilted(double deg, double distance_m = 0.6) {
  return facing_pose({0, 0, distance_m}, deg * kDegree * Eigen::Vector3d::UnitY());
}

// The lengths of all edges that face the camera, by projecting their ends.
double projected_px(const MarkerModel& model, const Eigen::Isometry3d& T) {
  double length_px = 0;
  for (const MarkerSegment& segment : model.segments) {
    const Eigen::Vector3d from = T * model.vertices[static_cast<std::size_t>(segment.from)],
                          to = T * model.vertices[static_cast<std::size_t>(segment.to)];
    if ((T.linear() * segment.face_normal).dot(from) <= 0)
      length_px += kFocalLength * (from.hnormalized() - to.hnormalized()).norm();
  }
  return length_px;
}

}  // namespace

TEST_CASE("from the front the edges are as long as their projection, however far") {
  for (const double distance : {0.2, 0.6, 3.0}) {
    const auto pose = tilted(0, distance);
    CHECK(EdgeLength(kSquare, kFocalLength).px(pose) ==
          doctest::Approx(projected_px(kSquare, pose)).epsilon(1e-6).scale(0));
  }
}

TEST_CASE(
    "of a tilted side half of the edges are foreshortened, as those of a square turned about one of its sides are") {
  const MarkerModel model = plate(0.1, 0.02);
  const EdgeLength edges(model, kFocalLength);
  for (const double deg : {20.0, 45.0, 60.0, 80.0}) {
    CAPTURE(deg);
    CHECK(edges.px(tilted(deg)) == doctest::Approx(projected_px(model, tilted(deg))).epsilon(0.03).scale(0));
  }
}

TEST_CASE("a side that is turned away shows nothing, and its opposite then shows all") {
  const MarkerModel model = plate(0.1, 0.02);
  MarkerModel front = model;
  front.segments.resize(4);
  CHECK(EdgeLength(front, kFocalLength).px(tilted(0)) == doctest::Approx(4 * kFocalLength * 0.1 / 0.6));
  CHECK(EdgeLength(front, kFocalLength).px(tilted(180)) == 0);
  CHECK(EdgeLength(model, kFocalLength).px(tilted(180)) ==
        doctest::Approx(projected_px(model, tilted(180))).epsilon(1e-6).scale(0));
}

TEST_CASE("a wireframe without faces is seen from everywhere") {
  MarkerModel model = kSquare;
  for (auto& segment : model.segments) segment.face_normal.setZero();
  CHECK(EdgeLength(model, kFocalLength).px(tilted(180)) ==
        doctest::Approx(EdgeLength(model, kFocalLength).px(tilted(0))));
}
