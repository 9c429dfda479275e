#include "evmarker/opencv/dark_quads.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <vector>

using namespace evmarker;
using opencv::find_dark_quads;
using opencv::Quad;

namespace {

constexpr double kRightAngle = 1.5707963267948966;

// A square around the middle of the image, clockwise.
Quad square(double angle, double radius = 60) {
  Quad quad;
  for (std::size_t i = 0; i < 4; ++i) {
    const double a = angle + static_cast<double>(i) * kRightAngle;
    quad[i] = {160 + radius * std::cos(a), 120 + radius * std::sin(a)};
  }
  return quad;
}

cv::Mat_<uchar> drawn(const Quad& quad) {
  cv::Mat_<uchar> mask(240, 320, uchar{0});
  for (int y = 0; y < mask.rows; ++y)
    for (int x = 0; x < mask.cols; ++x) {
      bool inside = true;
      for (std::size_t i = 0; i < 4; ++i) {
        const Eigen::Vector2d side = quad[(i + 1) % 4] - quad[i], to = Eigen::Vector2d(x, y) - quad[i];
        inside &= side.x() * to.y() - side.y() * to.x() >= 0;
      }
      if (inside) mask(y, x) = 255;
    }
  return mask;
}

// Distance [px] of the corner that is farthest from its own in the nearest of the quadrilaterals found.
double nearest(const std::vector<opencv::DarkQuad>& found, const Quad& quad) {
  double best = 1e9;
  for (const auto& candidate : found)
    for (std::size_t turn = 0; turn < 4; ++turn) {
      double farthest = 0;
      for (std::size_t i = 0; i < 4; ++i)
        farthest = std::max(farthest, norm(candidate.corners[(i + turn) % 4] - quad[i]));
      best = std::min(best, farthest);
    }
  return best;
}

}  // namespace

TEST_CASE("a dark square is found at any angle, its corners clockwise, its outline seen") {
  for (double angle = 0; angle < kRightAngle; angle += 0.13) {
    CAPTURE(angle);
    const Quad quad = square(angle);
    const auto found = find_dark_quads(drawn(quad), 15);
    REQUIRE(!found.empty());
    CHECK(nearest(found, quad) < 1);
    CHECK(found[0].seen > 0.85);
    Quad counterclockwise = quad;
    std::ranges::reverse(counterclockwise);
    CHECK(nearest(found, counterclockwise) > 50);
  }
}

TEST_CASE("whiskers, a bite and a neighbour that hangs on do not hide it") {
  const Quad quad = square(0.2);
  cv::Mat_<uchar> mask = drawn(quad);
  cv::line(mask, {190, 80}, {300, 10}, 255, 1);
  cv::line(mask, {110, 150}, {20, 220}, 255, 2);
  cv::circle(mask, {cvRound((quad[0].x + quad[1].x) / 2), cvRound((quad[0].y + quad[1].y) / 2)}, 8, 0, -1);
  cv::rectangle(mask, cv::Rect(10, 60, 60, 60), 255, -1);
  cv::line(mask, {40, 90}, {120, 100}, 255, 4);
  CHECK(nearest(find_dark_quads(mask, 15), quad) < 2);
}

TEST_CASE("a side that is not seen is put between the ends of its neighbours") {
  const Quad quad = square(0.2);
  cv::Mat_<uchar> mask = drawn(quad);
  const Eigen::Vector2d middle = (quad[1] + quad[2]) / 2, out = 0.4 * (middle - Eigen::Vector2d(160, 120));
  // Ragged: a spike and a notch where the side is.
  const auto point = [](const Eigen::Vector2d& p) { return cv::Point(cvRound(p.x()), cvRound(p.y())); };
  cv::line(mask, point(middle), point(middle + out), 255, 25);
  const auto found = find_dark_quads(mask, 15);
  REQUIRE(!found.empty());
  CHECK(nearest(found, quad) < 4);
}

TEST_CASE("small ones, discs, triangles and holes are none") {
  CHECK(find_dark_quads(cv::Mat_<uchar>(240, 320, uchar{0}), 15).empty());
  CHECK(find_dark_quads(drawn(square(0.2, 9)), 15).empty());
  cv::Mat_<uchar> disc(240, 320, uchar{0}), triangle = disc.clone(), hole(240, 320, uchar{255});
  cv::circle(disc, {160, 120}, 50, 255, -1);
  CHECK(find_dark_quads(disc, 30).empty());
  const std::vector<cv::Point> corners{{100, 60}, {220, 100}, {120, 200}};
  cv::fillConvexPoly(triangle, corners, 255);
  CHECK(find_dark_quads(triangle, 15).empty());
  cv::rectangle(hole, cv::Rect(100, 60, 80, 80), 0, -1);
  CHECK(nearest(find_dark_quads(hole, 15), {Eigen::Vector2d(100, 60), {180, 60}, {180, 140}, {100, 140}}) > 20);
}
