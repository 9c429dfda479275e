#pragma once
// Eqs. (1) to (5) for events and the edges of a code marker's grid that they match.
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/matching/closest_points.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/matching/grid_edges.hpp"
#include "evmarker/matching/projected_grid.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// Where an event lies relative to the grid edge that it matches.
struct EdgeGeometry {
  ClosestPoints points;     ///< Eqs. (3) to (5)
  double from_end_px2 = 0;  ///< as in Correspondence
  double distance_px = 0;   ///< Eq. (1), positive on the dark side
  Vec2 normal{};            ///< of the edge's image, toward its dark side
  Vec3 gradient{};          ///< how E's image moves along `normal` with E: derivative by E [px/m]
};

/// @param line (n; c), the image of the edge: n m + c = 0, n toward larger grid coordinates, not of unit length
/// @param signed_inverse_norm 1 / |n|, negative if the edge's dark side is that of smaller coordinates
/// @param V,S the edge's line in space: V where the line begins, S the step along it to the next cell [m, camera frame]
/// @param begin,end of the edge, in steps S from V
/// @param m line of sight (m; 1)
[[gnu::always_inline]] inline EdgeGeometry edge_geometry(Vec3 line, double signed_inverse_norm, Vec3 V, Vec3 S,
                                                         double begin, double end, Vec2 m,
                                                         double focal_length) noexcept {
  // Built in place: a copy of the whole would have to wait until its parts, just written, are stored.
  EdgeGeometry geometry{.points = closest_points(V, S, begin, end, {m.x, m.y, 1})};
  const Vec3 unit = signed_inverse_norm * line, E = geometry.points.E;
  geometry.normal = {unit.x, unit.y};
  geometry.distance_px = focal_length * line_distance(unit, m);
  geometry.gradient = image_gradient(geometry.normal, E, focal_length);
  geometry.from_end_px2 = from_end_px2(geometry.points, S, begin, end, focal_length);
  return geometry;
}

/// The line of a grid on which an edge lies, at the grid's present pose.
struct EdgeLine {
  Vec3 image;  ///< n m + c = 0, n toward larger grid coordinates, not of unit length
  Vec3 V, S;   ///< in space: V where the line begins, S the step along it to the next cell [m, camera frame]
};

/// @param coordinate of the line, as in GridEdges: the one that is constant on it
/// @param k number of the line
[[gnu::always_inline]] inline EdgeLine edge_line(const ProjectedGrid& grid, std::size_t coordinate, double k) noexcept {
  return {grid.row(coordinate) - k * grid.row_w(), grid.corner() + k * grid.step(coordinate),
          grid.step(1 - coordinate)};
}

/// Sets the geometry of an event's correspondence; its `t`, `polarity` and `contrast` are the caller's. False, and `c`
/// is void, if the edge points at the camera.
[[gnu::always_inline]] inline bool correspond(const ProjectedGrid& grid, const GridEdges::Stretch& edge, Vec2 m,
                                              double focal_length, Correspondence& c) noexcept {
  const auto [image, V, S] = edge_line(grid, static_cast<std::size_t>(edge.coordinate), edge.line);
  const EdgeGeometry geometry = edge_geometry(image, edge.dark / std::sqrt(image.x * image.x + image.y * image.y), V, S,
                                              edge.begin, edge.end, m, focal_length);
  c.segment = edge.segment;
  c.distance_px = geometry.distance_px;
  c.squared_px = geometry.distance_px * geometry.distance_px;
  c.from_end_px2 = geometry.from_end_px2;
  c.normal = geometry.normal;
  c.dark_side_known = true;
  c.gradient = geometry.gradient;
  c.M = {m.x, m.y, 1};
  c.E = geometry.points.E;
  c.F = geometry.points.F;
  return geometry.points.valid;
}

/// Up to eight events that were matched to edges of grids, one array for each component.
struct GridMatches {
  alignas(64) simd::Lanes x{}, y{}, t{}, polarity{};  ///< line of sight (x, y; 1), time [us], 1 ON, -1 OFF, 0 unknown
  alignas(64) simd::Lanes coordinate{}, k{}, begin{}, end{}, dark{};  ///< as in GridEdges::Stretch; k is its `line`
  alignas(64) simd::Lanes contrast{1, 1, 1, 1, 1, 1, 1, 1};           ///< of the edge, as in Correspondence
  std::array<std::size_t, simd::kLanes> grid{};                       ///< number of the grid
  std::array<int, simd::kLanes> segment{};                            ///< as in Correspondence
  std::size_t count = 0;

  /// Writes entry i; does not change `count`.
  /// @param first_segment of the grid, among those of the model
  /// @param contrast_of_edge as in Correspondence; not 0
  void set(std::size_t i, Vec2 m, Timestamp time, double sign, std::size_t number_of_grid, int first_segment,
           const GridEdges::Stretch& edge, double contrast_of_edge) noexcept {
    x[i] = m.x;
    y[i] = m.y;
    t[i] = static_cast<double>(time);
    polarity[i] = sign;
    coordinate[i] = static_cast<double>(edge.coordinate);
    k[i] = edge.line;
    begin[i] = edge.begin;
    end[i] = edge.end;
    dark[i] = edge.dark;
    contrast[i] = contrast_of_edge;
    grid[i] = number_of_grid;
    segment[i] = first_segment + edge.segment;
  }
};

