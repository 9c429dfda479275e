#pragma once
// One interface to both versions of OpenCV's ArUco: in the contrib modules up to 4.6, in objdetect from 4.7 on. No
// other header depends on the version.
#include <algorithm>
#include <array>
#include <opencv2/core.hpp>
#include <opencv2/core/version.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/model/marker_model.hpp"

#if CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR >= 7)
#include <opencv2/objdetect/aruco_detector.hpp>
namespace evmarker::opencv::detail {

inline cv::aruco::Dictionary predefined_dictionary(int index) { return cv::aruco::getPredefinedDictionary(index); }

inline void detect_markers(const cv::Mat& image, const cv::aruco::Dictionary& dictionary,
                           const cv::aruco::DetectorParameters& parameters,
                           std::vector<std::vector<cv::Point2f>>& corners, std::vector<int>& ids) {
  cv::aruco::ArucoDetector(dictionary, parameters).detectMarkers(image, corners, ids);
}

}  // namespace evmarker::opencv::detail
#else
#include <opencv2/aruco.hpp>
namespace evmarker::opencv::detail {

inline cv::aruco::Dictionary predefined_dictionary(int index) { return *cv::aruco::getPredefinedDictionary(index); }

inline void detect_markers(const cv::Mat& image, const cv::aruco::Dictionary& dictionary,
                           const cv::aruco::DetectorParameters& parameters,
                           std::vector<std::vector<cv::Point2f>>& corners, std::vector<int>& ids) {
  cv::aruco::detectMarkers(image, cv::makePtr<cv::aruco::Dictionary>(dictionary), corners, ids,
                           cv::makePtr<cv::aruco::DetectorParameters>(parameters));
}

}  // namespace evmarker::opencv::detail
#endif

namespace evmarker::opencv {

/// Names and numbers of the dictionaries that all supported versions of OpenCV have.
inline constexpr auto kDictionaries = std::to_array<std::pair<std::string_view, int>>({
    {"DICT_4X4_50", cv::aruco::DICT_4X4_50},
    {"DICT_4X4_100", cv::aruco::DICT_4X4_100},
    {"DICT_4X4_250", cv::aruco::DICT_4X4_250},
    {"DICT_4X4_1000", cv::aruco::DICT_4X4_1000},
    {"DICT_5X5_50", cv::aruco::DICT_5X5_50},
    {"DICT_5X5_100", cv::aruco::DICT_5X5_100},
    {"DICT_5X5_250", cv::aruco::DICT_5X5_250},
    {"DICT_5X5_1000", cv::aruco::DICT_5X5_1000},
    {"DICT_6X6_50", cv::aruco::DICT_6X6_50},
    {"DICT_6X6_100", cv::aruco::DICT_6X6_100},
    {"DICT_6X6_250", cv::aruco::DICT_6X6_250},
    {"DICT_6X6_1000", cv::aruco::DICT_6X6_1000},
    {"DICT_7X7_50", cv::aruco::DICT_7X7_50},
    {"DICT_7X7_100", cv::aruco::DICT_7X7_100},
    {"DICT_7X7_250", cv::aruco::DICT_7X7_250},
    {"DICT_7X7_1000", cv::aruco::DICT_7X7_1000},
    {"DICT_ARUCO_ORIGINAL", cv::aruco::DICT_ARUCO_ORIGINAL},
    {"DICT_APRILTAG_16h5", cv::aruco::DICT_APRILTAG_16h5},
    {"DICT_APRILTAG_25h9", cv::aruco::DICT_APRILTAG_25h9},
    {"DICT_APRILTAG_36h10", cv::aruco::DICT_APRILTAG_36h10},
    {"DICT_APRILTAG_36h11", cv::aruco::DICT_APRILTAG_36h11},
});

/// The dictionary where none is named.
inline constexpr std::string_view kDefaultDictionary = "DICT_4X4_50";

/// A predefined dictionary by OpenCV's name, e.g. "DICT_4X4_50".
/// @throws std::invalid_argument naming the unknown name and all known ones
inline cv::aruco::Dictionary make_dictionary(std::string_view name) {
  for (const auto& [known, index] : kDictionaries)
    if (known == name) return detail::predefined_dictionary(index);
  std::string message = "dictionary: no \"" + std::string(name) + "\"; there are";
  for (const auto& [known, index] : kDictionaries) message.append(" ").append(known);
  throw std::invalid_argument(message);
}

/// Number of markers in a dictionary; their ids count from 0.
inline int dictionary_size(const cv::aruco::Dictionary& dictionary) { return dictionary.bytesList.rows; }

/// The code of a marker: the cells inside its border, rows from top to bottom, 1 white, 0 black.
/// @param name of the dictionary, for the error
/// @throws std::invalid_argument with the id and the size of the dictionary
inline CodeBits marker_bits(const cv::aruco::Dictionary& dictionary, int id, std::string_view name = "the dictionary") {
  if (id < 0 || id >= dictionary_size(dictionary))
    throw std::invalid_argument("marker id " + std::to_string(id) + " is not in " + std::string(name) + ", which has " +
                                std::to_string(dictionary_size(dictionary)) + " markers (0 to " +
                                std::to_string(dictionary_size(dictionary) - 1) + ")");
  const cv::Mat bits =
      cv::aruco::Dictionary::getBitsFromByteList(dictionary.bytesList.rowRange(id, id + 1), dictionary.markerSize);
  CodeBits code(bits.rows, bits.cols);
  for (int row = 0; row < bits.rows; ++row)
    for (int column = 0; column < bits.cols; ++column) code(row, column) = bits.at<uchar>(row, column);
  return code;
}

/// The widest border of markers that is supported [cells].
inline constexpr int kMostBorderCells = 2;

/// The code of a marker whose border is wider than one cell, for what takes it to be one cell wide: with the rest of
/// its border around it.
inline CodeBits with_border(const CodeBits& code, int border_cells) {
  const Eigen::Index rest = border_cells - 1;
  CodeBits all = CodeBits::Zero(code.rows() + 2 * rest, code.cols() + 2 * rest);
  all.block(rest, rest, code.rows(), code.cols()) = code;
  return all;
}

}  // namespace evmarker::opencv
