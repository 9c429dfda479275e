#pragma once
// Floor 1. The edges of a square code marker by line and cell of its lattice.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "evmarker/marker_model.hpp"

namespace evmarker {

/// What lies on every line of a code marker's lattice of cells. Lattice coordinates are counted in cells from the
/// marker's top left corner: x (coordinate 0) to the right, y (coordinate 1) down. A line of coordinate 0 is vertical.
/// Copies share the table.
class CellLattice {
 public:
  /// The piece of a line beside one cell.
  struct Edge {
    std::int16_t segment = -1;        ///< the segment of the model that it is part of, -1 where there is no edge
    std::int16_t dark = 0;            ///< +1 if the side of larger coordinate is the dark one, -1 the other, 0 no edge
    std::int16_t begin = 0, end = 0;  ///< where that segment begins and ends on the line [cells]
  };

  /// Nothing for a wireframe that does not lie, without overlaps and with known dark sides, on the lines of a lattice
  /// of `model.cells` by `model.cells` cells.
  static std::optional<CellLattice> of(const MarkerModel& model) {
    CellLattice lattice;
    if (model.cells < 1 || model.cells > 1000) return std::nullopt;
    lattice.cells_ = model.cells;
    double half_length = 0;
    for (const Eigen::Vector3d& vertex : model.vertices) half_length = std::max(half_length, vertex.x());
    lattice.cell_length_m_ = 2 * half_length / model.cells;
    std::vector<Edge> edges(2 * static_cast<std::size_t>((model.cells + 1) * (model.cells + 2)));
    for (std::size_t i = 0; i < model.segments.size(); ++i)
      if (!lattice.add(model, i, edges)) return std::nullopt;
    lattice.edges_ = std::make_shared<const std::vector<Edge>>(std::move(edges));
    return lattice;
  }

  /// Cells along a side, the black border included.
  int cells() const noexcept { return cells_; }
  double cell_length_m() const noexcept { return cell_length_m_; }

  /// @param line 0 to cells()
  /// @param cell along the line, -1 to cells(): beyond the ends of the line there is no edge
  const Edge& edge(Eigen::Index coordinate, int line, int cell) const noexcept {
    return (*edges_)[index(coordinate, line, cell)];
  }

 private:
  std::size_t index(Eigen::Index coordinate, int line, int cell) const noexcept {
    return (static_cast<std::size_t>(coordinate) * static_cast<std::size_t>(cells_ + 1) +
            static_cast<std::size_t>(line)) *
               static_cast<std::size_t>(cells_ + 2) +
           static_cast<std::size_t>(cell + 1);
  }

  bool add(const MarkerModel& model, std::size_t i, std::vector<Edge>& edges) const {
    const MarkerSegment& segment = model.segments[i];
    const auto from = place(model.vertices[static_cast<std::size_t>(segment.from)]);
    const auto to = place(model.vertices[static_cast<std::size_t>(segment.to)]);
    if (!from || !to || i > INT16_MAX) return false;
    const Eigen::Vector3d& normal = segment.face_normal;
    if (normal.x() != 0 || normal.y() != 0 || normal.z() < 0) return false;  // not what the front shows
    const std::size_t along = (*from)[0] == (*to)[0] ? 1 : 0, across = 1 - along;
    if ((*from)[across] != (*to)[across]) return false;
    // Lattice y runs down, the marker's up.
    const double dark = across == 0 ? segment.dark_side.x() : -segment.dark_side.y();
    if (std::abs(dark) != segment.dark_side.norm() || dark == 0) return false;

    const auto [begin, end] = std::minmax({(*from)[along], (*to)[along]});
    for (int cell = begin; cell < end; ++cell) {
      Edge& edge = edges[index(static_cast<Eigen::Index>(across), (*from)[across], cell)];
      if (edge.dark != 0) return false;
      edge = {static_cast<std::int16_t>(i), static_cast<std::int16_t>(dark > 0 ? 1 : -1),
              static_cast<std::int16_t>(begin), static_cast<std::int16_t>(end)};
    }
    return begin < end;
  }

  // Lattice coordinates of a vertex, if it lies on a lattice point.
  std::optional<std::array<int, 2>> place(const Eigen::Vector3d& vertex) const {
    const double x = vertex.x() / cell_length_m_ + cells_ / 2.0, y = cells_ / 2.0 - vertex.y() / cell_length_m_;
    const bool on_point = vertex.z() == 0 && std::abs(x - std::round(x)) < 1e-9 && std::abs(y - std::round(y)) < 1e-9;
    if (!on_point || std::min(x, y) < -0.5 || std::max(x, y) > cells_ + 0.5) return std::nullopt;
    return std::array{static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y))};
  }

  int cells_ = 0;
  double cell_length_m_ = 0;
  std::shared_ptr<const std::vector<Edge>> edges_;
};

}  // namespace evmarker
