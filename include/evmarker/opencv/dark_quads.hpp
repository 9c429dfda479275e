#pragma once
// Search for dark quadrilaterals with ragged and interrupted outlines.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "evmarker/base/vector.hpp"

namespace evmarker::opencv {

/// The corners of a convex quadrilateral [px], clockwise as seen in the image.
using Quad = std::array<Vec2, 4>;

/// A dark quadrilateral in an image.
struct DarkQuad {
  Quad corners;
  double seen = 0;  ///< share of its outline along which there are straight edges
};

namespace detail {

// A straight piece of a contour, with the dark area on its right as seen in the image.
struct Side {
  Vec2 from, to;  // [px]
  Vec2 along;     // unit vector

  double length() const { return dot(to - from, along); }
  // Distance of a point from the line, positive on its right.
  double distance(Vec2 p) const { return cross(p - from); }
  double cross(Vec2 v) const { return along.x * v.y - along.y * v.x; }
};

// Fits a line to the points of a contour from `first` to `last`, both included, and moves it outwards by half a pixel,
// from the centres of the outermost dark pixels to their outer edges.
inline Side fit_side(const std::vector<cv::Point>& contour, std::size_t first, std::size_t last) {
  const std::size_t size = contour.size(), count = (last + size - first) % size + 1;
  const std::size_t skip = std::min<std::size_t>(count / 6, 3);  // corners are rounded
  Vec2 sum;
  double xx = 0, xy = 0, yy = 0, points = 0;
  for (std::size_t i = skip; i + skip < count; ++i, ++points) {
    const cv::Point& pixel = contour[(first + i) % size];
    const Vec2 p(pixel.x, pixel.y);
    sum = sum + p;
    xx += p.x * p.x;
    xy += p.x * p.y;
    yy += p.y * p.y;
  }
  const Vec2 mean = sum / points;
  xx -= points * mean.x * mean.x;
  xy -= points * mean.x * mean.y;
  yy -= points * mean.y * mean.y;
  const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
  Vec2 along(std::cos(angle), std::sin(angle));
  const Vec2 a(contour[first].x, contour[first].y), b(contour[last].x, contour[last].y);
  if (dot(along, b - a) < 0) along = -1 * along;
  constexpr double kRim = 0.5;  // [px]
  const Vec2 foot = mean + kRim * Vec2(along.y, -along.x);
  return {foot + dot(along, a - foot) * along, foot + dot(along, b - foot) * along, along};
}

// The longest straight pieces of a contour, clockwise; the contour itself is made clockwise. Empty if it has less than
// four corners.
inline std::vector<Side> sides_of(std::vector<cv::Point>& contour, double min_length_px) {
  constexpr std::size_t kMost = 14;
  constexpr double kRagged_px = 1.6, kBent = 0.015;  // tolerance of straightness: in px, as a share of the contour
  if (cv::contourArea(contour, true) < 0) std::ranges::reverse(contour);  // to clockwise
  const cv::Rect box = cv::boundingRect(contour);
  std::vector<cv::Point> polygon;
  cv::approxPolyDP(contour, polygon, std::max(kRagged_px, kBent * std::max(box.width, box.height)), true);
  if (polygon.size() < 4) return {};

  std::vector<Side> sides;
  std::size_t at = static_cast<std::size_t>(std::ranges::find(contour, polygon[0]) - contour.begin());
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const cv::Point& end = polygon[(i + 1) % polygon.size()];
    const std::size_t begin = at;
    do at = (at + 1) % contour.size();
    while (contour[at] != end && at != begin);
    if (cv::norm(end - polygon[i]) >= min_length_px) sides.push_back(fit_side(contour, begin, at));
  }
  if (sides.size() > kMost) {
    std::vector<double> lengths;
    for (const Side& side : sides) lengths.push_back(side.length());
    std::ranges::nth_element(lengths, lengths.begin() + kMost, std::greater<>());
    std::erase_if(sides, [least = lengths[kMost]](const Side& side) { return side.length() <= least; });
  }
  return sides;
}

// The intersection of two lines; not finite if they are parallel.
inline Vec2 intersection(const Side& a, const Side& b) {
  return a.from + b.cross(a.from - b.from) / -b.cross(a.along) * a.along;
}

// Share of the line between two corners along which there are straight pieces of the contour.
inline double covered(const std::vector<Side>& sides, Vec2 from, Vec2 to) {
  constexpr double kBeside_px = 2;
  const double length = norm(to - from);
  const Side way{from, to, (to - from) / length};
  double sum = 0;
  for (const Side& side : sides) {
    if (dot(side.along, way.along) < 0.9) continue;
    if (std::abs(way.distance(side.from)) > kBeside_px || std::abs(way.distance(side.to)) > kBeside_px) continue;
    const double begin = std::max(0.0, dot(way.along, side.from - from));
    const double end = std::min(length, dot(way.along, side.to - from));
    sum += std::max(0.0, end - begin);
  }
  return sum / length;
}

// The quadrilateral that four sides bound, if it is large enough and enough of its outline consists of straight pieces.
// `last_unseen`: the last side is assumed, and none of it need be seen.
inline std::optional<DarkQuad> quad_of(const std::vector<Side>& all, const std::array<Side, 4>& sides,
                                       double min_side_px, bool last_unseen) {
  constexpr double kLeastOfSide = 0.3, kLeast = 0.6;  // share of a side, and of the outline, that is seen
  Quad quad;
  for (std::size_t i = 0; i < 4; ++i) {
    quad[i] = intersection(sides[(i + 3) % 4], sides[i]);
    if (!is_finite(quad[i])) return std::nullopt;
  }
  double outline = 0, seen = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec2 from = quad[i], to = quad[(i + 1) % 4];
    const double length = dot(sides[i].along, to - from);  // less than 0: the lines cross on the wrong side
    if (length < min_side_px) return std::nullopt;
    const double share = covered(all, from, to);
    if (share < kLeastOfSide && !(last_unseen && i == 3)) return std::nullopt;
    outline += length;
    seen += share * length;
  }
  if (seen < kLeast * outline) return std::nullopt;
  return DarkQuad{quad, seen / outline};
}

