#include "evmarker/matching/grid_edges.hpp"

#include <doctest/doctest.h>

#include <limits>

using evmarker::CodeBits;
using evmarker::GridEdges;
using evmarker::make_code_marker;
using evmarker::make_square_marker;
using evmarker::MarkerModel;

namespace {

CodeBits bits() {
  CodeBits bits(4, 4);
  bits << 1, 1, 0, 0, 0, 1, 0, 0, 1, 1, 1, 1, 0, 0, 1, 0;
  return bits;
}

}  // namespace

TEST_CASE("every border between a black and a white cell is an edge, dark on its black side, and nothing else is") {
  const CodeBits code = bits();
  const MarkerModel model = make_code_marker(0.12, code);
  const auto grid = GridEdges::of(model);
  REQUIRE(grid);
  CHECK(grid->cells() == 6);
  CHECK(grid->cell_length_m() == doctest::Approx(0.02));
  const auto black = [&](int row, int column) {
    if (row < 0 || column < 0 || row > 5 || column > 5) return 0;
    const bool border = row == 0 || column == 0 || row == 5 || column == 5;
    return border || code(row - 1, column - 1) == 0 ? 1 : 0;
  };
  int edges = 0;
  for (int line = 0; line <= 6; ++line)
    for (int cell = -1; cell <= 6; ++cell) {
      const auto& vertical = grid->edge(0, line, cell);
      const auto& horizontal = grid->edge(1, line, cell);
      CHECK(vertical.dark == black(cell, line) - black(cell, line - 1));
      CHECK(horizontal.dark == black(line, cell) - black(line - 1, cell));
      for (const auto* edge : {&vertical, &horizontal}) {
        CHECK((edge->segment >= 0) == (edge->dark != 0));
        if (edge->dark == 0) continue;
        ++edges;
        CHECK(edge->begin <= cell);
        CHECK(cell < edge->end);
        // The segment lies where the table says: grid x to the right, y down from the top left corner.
        const auto& segment = model.segments[static_cast<std::size_t>(edge->segment)];
        for (const int index : {segment.from, segment.to}) {
          const Eigen::Vector3d& vertex = model.vertices[static_cast<std::size_t>(index)];
          const double x = (vertex.x() + 0.06) / 0.02, y = (0.06 - vertex.y()) / 0.02;
          const double across = edge == &vertical ? x : y, along = edge == &vertical ? y : x;
          CHECK(across == doctest::Approx(line));
          CHECK((std::abs(along - edge->begin) < 1e-9 || std::abs(along - edge->end) < 1e-9));
        }
      }
    }
  CHECK(edges > 24);
}

TEST_CASE("a stretch tells of its cell, and around a grid point only where no edge ends there") {
  const auto grid = GridEdges::of(make_code_marker(0.12, bits()));
  REQUIRE(grid);
  const double infinity = std::numeric_limits<double>::infinity();
  int ends = 0, in_the_middle = 0;
  for (std::size_t coordinate = 0; coordinate < 2; ++coordinate)
    for (int line = 0; line <= 6; ++line)
      for (int cell = -1; cell <= 6; ++cell) {
        const auto& edge = grid->edge(coordinate, line, cell);
        const auto& stretch = grid->stretch(coordinate, line, cell);
        CHECK(stretch.segment == edge.segment);
        CHECK(stretch.dark == edge.dark);
        CHECK(stretch.begin == edge.begin);
        CHECK(stretch.end == edge.end);
        CHECK(stretch.at_least == (edge.dark != 0 ? 0 : infinity));
        CHECK(stretch.at_most == stretch.at_least);
        if (cell == 6) continue;
        const auto& point = *(&stretch + 1);
        CHECK(&grid->stretch(coordinate, line, cell + 1) == &point + 1);
        if (grid->edge(coordinate, line, cell + 1).segment == edge.segment) {
          in_the_middle += edge.dark != 0;
          CHECK(point.segment == edge.segment);
          CHECK(point.at_most == stretch.at_most);
        } else {
          ++ends;
          CHECK(point.at_least == 0);
          CHECK(point.at_most == infinity);
        }
      }
  CHECK(ends > 18);
  CHECK(in_the_middle > 10);
}

TEST_CASE("a plain square is a grid of one cell") {
  const auto grid = GridEdges::of(make_square_marker(0.1));
  REQUIRE(grid);
  CHECK(grid->cells() == 1);
  CHECK(grid->edge(0, 0, 0).dark == 1);
  CHECK(grid->edge(0, 1, 0).dark == -1);
  CHECK(grid->edge(1, 0, 0).dark == 1);
  CHECK(grid->edge(1, 1, 0).dark == -1);
}

TEST_CASE("a wireframe that is not such a grid is none") {
  const MarkerModel code = make_code_marker(0.12, bits());
  REQUIRE(GridEdges::of(code));
  MarkerModel changed = code;
  changed.cells = 0;  // it does not say so
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.cells = 5;
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.vertices[2].y() += 1e-4;
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.vertices[2].z() = 1e-4;
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.segments[3].dark_side.setZero();
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.segments[3].dark_side = {0.6, 0.8, 0};
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.segments.push_back(changed.segments[0]);  // twice
  CHECK_FALSE(GridEdges::of(changed));
  changed = code;
  changed.segments.push_back({0, 2, {1, 0, 0}});
  changed.vertices[2] = {0.06, -0.06, 0};  // a diagonal
  CHECK_FALSE(GridEdges::of(changed));
  CHECK_FALSE(GridEdges::of({}));
}

TEST_CASE("a code of many cells is no grid, whose table would take too much memory, and is matched without one") {
  for (const int cells : {62, 63, 998}) {  // and the border
    CAPTURE(cells);
    CodeBits bits = CodeBits::Ones(cells, cells);
    const MarkerModel model = make_code_marker(0.1, bits);
    CHECK(GridEdges::of(model).has_value() == (cells == 62));
  }
}
