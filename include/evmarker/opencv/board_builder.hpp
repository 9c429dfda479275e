#pragma once
// What the readers of all forms of board files share: the dictionary of the markers, their codes, ids of boards.
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/model/board.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

/// The boards of a file, and what a detector needs to find their markers.
struct BoardFile {
  std::vector<Board> boards;
  std::string dictionary;  ///< OpenCV's name
  int border_cells = 1;    ///< width of the markers' black border
  std::string beside{};    ///< what is printed around the markers but not used here; empty: nothing
};

/// An id for a board that has none of its own: the first hundred above the ids of its markers' dictionary.
inline MarkerId free_board_id(const cv::aruco::Dictionary& dictionary) {
  return (dictionary_size(dictionary) + 99) / 100 * 100;
}

namespace detail {

// The dictionary of a file's markers: the one that is asked for, or where none is, the one that the file names, or the
// usual one. The file's must not contradict what is asked for.
inline std::string choose_dictionary(const SettingsFile& file, std::string_view asked, const std::string& named,
                                     std::string_view usual) {
  if (asked.empty()) return named.empty() ? std::string(usual) : named;
  make_dictionary(asked);
  if (!named.empty() && named != asked)
    file.fail("dictionary is " + named + " there, but " + std::string(asked) + " is asked for");
  return std::string(asked);
}

// The dictionary that a file names in its field `dictionary`, by OpenCV's name with or without DICT_, or by OpenCV's
// number; empty if it names none.
inline std::string named_dictionary(const SettingsFile& file) {
  if (!file.has("dictionary")) return {};
  const cv::FileNode node = file.required("dictionary");
  const std::string name = node.isString() ? file.text("dictionary") : "";
  const int number = node.isString() ? -1 : file.whole_number(node, "dictionary");
  for (const auto& [known, index] : kDictionaries)
    if (name == known || "DICT_" + name == known || number == index) return std::string(known);
  if (name.empty()) file.fail("dictionary is " + std::to_string(number) + ", which is not the number of one");
  try {
    make_dictionary(name);
  } catch (const std::invalid_argument& error) {
    file.fail(error.what());
  }
  return name;
}

// A length in metres; `field` is the name of the node in errors.
inline double read_length(const SettingsFile& file, const cv::FileNode& node, const std::string& field) {
  constexpr double kLongest = 10;
  const double length = file.number(node, field);
  if (!(length > 0)) file.fail(field + " is " + SettingsFile::show(length) + ", not positive");
  if (length > kLongest)
    file.fail(field + " is " + SettingsFile::show(length) + ", taken as metres, which must be up to 10; for " +
              SettingsFile::show(length) + " mm write " + SettingsFile::show(length / 1000));
  return length;
}

// Makes the boards of a file. Boards without ids of their own get `free_board_id` and the numbers behind it.
class BoardBuilder {
 public:
  // `border_cells` is the width of the markers' border where the field `border` does not name it.
  BoardBuilder(const SettingsFile& file, std::string dictionary, int border_cells = 1)
      : file_(file), result_{{}, std::move(dictionary), border_cells}, codes_(make_dictionary(result_.dictionary)) {
    if (!file.has("border")) return;
    result_.border_cells = file.positive_integer("border");
    if (result_.border_cells > kMostBorderCells)
      file.fail("border is " + std::to_string(result_.border_cells) + ", not 1 or 2 cells");
  }

  // Begins a board; `node` is the map that may have its id in the field `board`.
  void begin(const cv::FileNode& node, const std::string& place = "") {
    const cv::FileNode id = node["board"];
    const MarkerId free = free_board_id(codes_) + static_cast<MarkerId>(result_.boards.size());
    result_.boards.push_back({.id = id.empty() ? free : file_.whole_number(id, place + "board"), .markers = {}});
  }

  // Says what is printed around the markers.
  void set_beside(std::string what) { result_.beside = std::move(what); }

  // Adds a marker to the last board.
  void add(const std::string& place, MarkerId id, double length, const Eigen::Isometry3d& T_board_marker) {
    try {
      const CodeBits code = with_border(marker_bits(codes_, id, result_.dictionary), result_.border_cells);
      result_.boards.back().markers.push_back({id, length, code, T_board_marker});
    } catch (const std::invalid_argument& error) {
      file_.fail(place + ": " + error.what());
    }
  }

  // Refuses more markers than the dictionary has; `what` is what their number comes from.
  void require_enough(std::int64_t markers, const std::string& what) const {
    if (markers > dictionary_size(codes_))
      file_.fail(what + " are " + std::to_string(markers) + " markers, but " + result_.dictionary + " has " +
                 std::to_string(dictionary_size(codes_)));
  }

  BoardFile finish() {
    try {
      for (const Board& board : result_.boards) validate(board);
    } catch (const std::invalid_argument& error) {
      file_.fail(error.what());
    }
    return std::move(result_);
  }

 private:
  const SettingsFile& file_;
  BoardFile result_;
  cv::aruco::Dictionary codes_;
};

// The pose of a marker from its centre and the orientation of its axes.
inline Eigen::Isometry3d pose_at(const Eigen::Vector3d& centre, const Eigen::Matrix3d& R) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = centre;
  return T;
}

}  // namespace detail

}  // namespace evmarker::opencv