namespace detail {

/// @param line_of(i) returns the EdgeLine of event i
template <typename LineOf>
[[gnu::always_inline]] inline void correspond_on(const GridMatches& matches, const LineOf& line_of, double focal_length,
                                                 Correspondences& c) noexcept {
  alignas(64) simd::Lanes norm;
  simd::for_each_lane([&](std::size_t i) __attribute__((always_inline)) {
    const Vec3 image = line_of(i).image;
    norm[i] = image.x * image.x + image.y * image.y;
  });
  simd::square_roots(norm);
  simd::for_each_lane([&](std::size_t i) __attribute__((always_inline)) {
    const Vec2 m{matches.x[i], matches.y[i]};
    const EdgeLine line = line_of(i);
    const EdgeGeometry geometry = edge_geometry(line.image, matches.dark[i] / norm[i], line.V, line.S, matches.begin[i],
                                                matches.end[i], m, focal_length);
    c.t[i] = matches.t[i];
    c.polarity[i] = matches.polarity[i];
    c.distance_px[i] = geometry.distance_px;
    c.from_end_px2[i] = geometry.from_end_px2;
    c.M_x[i] = m.x;
    c.M_y[i] = m.y;
    c.F_x[i] = geometry.points.F.x;
    c.F_y[i] = geometry.points.F.y;
    c.F_z[i] = geometry.points.F.z;
    c.E_x[i] = geometry.points.E.x;
    c.E_y[i] = geometry.points.E.y;
    c.E_z[i] = geometry.points.E.z;
    c.g_x[i] = geometry.gradient.x;
    c.g_y[i] = geometry.gradient.y;
    c.g_z[i] = geometry.gradient.z;
  });
  c.contrast = matches.contrast;
  c.segment = matches.segment;
  c.set_count(matches.count);
}

// For events on one grid.
[[gnu::always_inline]] inline void correspond_on_one(const GridMatches& matches, const ProjectedGrid& grid,
                                                     double focal_length, Correspondences& c) noexcept {
  // Copies: the compiler cannot know that writing to `c` leaves the originals as they are.
  const Vec3 rows[2] = {grid.row(0), grid.row(1)}, steps[2] = {grid.step(0), grid.step(1)};
  const Vec3 corner = grid.corner(), row_w = grid.row_w();
  // two[0] or two[1], for index 0.0 or 1.0: a weighted sum, as a condition would keep the loop from being vectorised.
  const auto select = [](double index, const Vec3* two) __attribute__((always_inline)) {
    return (1 - index) * two[0] + index * two[1];
  };
  const auto line_of = [&](std::size_t i) __attribute__((always_inline))->EdgeLine {
    const double is_y = matches.coordinate[i], k = matches.k[i];
    return {select(is_y, rows) - k * row_w, corner + k * select(is_y, steps), select(1 - is_y, steps)};
  };
  correspond_on(matches, line_of, focal_length, c);
}

// For events on several grids.
template <typename GridOf>
[[gnu::always_inline]] inline void correspond_on_several(const GridMatches& matches, const GridOf& grid_of,
                                                         double focal_length, Correspondences& c) noexcept {
  alignas(64) simd::Lanes lines[9];
  for (std::size_t i = 0; i < simd::kLanes; ++i) {
    const ProjectedGrid& grid = grid_of(matches.grid[i < matches.count ? i : 0]);
    const auto [image, V, S] = edge_line(grid, static_cast<std::size_t>(matches.coordinate[i]), matches.k[i]);
    const double numbers[9] = {image.x, image.y, image.z, V.x, V.y, V.z, S.x, S.y, S.z};
#pragma GCC unroll 9
    for (std::size_t n = 0; n < 9; ++n) lines[n][i] = numbers[n];
  }
  const auto line_of = [&](std::size_t i) __attribute__((always_inline))->EdgeLine {
    return {{lines[0][i], lines[1][i], lines[2][i]},
            {lines[3][i], lines[4][i], lines[5][i]},
            {lines[6][i], lines[7][i], lines[8][i]}};
  };
  correspond_on(matches, line_of, focal_length, c);
}

}  // namespace detail

/// Batch version of `correspond`, for at least one event, without its check: at poses that GridMatcher accepts, no edge
/// points at the camera.
/// @param grid_of(number) returns a grid by its number
template <typename GridOf>
[[gnu::always_inline]] inline void correspond(const GridMatches& matches, const GridOf& grid_of, double focal_length,
                                              Correspondences& c) noexcept {
  bool one_grid = true;
  for (std::size_t i = 1; i < matches.count; ++i) one_grid &= matches.grid[i] == matches.grid[0];
  if (one_grid)
    detail::correspond_on_one(matches, grid_of(matches.grid[0]), focal_length, c);
  else
    detail::correspond_on_several(matches, grid_of, focal_length, c);
}

}  // namespace evmarker
