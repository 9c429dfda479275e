#pragma once
// What it means in space that events match edges of a code marker's lattice, Eqs. (1) to (5).
#include <Eigen/Core>
#include <cmath>
#include <cstddef>

#include "evmarker/matching/cell_lattice.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/matching/projected_lattice.hpp"

namespace evmarker {

/// Of one event with line of sight (m; 1). False if the edge points at the camera: it says nothing then.
[[gnu::always_inline]] inline bool correspond(const ProjectedLattice& lattice, const CellLattice::Stretch& edge,
                                              const Eigen::Vector2d& m, double focal_length,
                                              Correspondence& c) noexcept {
  const auto [E, F, exists] = lattice.nearest_points(edge.coordinate, edge.line, edge.begin, edge.end, m);
  const Eigen::Index i = edge.coordinate;
  const auto& rows = lattice.rows();
  const auto& row_w = lattice.row_w();
  const double n_x = rows(i, 0) - edge.line * row_w.x(), n_y = rows(i, 1) - edge.line * row_w.y(),
               n_z = rows(i, 2) - edge.line * row_w.z();
  const double toward_dark = edge.dark / std::sqrt(n_x * n_x + n_y * n_y);
  c.segment = edge.segment;
  c.distance_px = focal_length * toward_dark * (n_x * m.x() + n_y * m.y() + n_z);
  c.squared_px = c.distance_px * c.distance_px;
  c.normal = {toward_dark * n_x, toward_dark * n_y};
  c.dark_side_known = true;
  c.M = {m.x(), m.y(), 1};
  c.E = E;
  c.F = F;
  const double inverse_z = 1 / E.z(), scale = focal_length * inverse_z;
  c.gradient = {scale * c.normal.x(), scale * c.normal.y(),
                -scale * inverse_z * (c.normal.x() * E.x() + c.normal.y() * E.y())};
  return exists;
}

/// Events that were matched to edges of the lattice, number by number.
struct LatticeMatches {
  alignas(64) Lanes x{}, y{}, t{}, polarity{};                  ///< line of sight (x, y; 1), time [us], see Event
  alignas(64) Lanes coordinate{}, k{}, begin{}, end{}, dark{};  ///< of the edge, as in CellLattice::Stretch
  std::size_t count = 0;

  void set(std::size_t i, double m_x, double m_y, Timestamp time, double sign,
           const CellLattice::Stretch& edge) noexcept {
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

namespace detail {

// Chooses between numbers of both coordinates, one of which has the weight 1 and the other 0: conditions have the
// compiler make branches of a loop.
struct OfCoordinate {
  double first, second;
  double operator()(double of_first, double of_second) const noexcept { return first * of_first + second * of_second; }
};

}  // namespace detail

/// The same of up to eight.
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
    c.polarity[i] = matches.polarity[i];
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
