#pragma once
// Reading of wireframes from files.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/wireframe.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

namespace detail {

// An edge's field with the index of a vertex. `place` is the name of the edge in errors.
inline int read_vertex_number(const SettingsFile& file, const cv::FileNode& edge, const std::string& place,
                              const char* field, std::size_t vertices) {
  const int number = file.whole_number(file.field(edge, place, field), place + " " + field);
  if (number >= static_cast<int>(vertices))
    file.fail(place + " " + field + " is " + std::to_string(number) + ", but there are only " +
              std::to_string(vertices) + " vertices");
  return number;
}

// An edge's field with a direction, as a unit vector; zero if the file does not have it.
inline Eigen::Vector3d read_direction(const SettingsFile& file, const cv::FileNode& edge, const std::string& place,
                                      const char* field) {
  if (edge[field].empty()) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d direction = file.vector(edge[field], place + " " + field);
  if (!(direction.norm() > 0)) file.fail(place + " " + field + " is zero: leave it out where it is not known");
  return direction.normalized();
}

inline void require_known_fields(const SettingsFile& file, const cv::FileNode& edge, const std::string& place) {
  static constexpr std::array<std::string_view, 4> kKnown{"from", "to", "dark_side", "face_normal"};
  for (const std::string& name : edge.keys())
    if (std::ranges::find(kKnown, name) == kKnown.end())
      file.fail(place + " has a field " + name + ", which no edge has (from, to, dark_side, face_normal)");
}

inline MarkerSegment read_edge(const SettingsFile& file, const cv::FileNode& node, const std::string& place,
                               const std::vector<Eigen::Vector3d>& vertices) {
  if (!node.isMap()) file.fail(place + " is not a map of from and to");
  require_known_fields(file, node, place);
  MarkerSegment edge;
  edge.from = read_vertex_number(file, node, place, "from", vertices.size());
  edge.to = read_vertex_number(file, node, place, "to", vertices.size());
  const Eigen::Vector3d between =
      vertices[static_cast<std::size_t>(edge.to)] - vertices[static_cast<std::size_t>(edge.from)];
  if (!(between.norm() > 0)) file.fail(place + " has no length");
  const Eigen::Vector3d along = between.normalized();
  edge.dark_side = read_direction(file, node, place, "dark_side");
  edge.face_normal = read_direction(file, node, place, "face_normal");

  constexpr double kHardly = 0.1;  // sine of 6 degrees: more than rounding of the numbers in the file causes
  if (std::abs(edge.face_normal.dot(along)) > kHardly)
    file.fail(place + " face_normal is not perpendicular to the edge, which then is not on that face");
  if (edge.dark_side.isZero()) return edge;
  // The file may have any direction into the dark face, such as to its middle. Only its component across the edge says
  // on which side it is dark; if that is hardly there, the side is ambiguous.
  if (edge.dark_side.cross(along).norm() < kHardly)
    file.fail(place + " dark_side lies along the edge: it must point to one of its sides");
  edge.dark_side = (edge.dark_side - along * along.dot(edge.dark_side)).normalized();
  return edge;
}

}  // namespace detail

/// Reads a wireframe from a file with the fields `wireframe`, its id; `vertices`, a list of lists of three coordinates
/// [m]; `edges`, a list of maps `from`, `to` (numbers of vertices, from 0 on) and, where they are known, `dark_side` (a
/// vector from the edge into its darker side, of which the part across the edge counts) and `face_normal` (out of the
/// face that the edge is on, which hides it from behind); and, where it is known, `start`, a map of `rotation` (vector
/// along the axis, as long as the angle [rad]) and `translation` [m] of T_camera_wireframe at the first event.
/// @throws std::runtime_error naming file, vertex or edge, field and value
inline Wireframe load_wireframe(const std::string& path) {
  const detail::SettingsFile file("wireframe", path);
  Wireframe body;
  body.id = file.whole_number(file.required("wireframe"), "wireframe");
  const cv::FileNode vertices = file.required("vertices"), edges = file.required("edges");
  if (!vertices.isSeq()) file.fail("vertices is not a list");
  for (const cv::FileNode& node : vertices)
    body.model.vertices.push_back(file.vector(node, "vertices[" + std::to_string(body.model.vertices.size()) + "]"));
  if (!edges.isSeq()) file.fail("edges is not a list");
  for (const cv::FileNode& node : edges) {
    const std::string place = "edges[" + std::to_string(body.model.segments.size()) + "]";
    const MarkerSegment edge = detail::read_edge(file, node, place, body.model.vertices);
    // Events could not be assigned to one of two edges between the same vertices.
    for (std::size_t i = 0; i < body.model.segments.size(); ++i)
      if (std::minmax(edge.from, edge.to) == std::minmax(body.model.segments[i].from, body.model.segments[i].to))
        file.fail(place + " joins the same vertices as edges[" + std::to_string(i) + "]");
    body.model.segments.push_back(edge);
  }
  try {
    validate(body.model);
    if (file.has("start")) {
      const cv::FileNode node = file.required("start");
      if (!node.isMap()) file.fail("start is not a map of rotation and translation");
      Eigen::Isometry3d start = Eigen::Isometry3d::Identity();
      start.linear() = so3_exp(file.vector(file.field(node, "start", "rotation"), "start rotation"));
      start.translation() = file.vector(file.field(node, "start", "translation"), "start translation");
      validate_start(body.model, start);
      body.start = start;
    }
  } catch (const std::invalid_argument& error) {
    file.fail(error.what());
  }
  return body;
}

}  // namespace evmarker::opencv