// Adds all quadrilaterals that are bounded by four sides of a contour in their order, or by three sides and the line
// that joins the end of the third with the start of the first.
inline void add_quads(const std::vector<Side>& sides, double min_side_px, std::vector<DarkQuad>& quads) {
  const auto turns = [](const Side& a, const Side& b) { return a.cross(b.along) > 0.25; };
  const auto opposite = [](const Side& a, const Side& b) { return dot(a.along, b.along) < -0.5; };
  const std::size_t count = sides.size();
  for (std::size_t first = 0; first < count; ++first) {
    const auto side = [&](std::size_t after) -> const Side& { return sides[(first + after) % count]; };
    const Side& a = sides[first];
    for (std::size_t i = 1; i < count; ++i) {
      const Side& b = side(i);
      if (!turns(a, b)) continue;
      for (std::size_t j = i + 1; j < count; ++j) {
        const Side& c = side(j);
        if (!turns(b, c) || !opposite(a, c)) continue;
        const auto close = [&](const Side& d, bool unseen) {
          if (!turns(c, d) || !turns(d, a) || !opposite(b, d)) return;
          if (const auto quad = quad_of(sides, {a, b, c, d}, min_side_px, unseen)) quads.push_back(*quad);
        };
        for (std::size_t k = j + 1; first + k < count; ++k) close(side(k), false);  // so that each is found once
        const Vec2 way = a.from - c.to;
        if (norm(way) > min_side_px) close({c.to, a.from, way / norm(way)}, true);
      }
    }
  }
}

}  // namespace detail

/// Finds all quadrilaterals that the straight pieces of the outline of a dark area allow. The area may have whiskers or
/// touch others. Pieces of the outline may be missing, even a whole side, as an edge that moves along itself causes no
/// events; the corners are then the ends of the neighbouring sides.
/// @param dark mask, 8 bit, not 0 where dark
/// @param min_side_px least length of a side
inline std::vector<DarkQuad> find_dark_quads(const cv::Mat& dark, double min_side_px) {
  std::vector<std::vector<cv::Point>> contours;
  std::vector<cv::Vec4i> hierarchy;
  cv::findContours(dark, contours, hierarchy, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
  std::vector<DarkQuad> quads;
  for (std::size_t c = 0; c < contours.size(); ++c) {
    constexpr double kForeshortened = 0.7;  // a diamond's box is larger than its sides
    constexpr double kShortest = 0.3;       // straight piece, relative to min_side_px
    if (hierarchy[c][3] >= 0) continue;     // the outline of a hole
    const cv::Rect box = cv::boundingRect(contours[c]);
    if (std::min(box.width, box.height) < kForeshortened * min_side_px) continue;
    detail::add_quads(detail::sides_of(contours[c], kShortest * min_side_px), min_side_px, quads);
  }
  return quads;
}

}  // namespace evmarker::opencv
