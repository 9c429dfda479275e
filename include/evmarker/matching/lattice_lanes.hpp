#pragma once
// A code marker's lattice for many events at once: the lines next to them.
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/matching/event_group.hpp"
#include "evmarker/matching/projected_lattice.hpp"

namespace evmarker {

/// The lines of a lattice that are nearest to each of some events: of both coordinates.
struct LatticeLines {
  static constexpr std::size_t kMost = 5 * kLanes;
  using Numbers = std::array<double, kMost>;
  alignas(64) std::array<Numbers, 2> k, squared;  ///< number of the line, squared distance
  alignas(64) std::array<Numbers, 2> place;  ///< of the foot: twice its cell; around a lattice point, once each of both
  alignas(64) Numbers within;                ///< 1 if the event is so near to the marker, else 0
  alignas(64) Numbers exists;                ///< 1 if both feet are before the horizon, else 0
};

/// What `ProjectedLattice` says of some of the events: of `count` from `first` on.
/// @param fringe cells around the marker that still count as within
/// @param margin of a cell that counts as around a lattice point
[[gnu::always_inline]] inline void nearest_lines(const ProjectedLattice& lattice, double fringe, double margin,
                                                 const EventGroup& events, std::size_t first, std::size_t count,
                                                 LatticeLines& lines) noexcept {
  constexpr double kRounding = ProjectedLattice::kRounding;
  // Copies: the compiler cannot know that the results are not written over the originals.
  const double cells = lattice.cells(), centre = cells / 2, reach = centre + fringe;
  const double before = 0.5 - margin, behind = 0.5 + margin;
  const double w_x = lattice.row_w().x(), w_y = lattice.row_w().y(), w_z = lattice.row_w().z();
  const double x_x = lattice.rows()(0, 0), x_y = lattice.rows()(0, 1), x_z = lattice.rows()(0, 2);
  const double y_x = lattice.rows()(1, 0), y_y = lattice.rows()(1, 1), y_z = lattice.rows()(1, 2);
  const double *const event_x = &events.x[first], *const event_y = &events.y[first];
  for (std::size_t from = 0; from < count; from += kLanes)
    for (std::size_t i = from; i < from + kLanes; ++i) {
      const double x = event_x[i], y = event_y[i];
      const double a_x = x_x * x + x_y * y + x_z, a_y = y_x * x + y_y * y + y_z, w = w_x * x + w_y * y + w_z;
      const double from_centre = larger(std::abs(a_x - centre * w), std::abs(a_y - centre * w)), by_w = 1 / w;
      lines.within[i] = from_centre < reach * w ? 1 : 0;
      double exists = 1;
      const auto nearest = [&](std::size_t c, double row_x, double row_y, double a, double along_x, double along_y,
                               double a_along) __attribute__((always_inline)) {
        const double k = (smaller(larger(a * by_w, 0), cells) + kRounding) - kRounding;
        const double e = a - k * w, normal_x = row_x - k * w_x, normal_y = row_y - k * w_y;
        const double norm2 = normal_x * normal_x + normal_y * normal_y;
        const double foot_a = norm2 * a_along - e * (along_x * normal_x + along_y * normal_y);
        const double foot_w = norm2 * w - e * (w_x * normal_x + w_y * normal_y);
        const double inverse = 1 / (norm2 * foot_w);
        lines.k[c][i] = k;
        lines.squared[c][i] = e * e * foot_w * inverse;
        const double foot = smaller(larger(foot_a * norm2 * inverse, -0.5), cells + 0.5);
        lines.place[c][i] = ((foot - before) + kRounding) - kRounding + (((foot - behind) + kRounding) - kRounding);
        exists = foot_w > 0 ? exists : 0;
      };
      nearest(0, x_x, x_y, a_x, y_x, y_y, a_y);
      nearest(1, y_x, y_y, a_y, x_x, x_y, a_x);
      lines.exists[i] = exists;
    }
}

}  // namespace evmarker
