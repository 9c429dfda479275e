#pragma once
// Finds the lines of a code marker's grid that are nearest to many events at once.
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/matching/event_group.hpp"
#include "evmarker/matching/projected_grid.hpp"

namespace evmarker {

/// For each of many events, the nearest vertical (element 0) and horizontal (element 1) line of a grid.
struct NearestLines {
  static constexpr std::size_t kMost = 5 * simd::kLanes;
  using Numbers = std::array<double, kMost>;
  alignas(64) std::array<Numbers, 2> k, squared;  ///< number of the line, and squared distance to it [tangent^2]
  alignas(64) std::array<Numbers, 2> place;       ///< of the foot: 2 c in cell c, a + b around the point of cells a, b
  alignas(64) Numbers within;                     ///< 1 if the event is on the marker or its fringe, else 0
  alignas(64) Numbers exists;                     ///< 1 if the feet on both lines are in front of the camera, else 0
};

/// What `nearest_lines` needs to know of a grid.
struct GridView {
  Vec3 row_x, row_y, row_w;  ///< of the inverse homography, see ProjectedGrid
  double cells;              ///< along a side
  double reach;              ///< from the middle of the grid to the end of the fringe around it [cells]
  double margin;             ///< how far from a grid point a foot counts as around it [cells]
};

/// Batch version of `ProjectedGrid::nearest_lines`, for `count` events, at most NearestLines::kMost, each with a grid
/// of its own. It works in whole lanes; results from `count` on mean nothing.
/// @param view_of(i) returns the GridView of event i
/// @param event_x,event_y lines of sight
template <typename ViewOf>
[[gnu::always_inline]] inline void nearest_lines(const ViewOf& view_of, const double* event_x, const double* event_y,
                                                 std::size_t count, NearestLines& lines) noexcept {
  constexpr double kRounding = ProjectedGrid::kRounding;
  for (std::size_t from = 0; from < count; from += simd::kLanes)
    simd::for_each_lane([&](std::size_t lane) __attribute__((always_inline)) {
      const std::size_t i = from + lane;
      const GridView& grid = view_of(i);
      const Vec3 row_x = grid.row_x, row_y = grid.row_y, row_w = grid.row_w;
      const double cells = grid.cells, centre = cells / 2;
      const double before = 0.5 - grid.margin, behind = 0.5 + grid.margin;
      const double x = event_x[i], y = event_y[i];
      const double a_x = row_x.x * x + row_x.y * y + row_x.z, a_y = row_y.x * x + row_y.y * y + row_y.z,
                   w = row_w.x * x + row_w.y * y + row_w.z;
      const double from_centre = simd::larger(std::abs(a_x - centre * w), std::abs(a_y - centre * w)), by_w = 1 / w;
      lines.within[i] = from_centre < grid.reach * w ? 1 : 0;
      double exists = 1;
      const auto nearest = [&](std::size_t c, Vec3 row, Vec3 along, double a, double a_along)
          __attribute__((always_inline)) {
        const double k = (simd::smaller(simd::larger(a * by_w, 0), cells) + kRounding) - kRounding;
        const GridLine<double> line = grid_line(k, row.x, row.y, along.x, along.y, row_w.x, row_w.y, a, a_along, w);
        const double inverse = 1 / (line.norm2 * line.foot_w);
        lines.k[c][i] = k;
        lines.squared[c][i] = line.e * line.e * line.foot_w * inverse;
        const double foot = simd::smaller(simd::larger(line.foot_a * line.norm2 * inverse, -0.5), cells + 0.5);
        lines.place[c][i] = ((foot - before) + kRounding) - kRounding + (((foot - behind) + kRounding) - kRounding);
        exists = line.foot_w > 0 ? exists : 0;
      };
      nearest(0, row_x, row_y, a_x, a_y);
      nearest(1, row_y, row_x, a_y, a_x);
      lines.exists[i] = exists;
    });
}

}  // namespace evmarker
