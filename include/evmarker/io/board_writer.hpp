#pragma once
// Writes boards.
#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/base/so3.hpp"
#include "evmarker/io/output_file.hpp"
#include "evmarker/io/pose_format.hpp"
#include "evmarker/model/board.hpp"

namespace evmarker::io {

namespace detail {

inline std::string number_list(const Eigen::Vector3d& v) {
  std::string text = "[";
  for (const double value : v) {
    if (text.size() > 1) text += ", ";
    append_number(text, value);
  }
  return text + ']';
}

}  // namespace detail

/// Writes a board as `opencv::load_board` reads it; numbers read back exactly, rotations to rounding. The codes of its
/// markers are not in the file but their dictionary, or who reads it names that.
/// @param dictionary OpenCV's name of it; empty: it is not in the file
/// @throws std::invalid_argument for a board that is not valid
/// @throws RecordingError where the file cannot be written
inline void save_board(std::filesystem::path path, const Board& board, std::string_view dictionary = "") {
  validate(board);
  OutputFile file(std::move(path));
  std::string text;
  if (!dictionary.empty()) text = "dictionary: " + std::string(dictionary) + '\n';
  text += "board: " + std::to_string(board.id) + "\nmarkers:\n";
  for (const BoardMarker& marker : board.markers) {
    text += "  - { id: " + std::to_string(marker.id) + ", length: ";
    append_number(text, marker.length);
    text += ", rotation: " + detail::number_list(so3_log(marker.T_board_marker.linear())) +
            ", translation: " + detail::number_list(marker.T_board_marker.translation()) + " }\n";
  }
  file.write(text);
  file.close();
}

}  // namespace evmarker::io
