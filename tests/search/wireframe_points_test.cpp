#include "evmarker/search/wireframe_points.hpp"

#include <doctest/doctest.h>

#include "evmarker/base/so3.hpp"
#include "evmarker/simulation/trajectory.hpp"

using namespace evmarker;

TEST_CASE("points lie at equal distances along the edges that are seen") {
  const MarkerModel square = make_square_marker(0.1);
  WireframePoints points;
  points.place(square, 500, facing_pose({0, 0, 0.5}), 10);  // 100 px a side
  CHECK(points.length_px() == doctest::Approx(400));
  REQUIRE(points.size() == 40);
  CHECK(norm(points.centre()) < 1e-12);
  for (std::size_t i = 0; i < 40; ++i) {
    CHECK(std::max(std::abs(points[i].x), std::abs(points[i].y)) == doctest::Approx(0.05));
    if (i % 10 != 0) CHECK(norm(points[i] - points[i - 1]) == doctest::Approx(0.01));
  }
  points.place(square, 500, facing_pose({0, 0, 0.5}), 1);
  CHECK(points.size() == WireframePoints::kMost);
}

TEST_CASE("hidden faces and what is behind the camera have no points") {
  const MarkerModel square = make_square_marker(0.1);
  Eigen::Isometry3d back = facing_pose({0, 0, 0.5});
  back.linear() = so3_exp({3, 0, 0}) * back.linear();
  WireframePoints points;
  points.place(square, 500, back, 10);
  CHECK(points.size() == 0);
  CHECK(points.length_px() == 0);
  points.place(square, 500, facing_pose({0, 0, -0.5}), 10);
  CHECK(points.size() == 0);
  MarkerModel open = square;
  for (MarkerSegment& segment : open.segments) segment.face_normal.setZero();
  points.place(open, 500, back, 10);
  CHECK(points.size() > 30);
}

TEST_CASE("the box holds the edges that are seen") {
  const Box box = image_box(make_square_marker(0.1), 500, facing_pose({0.1, 0, 0.5}));
  CHECK(norm(box.low - Vec2(50, -50)) < 1e-9);
  CHECK(norm(box.high - Vec2(150, 50)) < 1e-9);
  CHECK(image_box(make_square_marker(0.1), 500, facing_pose({0, 0, -0.5})).size() == 0);
}
