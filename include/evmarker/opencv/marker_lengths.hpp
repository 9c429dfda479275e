#pragma once
// Reading of the lengths of markers from files.
#include <map>
#include <opencv2/core.hpp>
#include <string>

#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

/// Reads the lengths of single markers from a file with the field `markers`, a list of maps `id` and `length` [m], for
/// ArucoDetectorSettings::lengths.
/// @throws std::runtime_error naming file, field and value
inline std::map<MarkerId, double> load_marker_lengths(const std::string& path) {
  const detail::SettingsFile file("marker lengths", path);
  const cv::FileNode markers = file.required("markers");
  if (!markers.isSeq() || markers.empty()) file.fail("markers is not a list of maps of id and length");
  std::map<MarkerId, double> lengths;
  for (int i = 0; const cv::FileNode& node : markers) {
    const std::string place = "markers[" + std::to_string(i++) + "]";
    if (!node.isMap()) file.fail(place + " is not a map of id and length");
    const MarkerId id = file.whole_number(file.field(node, place, "id"), place + " id");
    const double length = file.number(file.field(node, place, "length"), place + " length");
    const std::string whose = place + ": marker " + std::to_string(id);
    if (!(length > 0)) file.fail(whose + " has length " + detail::SettingsFile::show(length) + ", not positive");
    if (!lengths.emplace(id, length).second) file.fail(whose + " is there twice");
  }
  return lengths;
}

}  // namespace evmarker::opencv
