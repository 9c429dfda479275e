#pragma once
// Reading of boards from files, in the forms that people have.
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/opencv/apriltag_boards.hpp"
#include "evmarker/opencv/aruco_boards.hpp"
#include "evmarker/opencv/board_builder.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

namespace detail {

// Our own form: the place of each marker.
inline BoardFile read_placed_markers(const SettingsFile& file, std::string_view asked) {
  BoardBuilder builder(file, choose_dictionary(file, asked, named_dictionary(file), kDefaultDictionary));
  file.required("board");
  builder.begin(file.root());
  const cv::FileNode markers = file.required("markers");
  if (!markers.isSeq()) file.fail("markers is not a list");
  int number = 0;
  for (const cv::FileNode& node : markers) {
    const std::string place = "markers[" + std::to_string(number++) + "]";
    if (!node.isMap()) file.fail(place + " is not a map of id, length, rotation and translation");
    const auto field = [&](const char* name) { return file.field(node, place, name); };
    const int id = file.whole_number(field("id"), place + " id");
    const double length = read_length(file, field("length"), place + " length");
    const Eigen::Vector3d rotation = file.vector(field("rotation"), place + " rotation");
    builder.add(place, id, length,
                pose_at(file.vector(field("translation"), place + " translation"), so3_exp(rotation)));
  }
  return builder.finish();
}

}  // namespace detail

/// Reads the boards of a file. Its form is recognised by its fields; all lengths are in metres:
/// - ours: `board`, the id, and `markers`, a list of maps `id`, `length`, `rotation` (vector along the axis, as long as
///   the angle [rad]) and `translation` of T_board_marker;
/// - Kalibr: `target_type` aprilgrid, `tagCols`, `tagRows`, `tagSize`, `tagSpacing`; the tags with a border of two
///   cells, as Kalibr prints them, or with `border: 1`, as others do;
/// - OpenCV's GridBoard: `markersX`, `markersY`, `markerLength`, `markerSeparation`; CharucoBoard: `squaresX`,
///   `squaresY`, `squareLength`, `markerLength`, `legacyPattern`; both with `ids` or `firstMarker`. All names may be
///   written with underscores, as `markers_x`. The frame is OpenCV's from version 4.6 on: y down, z into the board;
/// - apriltag_ros: `tag_bundles`, a board for each. `tag_family` may stand beside it;
/// - aruco_opencv (ROS): a list of maps `first_id`, `markers_x`, `markers_y`, `marker_size`, `separation` and
///   `frame_at_center`, a board for each, with OpenCV's axes.
///
/// In all forms `dictionary` (DICT_4X4_50, 4X4_50 or OpenCV's number) names the dictionary of the markers, DICT_4X4_50
/// by default, DICT_APRILTAG_36h11 for AprilTags; `border` is the width of their black border [cells], 1 or 2; `board`
/// is the board's id, by default the first hundred above all ids of the dictionary, and the numbers behind it for
/// further boards of the file.
/// @param dictionary OpenCV's name of the dictionary that the markers must be from; empty: whichever the file means
/// @throws std::runtime_error naming file, field and value, also of another dictionary
/// @throws std::invalid_argument naming an unknown `dictionary`
inline BoardFile load_boards(const std::string& path, std::string_view dictionary = "") {
  const detail::SettingsFile file("board", path, {.list = "boards"});
  if (file.has("target_type")) return detail::read_aprilgrid(file, dictionary);
  if (file.has("tag_bundles")) return detail::read_tag_bundles(file, dictionary);
  if (file.has("boards")) return detail::read_aruco_opencv_boards(file, dictionary);
  for (const char* field : {"squaresX", "squares_x"})
    if (file.has(field)) return detail::read_charuco_board(file, dictionary);
  for (const char* field : {"markersX", "markers_x"})
    if (file.has(field)) return detail::read_grid_board(file, dictionary);
  if (file.has("board") || file.has("markers")) return detail::read_placed_markers(file, dictionary);
  file.fail("is no board: it has none of the fields markers, target_type (Kalibr), squaresX, markersX (OpenCV) and " +
            std::string("tag_bundles (apriltag_ros), and is no list of boards (aruco_opencv)"));
}

/// Reads a file of one board, as `load_boards` does.
/// @throws std::runtime_error, too, where the file has several
inline Board load_board(const std::string& path, std::string_view dictionary = "") {
  BoardFile file = load_boards(path, dictionary);
  if (file.boards.size() > 1)
    throw std::runtime_error("board " + path + ": has " + std::to_string(file.boards.size()) + " boards, not one");
  return std::move(file.boards.front());
}

}  // namespace evmarker::opencv
