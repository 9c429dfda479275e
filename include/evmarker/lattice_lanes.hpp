#pragma once
// Floor 2. Code markers' lattices for many events at once: the lines next to them, and what matches mean in space.
#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/cell_lattice.hpp"
#include "evmarker/correspondences.hpp"
#include "evmarker/event_group.hpp"
#include "evmarker/projected_lattice.hpp"

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

/// Events that were matched to edges of the lattice, number by number.
struct LatticeMatches {
  alignas(64) Lanes x{}, y{}, t{};                              ///< line of sight (x, y; 1) and time [us]
  alignas(64) Lanes coordinate{}, k{}, begin{}, end{}, dark{};  ///< of the edge, as in CellLattice::Stretch
  std::size_t count = 0;

  void set(std::size_t i, double m_x, double m_y, Timestamp time, const CellLattice::Stretch& edge) noexcept {
    x[i] = m_x;
    y[i] = m_y;
    t[i] = static_cast<double>(time);
    coordinate[i] = static_cast<double>(edge.coordinate);
    k[i] = edge.line;
    begin[i] = edge.begin;
    end[i] = edge.end;
    dark[i] = edge.dark;
  }
};

namespace detail {

// Chooses between numbers of both coordinates, one of which has the weight 1 and the other 0: conditions have the
// compiler make branches of a loop.
struct OfCoordinate {
  double first, second;
  double operator()(double of_first, double of_second) const noexcept { return first * of_first + second * of_second; }
};

}  // namespace detail

/// What the matches say in space, Eqs. (1) to (5).
[[gnu::always_inline]] inline void correspond(const ProjectedLattice& lattice, const LatticeMatches& matches,
                                              double focal_length, Correspondences& c) noexcept {
  const auto rows = lattice.rows();  // copies: see nearest_lines
  const auto steps = lattice.steps();
  const Eigen::Vector3d h0 = lattice.corner(), row_w = lattice.row_w();
  alignas(64) Lanes normal_x, normal_y, norm;
  for (std::size_t i = 0; i < kLanes; ++i) {
    const detail::OfCoordinate of{1 - matches.coordinate[i], matches.coordinate[i]};
    normal_x[i] = of(rows(0, 0), rows(1, 0)) - matches.k[i] * row_w.x();
    normal_y[i] = of(rows(0, 1), rows(1, 1)) - matches.k[i] * row_w.y();
  }
  using Array = Eigen::Array<double, kLanes, 1>;
  Eigen::Map<Array>(norm.data()) =
      (Eigen::Map<Array>(normal_x.data()).square() + Eigen::Map<Array>(normal_y.data()).square()).sqrt();
  for (std::size_t i = 0; i < kLanes; ++i) {
    const detail::OfCoordinate of{1 - matches.coordinate[i], matches.coordinate[i]};
    const double k = matches.k[i], x = matches.x[i], y = matches.y[i];
    const double toward_dark = matches.dark[i] / norm[i];
    const double n_x = toward_dark * normal_x[i], n_y = toward_dark * normal_y[i];
    const double n_z = toward_dark * (of(rows(0, 2), rows(1, 2)) - k * row_w.z());
    // B + a2 D: D along the line, a cell long, B on its zero.
    const double D_x = of(steps(0, 1), steps(0, 0)), B_x = h0.x() + k * of(steps(0, 0), steps(0, 1));
    const double D_y = of(steps(1, 1), steps(1, 0)), B_y = h0.y() + k * of(steps(1, 0), steps(1, 1));
    const double D_z = of(steps(2, 1), steps(2, 0)), B_z = h0.z() + k * of(steps(2, 0), steps(2, 1));
    const double MM = x * x + y * y + 1, MD = x * D_x + y * D_y + D_z, MB = x * B_x + y * B_y + B_z;
    const double DD = D_x * D_x + D_y * D_y + D_z * D_z, DB = D_x * B_x + D_y * B_y + D_z * B_z;
    const double a2 = smaller(larger((MD * MB - MM * DB) / (MM * DD - MD * MD), matches.begin[i]), matches.end[i]);
    const double a1 = (MB + a2 * MD) / MM;  // E on the line of sight
    const double E_x = B_x + a2 * D_x, E_y = B_y + a2 * D_y, E_z = B_z + a2 * D_z;
    const double inverse_z = 1 / E_z, scale = focal_length * inverse_z;
    c.t[i] = matches.t[i];
    c.distance_px[i] = focal_length * (n_x * x + n_y * y + n_z);
    c.M_x[i] = x;
    c.M_y[i] = y;
    c.F_x[i] = a1 * x;
    c.F_y[i] = a1 * y;
    c.F_z[i] = a1;
    c.E_x[i] = E_x;
    c.E_y[i] = E_y;
    c.E_z[i] = E_z;
    c.g_x[i] = scale * n_x;
    c.g_y[i] = scale * n_y;
    c.g_z[i] = -scale * inverse_z * (n_x * E_x + n_y * E_y);
  }
  c.set_count(matches.count);
}

}  // namespace evmarker
