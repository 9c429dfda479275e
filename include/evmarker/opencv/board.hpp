#pragma once
// opencv. Boards from files: which markers are where on them.
#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <string_view>

#include "evmarker/board.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/opencv/settings_file.hpp"
#include "evmarker/so3.hpp"

namespace evmarker::opencv {

namespace detail {

inline cv::FileNode board_field(const SettingsFile& file, const cv::FileNode& marker, const std::string& name,
                                const char* field) {
  const cv::FileNode node = marker[field];
  if (node.empty()) file.fail(name + " has no field " + field);
  return node;
}

inline Eigen::Vector3d board_vector(const SettingsFile& file, const cv::FileNode& marker, const std::string& name,
                                    const char* field) {
  const cv::FileNode node = board_field(file, marker, name, field);
  const std::string what = name + " " + field;
  if (!node.isSeq() || node.size() != 3) file.fail(what + " is not a list of 3 numbers");
  Eigen::Vector3d vector;
  for (int i = 0; i < 3; ++i) vector(i) = file.number(node[i], what + "[" + std::to_string(i) + "]");
  return vector;
}

inline MarkerId marker_id(const SettingsFile& file, const cv::FileNode& node, const std::string& field) {
  const double value = file.number(node, field);
  if (!(value >= 0 && value <= 1e9 && value == std::floor(value)))
    file.fail(field + " is " + SettingsFile::show(value) + ", not a whole number from 0 on");
  return static_cast<MarkerId>(value);
}

}  // namespace detail

/// Reads a board: `board`, the id of the whole, and `markers`, a list of maps `id`, `length` [m], `rotation` (vector
/// along the axis, as long as the angle [rad]) and `translation` [m] of T_board_marker.
/// @param dictionary OpenCV's name of the predefined dictionary that the markers are from
/// @throws std::runtime_error with file, field and value; std::invalid_argument for a dictionary that there is not
inline Board load_board(const std::string& path, std::string_view dictionary) {
  const detail::SettingsFile file("board", path);
  const cv::aruco::Dictionary codes = make_dictionary(dictionary);
  Board board{.id = detail::marker_id(file, file.required("board"), "board"), .markers = {}};
  const cv::FileNode markers = file.required("markers");
  if (!markers.isSeq()) file.fail("markers is not a list");
  for (const cv::FileNode& node : markers) {
    const std::string place = "markers[" + std::to_string(board.markers.size()) + "]";
    if (!node.isMap()) file.fail(place + " is not a map of id, length, rotation and translation");
    BoardMarker marker;
    marker.id = detail::marker_id(file, detail::board_field(file, node, place, "id"), place + " id");
    marker.length = file.number(detail::board_field(file, node, place, "length"), place + " length");
    if (!(marker.length > 0))
      file.fail(place + " length is " + detail::SettingsFile::show(marker.length) + ", not positive");
    marker.T_board_marker.linear() = so3_exp(detail::board_vector(file, node, place, "rotation"));
    marker.T_board_marker.translation() = detail::board_vector(file, node, place, "translation");
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
