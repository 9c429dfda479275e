#pragma once
// The flat faces of a board, each as somebody sees it who looks at it.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <evmarker/model/board.hpp>
#include <vector>

namespace evmarker {

/// The markers of a board that lie in one plane and are seen from the same side.
struct BoardFace {
  Eigen::Isometry3d T_board_face;  ///< origin in the middle, x right, y up, z out of the face
  Eigen::Vector2d size;            ///< width and height of its markers and a rim of one cell around them [m]
  Board markers;                   ///< in the face's frame
};

/// The side of a cell [m] of a marker whose border is one cell wide.
inline double cell_of(const BoardMarker& marker) { return marker.length / static_cast<double>(marker.bits.rows() + 2); }

namespace detail {

/// The axes of a face by its normal. Up is the board's y, as on a sheet of paper, also where the board's z points into
/// the sheet (as OpenCV's boards have it, whose y is down); on the sides of a body, up is the board's z.
inline Eigen::Matrix3d face_axes(const Eigen::Vector3d& normal) {
  constexpr double kFlat = 0.7;  // cosine of 45 degrees
  Eigen::Vector3d up = std::abs(normal.z()) > kFlat ? Eigen::Vector3d(0, normal.z() > 0 ? 1 : -1, 0)
                                                    : Eigen::Vector3d(Eigen::Vector3d::UnitZ());
  up = (up - normal * normal.dot(up)).normalized();
  Eigen::Matrix3d R;
  R << up.cross(normal), up, normal;
  return R;
}

/// Moves the origin of a face into the middle of its markers, and measures it.
inline void fit_frame(BoardFace& face) {
  Eigen::AlignedBox2d box;
  for (const BoardMarker& marker : face.markers.markers) {
    const double half = marker.length / 2 + cell_of(marker);
    for (const double x : {-half, half})
      for (const double y : {-half, half}) box.extend((marker.T_board_marker * Eigen::Vector3d(x, y, 0)).head<2>());
  }
  const Eigen::Vector3d middle(box.center().x(), box.center().y(), 0);
  face.T_board_face.translate(middle);
  for (BoardMarker& marker : face.markers.markers) marker.T_board_marker.pretranslate(-middle);
  face.size = box.sizes();
}

}  // namespace detail

/// Splits a board into its faces, in the order of their first markers.
inline std::vector<BoardFace> split_into_faces(const Board& board) {
  constexpr double kSameNormal = 1e-3, kSamePlane_m = 1e-4;
  std::vector<BoardFace> faces;
  for (const BoardMarker& marker : board.markers) {
    const auto is_on = [&](const BoardFace& face) {
      const Eigen::Isometry3d T = face.T_board_face.inverse() * marker.T_board_marker;
      return (T.linear().col(2) - Eigen::Vector3d::UnitZ()).norm() < kSameNormal &&
             std::abs(T.translation().z()) < kSamePlane_m;
    };
    auto face = std::ranges::find_if(faces, is_on);
    if (face == faces.end()) {
      Eigen::Isometry3d T_board_face = Eigen::Isometry3d::Identity();
      T_board_face.linear() = detail::face_axes(marker.T_board_marker.linear().col(2));
      T_board_face.translation() = marker.T_board_marker.translation();
      face = faces.insert(faces.end(), {T_board_face, Eigen::Vector2d::Zero(), {board.id, {}}});
    }
    face->markers.markers.push_back(marker);
    face->markers.markers.back().T_board_marker = face->T_board_face.inverse() * marker.T_board_marker;
  }
  for (BoardFace& face : faces) detail::fit_frame(face);
  return faces;
}

}  // namespace evmarker
