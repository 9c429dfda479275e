#pragma once
// Eqs. (1) to (5) for events and the edges of a code marker's grid that they match.
#include <cmath>
#include <cstddef>

#include "evmarker/matching/closest_points.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/matching/grid_edges.hpp"
#include "evmarker/matching/projected_grid.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// An event and an edge of the grid.
struct OnGridEdge {
  double distance_px;    ///< Eq. (1), positive on the dark side
  Vec2 normal;           ///< of the edge's image, toward its dark side
  Vec3 gradient;         ///< how far E moves along it, by E [px/m]
  ClosestPoints points;  ///< Eqs. (3) to (5)
};

/// @param line of the edge in the image, not of unit length, toward larger coordinates
/// @param toward_dark one over its length, negative if the dark side is that of smaller coordinates
/// @param V,S where the grid line has its zero, and the step along it to the next cell [m]
/// @param m line of sight (m; 1)
[[gnu::always_inline]] inline OnGridEdge on_grid_edge(Vec3 line, double toward_dark, Vec3 V, Vec3 S, double begin,
                                                      double end, Vec2 m, double focal_length) noexcept {
  const Vec3 unit = toward_dark * line;
  const Vec2 normal{unit.x, unit.y};
  const ClosestPoints points = closest_points(V, S, begin, end, {m.x, m.y, 1});
  return {focal_length * line_distance(unit, m), normal, image_gradient(normal, points.E, focal_length), points};
}

/// Of one event. False if the edge points at the camera: the event says nothing then.
[[gnu::always_inline]] inline bool correspond(const ProjectedGrid& grid, const GridEdges::Stretch& edge, Vec2 m,
                                              double focal_length, Correspondence& c) noexcept {
  const auto i = static_cast<std::size_t>(edge.coordinate);
  const Vec3 line = grid.row(i) - edge.line * grid.row_w();
  const OnGridEdge on =
      on_grid_edge(line, edge.dark / std::sqrt(line.x * line.x + line.y * line.y),
                   grid.corner() + edge.line * grid.step(i), grid.step(1 - i), edge.begin, edge.end, m, focal_length);
  c.segment = edge.segment;
  c.distance_px = on.distance_px;
  c.squared_px = on.distance_px * on.distance_px;
  c.normal = on.normal;
  c.dark_side_known = true;
  c.gradient = on.gradient;
  c.M = {m.x, m.y, 1};
  c.E = on.points.E;
  c.F = on.points.F;
  return on.points.exist;
}

/// Events that were matched to edges of the grid, number by number.
struct GridMatches {
  alignas(64) simd::Lanes x{}, y{}, t{}, polarity{};                  ///< line of sight (x, y; 1), time [us], see Event
  alignas(64) simd::Lanes coordinate{}, k{}, begin{}, end{}, dark{};  ///< of the edge, as in GridEdges::Stretch
  std::size_t count = 0;

  void set(std::size_t i, double m_x, double m_y, Timestamp time, double sign,
           const GridEdges::Stretch& edge) noexcept {
    x[i] = m_x;
    y[i] = m_y;
    t[i] = static_cast<double>(time);
    polarity[i] = sign;
    coordinate[i] = static_cast<double>(edge.coordinate);
    k[i] = edge.line;
    begin[i] = edge.begin;
    end[i] = edge.end;
    dark[i] = edge.dark;
  }
};

/// Batch version of `correspond`.
[[gnu::always_inline]] inline void correspond(const ProjectedGrid& grid, const GridMatches& matches,
                                              double focal_length, Correspondences& c) noexcept {
  // Copies, see nearest_lines.
  const Vec3 rows[2] = {grid.row(0), grid.row(1)}, steps[2] = {grid.step(0), grid.step(1)};
  const Vec3 corner = grid.corner(), row_w = grid.row_w();
  // The first or the second of two: a weighted sum, as conditions have the compiler make branches of the loop.
  const auto select = [](double second, const Vec3* two) __attribute__((always_inline)) {
    return (1 - second) * two[0] + second * two[1];
  };
  alignas(64) simd::Lanes norm;
  for (std::size_t i = 0; i < simd::kLanes; ++i) {
    const Vec3 line = select(matches.coordinate[i], rows) - matches.k[i] * row_w;
    norm[i] = line.x * line.x + line.y * line.y;
  }
  simd::square_roots(norm);
  for (std::size_t i = 0; i < simd::kLanes; ++i) {
    const double is_y = matches.coordinate[i], k = matches.k[i];
    const Vec2 m{matches.x[i], matches.y[i]};
    const OnGridEdge on =
        on_grid_edge(select(is_y, rows) - k * row_w, matches.dark[i] / norm[i], corner + k * select(is_y, steps),
                     select(1 - is_y, steps), matches.begin[i], matches.end[i], m, focal_length);
    c.t[i] = matches.t[i];
    c.polarity[i] = matches.polarity[i];
    c.distance_px[i] = on.distance_px;
    c.M_x[i] = m.x;
    c.M_y[i] = m.y;
    c.F_x[i] = on.points.F.x;
    c.F_y[i] = on.points.F.y;
    c.F_z[i] = on.points.F.z;
    c.E_x[i] = on.points.E.x;
    c.E_y[i] = on.points.E.y;
    c.E_z[i] = on.points.E.z;
    c.g_x[i] = on.gradient.x;
    c.g_y[i] = on.gradient.y;
    c.g_z[i] = on.gradient.z;
  }
  c.set_count(matches.count);
}

}  // namespace evmarker
