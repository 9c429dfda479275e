#pragma once
// The edges of a square code marker by line and cell of its grid.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "evmarker/model/marker_model.hpp"

namespace evmarker {

/// The edges of a code marker on the lines of its grid of cells. Grid coordinates are counted in cells from the
/// marker's top left corner: x (coordinate 0) to the right, y (coordinate 1) down. A line of coordinate i is one on
/// which coordinate i is constant: those of coordinate 0 are vertical. Copies share the table.
class GridEdges {
 public:
  /// What lies on a line beside one cell: a piece of a segment, or nothing.
  struct Edge {
    std::int16_t segment = -1;        ///< the segment of the model that contains the piece, -1 where there is no edge
    std::int16_t dark = 0;            ///< +1 if the side of larger coordinate is dark, -1 the other one, 0 no edge
    std::int16_t begin = 0, end = 0;  ///< where that segment begins and ends on the line [cells]
  };

  /// A stretch of a line: beside one cell, or around one grid point. Around a point where an edge begins or ends, only
  /// the bounds are set.
  struct alignas(64) Stretch {
    // Bounds on the squared distance D2 of an event to the nearest edge of this stretch, by its squared distance L2 to
    // the line: max(L2, at_least) <= D2 <= max(L2, at_most). On an edge (0, 0): D2 = L2. Where there is none (inf,
    // inf). Around a point where an edge begins or ends (0, inf): only L2 <= D2 is known.
    double at_least = kNever, at_most = kNever;
    double line = 0;                            ///< number of the line
    double begin = 0, end = 0;                  ///< as in Edge
    double dark = 0;                            ///< as in Edge
    std::int32_t coordinate = 0, segment = -1;  ///< coordinate of the line; segment as in Edge
  };

  static constexpr int kMostCells = 64;  ///< along a side: a table of a megabyte; markers have up to ten

  /// The edges of a wireframe that lies, without overlaps and with known dark sides, on the lines of a grid of
  /// `model.cells` by `model.cells` cells; nothing for any other wireframe, or for more than kMostCells.
  static std::optional<GridEdges> of(const MarkerModel& model) {
    GridEdges grid;
    if (model.cells < 1 || model.cells > kMostCells) return std::nullopt;
    grid.cells_ = model.cells;
    double half_length = 0;
    for (const Eigen::Vector3d& vertex : model.vertices) half_length = std::max(half_length, vertex.x());
    grid.cell_length_m_ = 2 * half_length / model.cells;
    std::vector<Edge> edges(2 * static_cast<std::size_t>((model.cells + 1) * (model.cells + 2)));
    for (std::size_t i = 0; i < model.segments.size(); ++i)
      if (!grid.add_segment(model, i, edges)) return std::nullopt;
    grid.edges_ = std::make_shared<const std::vector<Edge>>(std::move(edges));
    grid.stretches_ = std::make_shared<const std::vector<Stretch>>(grid.all_stretches());
    return grid;
  }

  /// Cells along a side, the black border included.
  int cells() const noexcept { return cells_; }
  double cell_length_m() const noexcept { return cell_length_m_; }

  /// The piece of a line beside a cell.
  /// @param line 0 to cells()
  /// @param cell along the line, -1 to cells(): beyond the ends of the line there is no edge
  const Edge& edge(std::size_t coordinate, int line, int cell) const noexcept {
    return (*edges_)[index(coordinate, line, cell)];
  }

  /// All stretches, ordered by coordinate and line. Each line has `stretches_of_line()`: beside cell -1, around point
  /// 0, beside cell 0, around point 1, and so on to cell cells().
  const Stretch* stretches() const noexcept { return stretches_->data(); }
  int stretches_of_line() const noexcept { return 2 * cells_ + 3; }
  /// The stretch of a line beside a cell, -1 to cells().
  const Stretch& stretch(std::size_t coordinate, int line, int cell) const noexcept {
    return stretches()[(static_cast<int>(coordinate) * (cells_ + 1) + line) * stretches_of_line() + 2 * (cell + 1)];
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  std::vector<Stretch> all_stretches() const {
    std::vector<Stretch> all;
    for (std::size_t coordinate = 0; coordinate < 2; ++coordinate)
      for (int line = 0; line <= cells_; ++line)
        for (int cell = -1; cell <= cells_; ++cell) {
          const Edge& here = edge(coordinate, line, cell);
          const double distance = here.dark != 0 ? 0 : kNever;
          all.push_back({distance, distance, static_cast<double>(line), static_cast<double>(here.begin),
                         static_cast<double>(here.end), static_cast<double>(here.dark),
                         static_cast<std::int32_t>(coordinate), here.segment});
          if (cell == cells_) break;
          const bool goes_on = here.segment == edge(coordinate, line, cell + 1).segment;
          all.push_back(goes_on ? all.back() : Stretch{.at_least = 0});
        }
    return all;
  }

  std::size_t index(std::size_t coordinate, int line, int cell) const noexcept {
    return (coordinate * static_cast<std::size_t>(cells_ + 1) + static_cast<std::size_t>(line)) *
               static_cast<std::size_t>(cells_ + 2) +
           static_cast<std::size_t>(cell + 1);
  }

  // Writes segment i of a model into a table of edges. Returns false if it does not lie on the grid.
  bool add_segment(const MarkerModel& model, std::size_t i, std::vector<Edge>& edges) const {
    const MarkerSegment& segment = model.segments[i];
    const auto from = grid_point(model.vertices[static_cast<std::size_t>(segment.from)]);
    const auto to = grid_point(model.vertices[static_cast<std::size_t>(segment.to)]);
    if (!from || !to || i > INT16_MAX) return false;
    const Eigen::Vector3d& normal = segment.face_normal;
    if (normal.x() != 0 || normal.y() != 0 || normal.z() < 0) return false;  // not on the front
    const std::size_t along = (*from)[0] == (*to)[0] ? 1 : 0, across = 1 - along;
    if ((*from)[across] != (*to)[across]) return false;
    // Grid y runs down, the marker's up.
    const double dark = across == 0 ? segment.dark_side.x() : -segment.dark_side.y();
    if (std::abs(dark) != norm(Vec3(segment.dark_side)) || dark == 0) return false;

    const auto [begin, end] = std::minmax({(*from)[along], (*to)[along]});
    for (int cell = begin; cell < end; ++cell) {
      Edge& edge = edges[index(across, (*from)[across], cell)];
      if (edge.dark != 0) return false;
      edge = {static_cast<std::int16_t>(i), static_cast<std::int16_t>(dark > 0 ? 1 : -1),
              static_cast<std::int16_t>(begin), static_cast<std::int16_t>(end)};
    }
    return begin < end;
  }

  // Grid coordinates of a vertex; nothing if it does not lie on a grid point.
  std::optional<std::array<int, 2>> grid_point(const Eigen::Vector3d& vertex) const {
    const double x = vertex.x() / cell_length_m_ + cells_ / 2.0, y = cells_ / 2.0 - vertex.y() / cell_length_m_;
    const bool on_point = vertex.z() == 0 && std::abs(x - std::round(x)) < 1e-9 && std::abs(y - std::round(y)) < 1e-9;
    if (!on_point || std::min(x, y) < -0.5 || std::max(x, y) > cells_ + 0.5) return std::nullopt;
    return std::array{static_cast<int>(std::lround(x)), static_cast<int>(std::lround(y))};
  }

  int cells_ = 0;
  double cell_length_m_ = 0;
  std::shared_ptr<const std::vector<Edge>> edges_;
  std::shared_ptr<const std::vector<Stretch>> stretches_;
};

}  // namespace evmarker
