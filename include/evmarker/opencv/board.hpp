#pragma once
// Reading of boards from files.
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <string_view>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

/// Reads a board from a file with the fields `board`, its id, and `markers`, a list of maps `id`, `length` [m],
/// `rotation` (vector along the axis, as long as the angle [rad]) and `translation` [m] of T_board_marker.
/// @param dictionary OpenCV's name of the predefined dictionary that the markers are from
/// @throws std::runtime_error naming file, field and value
/// @throws std::invalid_argument naming an unknown dictionary
inline Board load_board(const std::string& path, std::string_view dictionary) {
  const detail::SettingsFile file("board", path);
  const cv::aruco::Dictionary codes = make_dictionary(dictionary);
  Board board{.id = file.whole_number(file.required("board"), "board"), .markers = {}};
  const cv::FileNode markers = file.required("markers");
  if (!markers.isSeq()) file.fail("markers is not a list");
  for (const cv::FileNode& node : markers) {
    const std::string place = "markers[" + std::to_string(board.markers.size()) + "]";
    if (!node.isMap()) file.fail(place + " is not a map of id, length, rotation and translation");
    BoardMarker marker;
    marker.id = file.whole_number(file.field(node, place, "id"), place + " id");
    marker.length = file.number(file.field(node, place, "length"), place + " length");
    if (!(marker.length > 0))
      file.fail(place + " length is " + detail::SettingsFile::show(marker.length) + ", not positive");
    marker.T_board_marker.linear() = so3_exp(file.vector(file.field(node, place, "rotation"), place + " rotation"));
    marker.T_board_marker.translation() = file.vector(file.field(node, place, "translation"), place + " translation");
    try {
      marker.bits = marker_bits(codes, marker.id, dictionary);
    } catch (const std::invalid_argument& error) {
      file.fail(place + ": " + error.what());
    }
    board.markers.push_back(marker);
  }
  try {
    validate(board);
  } catch (const std::invalid_argument& error) {
    file.fail(error.what());
  }
  return board;
}

}  // namespace evmarker::opencv
