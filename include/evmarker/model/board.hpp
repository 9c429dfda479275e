#pragma once
// Boards: code markers with known places on one rigid body, tracked as one wireframe with one pose.
#include <Eigen/Geometry>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// A code marker on a board.
struct BoardMarker {
  MarkerId id = 0;
  double length = 0;  ///< side of the black square [m]
  CodeBits bits;      ///< the cells inside its border, 1 white
  Eigen::Isometry3d T_board_marker = Eigen::Isometry3d::Identity();
};

/// Markers that move together: on a plate, or on the faces of a convex body.
struct Board {
  MarkerId id = 0;  ///< of the board's poses; no marker that is not on the board may have it
  std::vector<BoardMarker> markers;
};

/// Checks that a board has markers, each once, with rigid transforms.
/// @throws std::invalid_argument naming the board, the marker and the fault
inline void validate(const Board& board) {
  const std::string name = "board " + std::to_string(board.id);
  if (board.markers.empty()) throw std::invalid_argument(name + " has no markers");
  for (std::size_t i = 0; i < board.markers.size(); ++i) {
    const BoardMarker& marker = board.markers[i];
    const std::string whose = name + ": marker " + std::to_string(marker.id);
    for (std::size_t k = 0; k < i; ++k)
      if (board.markers[k].id == marker.id) throw std::invalid_argument(whose + " is there twice");
    const auto& T = marker.T_board_marker;
    if (!is_finite(T)) throw std::invalid_argument(whose + ": T_board_marker is not finite");
    if (!is_rotation(T.linear()))
      throw std::invalid_argument(whose + ": T_board_marker is no rotation and translation");
  }
}

/// The wireframe of a board: all edges of all its markers, in the board's frame. Each edge is visible from the front of
/// its marker only, so that on a convex body no hidden edge matches.
/// @throws std::invalid_argument naming the fault of the board or of a marker
inline MarkerModel make_board_model(const Board& board) {
  validate(board);
  MarkerModel model;
  for (const BoardMarker& marker : board.markers) {
    const int first = static_cast<int>(model.vertices.size());
    const MarkerModel one = make_code_marker(marker.length, marker.bits);
    const Eigen::Isometry3d& T = marker.T_board_marker;
    for (const Eigen::Vector3d& vertex : one.vertices) model.vertices.push_back(transform(T, vertex));
    for (const MarkerSegment& edge : one.segments)
      model.segments.push_back(
          {first + edge.from, first + edge.to, rotate(T, edge.dark_side), rotate(T, edge.face_normal)});
    model.codes.push_back({marker.length, marker.bits, T});
  }
  return model;
}

}  // namespace evmarker
