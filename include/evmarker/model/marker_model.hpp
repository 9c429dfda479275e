#pragma once
// Markers as wireframes: the edges at which they make events.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/base/vector.hpp"

namespace evmarker {

/// One straight edge between two vertices, given by their indices. `dark_side` is the unit vector [marker frame],
/// perpendicular to the edge, that points into the darker of the two areas it separates; zero if that is not known.
/// `face_normal` [marker frame] points out of the face that the edge is printed on, which hides it from behind; zero
/// for an edge that is visible from everywhere.
struct MarkerSegment {
  int from = 0;
  int to = 0;
  Eigen::Vector3d dark_side = Eigen::Vector3d::Zero();
  Eigen::Vector3d face_normal = Eigen::Vector3d::Zero();
};

/// True if the camera sees the front of the face that an edge is on, or the edge is on no face.
/// @param point any point of the edge [m, camera frame]
inline bool faces_camera(const MarkerSegment& segment, const Vec3& point,
                         const Eigen::Isometry3d& T_camera_marker) noexcept {
  const Vec3 normal = segment.face_normal;
  return squared_norm(normal) == 0 || dot(rotate(T_camera_marker, normal), point) < 0;
}

/// The cells inside a code marker's black border: rows from top to bottom, 1 white, 0 black.
using CodeBits = Eigen::Matrix<std::uint8_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A square code marker on a model.
struct PlacedCode {
  double length = 0;  ///< side of the black square [m]
  CodeBits bits;
  Eigen::Isometry3d T_model_code = Eigen::Isometry3d::Identity();
};

/// Any 2-D or 3-D wireframe: vertices [m] in the marker frame (origin in the centre, x right, y up, z out of the
/// marker) and the edges between them.
struct MarkerModel {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<MarkerSegment> segments;
  /// Cells along a side of a square code marker, border included, if all edges lie on the lines of its grid of cells; 0
  /// for any other wireframe.
  int cells = 0;
  /// The code markers of a board, if all its edges are theirs and ordered by marker; empty for any other wireframe.
  /// With them, events are matched faster.
  std::vector<PlacedCode> codes = {};
};

namespace detail {

inline void require_marker_length(double length, const char* field = "length") {
  if (!(std::isfinite(length) && length > 0))
    throw std::invalid_argument(std::string("marker ") + field + " must be a positive number of metres, not " +
                                number_text(length));
}

inline bool is_unit_or_zero(const Eigen::Vector3d& direction) noexcept {
  const double length = norm(Vec3(direction));
  return length == 0 || std::abs(length - 1) < 1e-6;
}

}  // namespace detail

/// Checks that a wireframe has edges, that each has two vertices and a length, and that directions are unit vectors.
/// @throws std::invalid_argument naming the vertex or the segment that is wrong
inline void validate(const MarkerModel& model) {
  if (model.segments.empty()) throw std::invalid_argument("marker model: no segments");
  for (std::size_t i = 0; i < model.vertices.size(); ++i)
    if (!is_finite(Vec3(model.vertices[i])))
      throw std::invalid_argument("marker model: vertex " + std::to_string(i) + " is not finite");
  const auto known = [&](int index) { return index >= 0 && index < static_cast<int>(model.vertices.size()); };
  for (std::size_t i = 0; i < model.segments.size(); ++i) {
    const auto& [from, to, dark_side, face_normal] = model.segments[i];
    const auto fail = [&](const std::string& why) {
      throw std::invalid_argument("marker model: segment " + std::to_string(i) + why);
    };
    const auto require_direction = [&](const Eigen::Vector3d& direction, const char* field) {
      if (!detail::is_unit_or_zero(direction))
        fail(std::string(": ") + field + " has length " + number_text(norm(Vec3(direction))) +
             ", not 1 or, where unknown, 0");
    };
    if (!known(from) || !known(to))
      fail(" joins vertices " + std::to_string(from) + " and " + std::to_string(to) + " of " +
           std::to_string(model.vertices.size()));
    const auto vertex = [&](int index) { return Vec3(model.vertices[static_cast<std::size_t>(index)]); };
    if (squared_norm(vertex(from) - vertex(to)) == 0) fail(" has no length");
    require_direction(dark_side, "dark_side");
    require_direction(face_normal, "face_normal");
  }
}

/// The outline of a dark square of side `length` [m]: four corners from the top left clockwise, four edges, dark
/// inside, visible from the front only.
/// @throws std::invalid_argument if the length is not positive
inline MarkerModel make_square_marker(double length) {
  detail::require_marker_length(length);
  const double h = length / 2;
  return {{{-h, h, 0}, {h, h, 0}, {h, -h, 0}, {-h, -h, 0}},
          {{0, 1, {0, -1, 0}, Eigen::Vector3d::UnitZ()},
           {1, 2, {-1, 0, 0}, Eigen::Vector3d::UnitZ()},
           {2, 3, {0, 1, 0}, Eigen::Vector3d::UnitZ()},
           {3, 0, {1, 0, 0}, Eigen::Vector3d::UnitZ()}},
          1};
}

/// The outline of a dark rectangle, `width` along x by `height` along y [m], otherwise as `make_square_marker`.
/// @throws std::invalid_argument naming the side that is not positive
inline MarkerModel make_rectangle_marker(double width, double height) {
  detail::require_marker_length(width, "width");
  detail::require_marker_length(height, "height");
  if (width == height) return make_square_marker(width);  // by its grid, a square is matched faster
  MarkerModel model = make_square_marker(1);
  for (Eigen::Vector3d& vertex : model.vertices) vertex = {width * vertex.x(), height * vertex.y(), 0};
  model.cells = 0;
  return model;
}

namespace detail {

// Whether a cell of a code marker is white. Row 0 and column 0 are the border, which is black; all outside is white.
inline bool is_white(const CodeBits& bits, int row, int column) {
  const int last = static_cast<int>(bits.rows()) + 1;
  if (row < 0 || row > last || column < 0 || column > last) return true;
  if (row == 0 || row == last || column == 0 || column == last) return false;
  return bits(row - 1, column - 1) != 0;
}

}  // namespace detail

/// The outline of a black-bordered code marker (ArUco, AprilTag) and every edge between its black and white cells.
/// @param length side of the black square [m]
/// @param bits the cells inside its border, which is one cell wide
/// @throws std::invalid_argument if the length is not positive or the bits are not a square
inline MarkerModel make_code_marker(double length, const CodeBits& bits) {
  detail::require_marker_length(length);
  if (bits.rows() < 1 || bits.rows() != bits.cols())
    throw std::invalid_argument("marker code must be a square of cells, not " + std::to_string(bits.rows()) + " x " +
                                std::to_string(bits.cols()));
  const int cells = static_cast<int>(bits.rows()) + 2;
  const auto white = [&](int row, int column) { return detail::is_white(bits, row, column); };
  const Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  MarkerModel model;
  model.cells = cells;
  // Index of the vertex at a grid point, which is added if it is new.
  const auto corner = [&](int row, int column) {
    const double cell = length / cells;
    const Eigen::Vector3d vertex(column * cell - length / 2, length / 2 - row * cell, 0);
    for (std::size_t i = 0; i < model.vertices.size(); ++i)
      if (squared_norm(Vec3(model.vertices[i]) - Vec3(vertex)) == 0) return static_cast<int>(i);
    model.vertices.push_back(vertex);
    return static_cast<int>(model.vertices.size()) - 1;
  };
  // Along each grid line, join neighbouring cell edges that are dark on the same side into one segment.
  const auto add_line = [&](int line, bool horizontal) {
    // -1: dark before the line (above or left of it), +1: after it, 0: no edge.
    const auto dark = [&](int along) {
      const bool before = horizontal ? white(line - 1, along) : white(along, line - 1);
      const bool after = horizontal ? white(line, along) : white(along, line);
      return static_cast<int>(before) - static_cast<int>(after);
    };
    for (int begin = 0, end = 0; begin < cells; begin = end) {
      const int side = dark(begin);
      for (end = begin + 1; end < cells && dark(end) == side;) ++end;
      if (side == 0) continue;
      if (horizontal)
        model.segments.push_back({corner(line, begin), corner(line, end), Eigen::Vector3d(0, -side, 0), normal});
      else
        model.segments.push_back({corner(begin, line), corner(end, line), Eigen::Vector3d(side, 0, 0), normal});
    }
  };
  for (int line = 0; line <= cells; ++line) {
    add_line(line, true);
    add_line(line, false);
  }
  return model;
}

/// The marker of a board, by its place in `codes`, that each segment belongs to; 0 for all segments of any other
/// wireframe.
inline std::vector<std::size_t> marker_of_segments(const MarkerModel& model) {
  std::vector<std::size_t> markers;
  for (std::size_t i = 0; i < model.codes.size(); ++i)
    markers.insert(markers.end(), make_code_marker(model.codes[i].length, model.codes[i].bits).segments.size(), i);
  if (markers.size() != model.segments.size()) markers.assign(model.segments.size(), 0);
  return markers;
}

/// The centre of the box around all vertices [m, marker frame]; there must be at least one.
inline Eigen::Vector3d centre(const MarkerModel& model) noexcept {
  Vec3 low = model.vertices.front(), high = low;
  for (const Vec3 v : model.vertices) {
    low = {std::min(low.x, v.x), std::min(low.y, v.y), std::min(low.z, v.z)};
    high = {std::max(high.x, v.x), std::max(high.y, v.y), std::max(high.z, v.z)};
  }
  return (low + high) / 2;
}

}  // namespace evmarker
