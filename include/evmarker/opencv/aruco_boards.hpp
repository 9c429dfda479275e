#pragma once
// Boards as OpenCV defines them: GridBoard and CharucoBoard, and the boards of aruco_opencv (ROS), which are
// GridBoards.
#include <Eigen/Geometry>
#include <cctype>
#include <cstdint>
#include <numeric>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/opencv/board_builder.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv::detail {

// A field of OpenCV's by its name in C++ (markerLength) or by that with underscores (marker_length).
struct ArucoField {
  std::string name;   // as in the file; as in C++ if the file has neither
  cv::FileNode node;  // empty if the file has neither
};

inline ArucoField find_field(const SettingsFile& file, const std::string& name) {
  std::string other;
  for (const char c : name) {
    if (std::isupper(static_cast<unsigned char>(c)) != 0) other += '_';
    other += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  if (!file.has(name) && file.has(other)) return {other, file.required(other)};
  return {name, file.has(name) ? file.required(name) : cv::FileNode()};
}

inline ArucoField required_field(const SettingsFile& file, const std::string& name) {
  const ArucoField field = find_field(file, name);
  return field.node.empty() ? ArucoField{name, file.required(name)} : field;
}

inline int count_of(const SettingsFile& file, const std::string& name) {
  const ArucoField field = required_field(file, name);
  return file.positive_integer(field.node, field.name);
}

inline double length_of(const SettingsFile& file, const std::string& name) {
  const ArucoField field = required_field(file, name);
  return read_length(file, field.node, field.name);
}

// The ids of so many markers: those of the field `ids`, or the numbers from `firstMarker`, or from 0, on.
inline std::vector<int> read_ids(const SettingsFile& file, std::size_t markers) {
  std::vector<int> ids;
  if (file.has("ids")) {
    const cv::FileNode list = file.required("ids");
    if (!list.isSeq() || list.size() != markers)
      file.fail("ids is not a list of " + std::to_string(markers) + " numbers, one for each marker");
    for (const cv::FileNode& node : list)
      ids.push_back(file.whole_number(node, "ids[" + std::to_string(ids.size()) + "]"));
    return ids;
  }
  const ArucoField first = find_field(file, "firstMarker");
  ids.resize(markers);
  std::iota(ids.begin(), ids.end(), first.node.empty() ? 0 : file.whole_number(first.node, first.name));
  return ids;
}

// The axes of a marker on OpenCV's boards, which (from version 4.6 on) have x right, y down and z into the board.
inline Eigen::Matrix3d R_board_marker() { return Eigen::Vector3d(1, -1, -1).asDiagonal(); }

// Equal markers in rows from top to bottom. The origin is the top left corner of the first one.
struct MarkerGrid {
  int columns, rows;
  double length, separation;

  Eigen::Vector3d size() const {
    const double pitch = length + separation;
    return {columns * pitch - separation, rows * pitch - separation, 0};
  }
  Eigen::Vector3d centre(int marker) const {
    const double pitch = length + separation;
    return {marker % columns * pitch + length / 2, marker / columns * pitch + length / 2, 0};
  }
};

// OpenCV's GridBoard.
inline BoardFile read_grid_board(const SettingsFile& file, std::string_view asked) {
  BoardBuilder builder(file, choose_dictionary(file, asked, named_dictionary(file), kDefaultDictionary));
  const MarkerGrid grid{count_of(file, "markersX"), count_of(file, "markersY"), length_of(file, "markerLength"),
                        length_of(file, "markerSeparation")};
  const std::int64_t markers = std::int64_t{grid.columns} * grid.rows;
  builder.require_enough(markers, "markersX x markersY");
  builder.begin(file.root());
  int marker = 0;
  for (const int id : read_ids(file, static_cast<std::size_t>(markers)))
    builder.add("ids", id, grid.length, pose_at(grid.centre(marker++), R_board_marker()));
  return builder.finish();
}

// OpenCV's CharucoBoard: markers in the white squares of a chessboard, in rows from top to bottom. The origin is the
// top left corner of the chessboard, which is black. `legacyPattern` is as in OpenCV: with an even number of rows, it
// was white up to version 4.5.
inline BoardFile read_charuco_board(const SettingsFile& file, std::string_view asked) {
  BoardBuilder builder(file, choose_dictionary(file, asked, named_dictionary(file), kDefaultDictionary));
  const int columns = count_of(file, "squaresX"), rows = count_of(file, "squaresY");
  const double square = length_of(file, "squareLength"), length = length_of(file, "markerLength");
  if (length >= square)
    file.fail(find_field(file, "markerLength").name + " is " + SettingsFile::show(length) +
              ", not less than the squares' " + SettingsFile::show(square));
  const ArucoField legacy = find_field(file, "legacyPattern");
  const bool white_first = !legacy.node.empty() && file.flag(legacy.node, legacy.name) && rows % 2 == 0;
  const std::int64_t markers = std::int64_t{columns} * rows / 2;
  builder.require_enough(markers, "half of squaresX x squaresY");
  builder.set_beside("the chessboard");

  builder.begin(file.root());
  const std::vector<int> ids = read_ids(file, static_cast<std::size_t>(markers));
  std::size_t marker = 0;
  for (int row = 0; row < rows; ++row)
    for (int column = (row % 2 == 0) != white_first ? 1 : 0; column < columns; column += 2)
      builder.add("ids", ids[marker++], length,
                  pose_at({(column + 0.5) * square, (row + 0.5) * square, 0}, R_board_marker()));
  return builder.finish();
}

// A board of aruco_opencv.
inline void add_aruco_opencv_board(const SettingsFile& file, const cv::FileNode& node, const std::string& place,
                                   BoardBuilder& builder) {
  const auto field = [&](const char* name) { return file.field(node, place, name); };
  const auto count = [&](const char* name) { return file.positive_integer(field(name), place + " " + name); };
  const auto length = [&](const char* name) { return read_length(file, field(name), place + " " + name); };
  const MarkerGrid grid{count("markers_x"), count("markers_y"), length("marker_size"), length("separation")};
  const int first = file.whole_number(field("first_id"), place + " first_id");
  const bool centred = file.flag(field("frame_at_center"), place + " frame_at_center");
  builder.require_enough(std::int64_t{grid.columns} * grid.rows, place + " markers_x x markers_y");
  builder.begin(node, place + " ");
  for (int marker = 0; marker < grid.columns * grid.rows; ++marker)
    builder.add(place + " first_id", first + marker, grid.length,
                pose_at(grid.centre(marker) - (centred ? Eigen::Vector3d(grid.size() / 2) : Eigen::Vector3d::Zero()),
                        R_board_marker()));
}

// aruco_opencv: a list of boards.
inline BoardFile read_aruco_opencv_boards(const SettingsFile& file, std::string_view asked) {
  const cv::FileNode boards = file.required("boards");
  if (!boards.isSeq() || boards.size() == 0) file.fail("boards is not a list of boards");
  BoardBuilder builder(file, choose_dictionary(file, asked, named_dictionary(file), kDefaultDictionary));
  int number = 0;
  for (const cv::FileNode& node : boards) {
    const std::string place = "boards[" + std::to_string(number++) + "]";
    if (!node.isMap()) file.fail(place + " is not a map of name, first_id, markers_x, markers_y, ...");
    add_aruco_opencv_board(file, node, place, builder);
  }
  return builder.finish();
}

}  // namespace evmarker::opencv::detail
