#pragma once
// Boards of AprilTags: Kalibr's aprilgrid and the tag bundles of apriltag_ros.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>

#include "evmarker/opencv/apriltag_family.hpp"
#include "evmarker/opencv/board_builder.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv::detail {

// The family of a file's tags: of the dictionary that is asked for, or that the file names by `dictionary` or, as
// AprilTag does, by `tag_family`; tag36h11 where nothing does.
inline const AprilTagFamily& choose_family(const SettingsFile& file, std::string_view asked) {
  std::string named = named_dictionary(file);
  if (file.has("tag_family")) {
    const std::string family = file.text("tag_family");
    const auto known = std::ranges::find(kAprilTagFamilies, family, &AprilTagFamily::family);
    if (known == kAprilTagFamilies.end()) file.fail("tag_family is \"" + family + "\", which OpenCV does not have");
    named = known->dictionary;
  }
  const std::string chosen = choose_dictionary(file, asked, named, kAprilTagFamilies.back().dictionary);
  const auto family = std::ranges::find(kAprilTagFamilies, chosen, &AprilTagFamily::dictionary);
  if (family == kAprilTagFamilies.end())
    file.fail("dictionary is " + chosen + ", but the tags are AprilTags: it must be one of DICT_APRILTAG_...");
  return *family;
}

// Kalibr: rows of tags from the bottom to the top, from left to right. The board's origin is the bottom left corner of
// tag 0; x right, y up, z out of the board (Kalibr's GridCalibrationTargetAprilgrid). Kalibr prints, and finds, tags
// with a border of two cells. The black squares that it prints between them are no edges of the board.
inline BoardFile read_aprilgrid(const SettingsFile& file, std::string_view asked) {
  if (const std::string type = file.text("target_type"); type != "aprilgrid")
    file.fail("target_type is \"" + type + "\", not \"aprilgrid\": no other target of Kalibr's has markers");
  const int columns = file.positive_integer("tagCols"), rows = file.positive_integer("tagRows");
  const double size = read_length(file, file.required("tagSize"), "tagSize");
  const double spacing = file.number(file.required("tagSpacing"), "tagSpacing");
  if (!(spacing > 0 && spacing <= 10))
    file.fail("tagSpacing is " + SettingsFile::show(spacing) +
              ", not a ratio of the space between tags to tagSize above 0, up to 10");

  const AprilTagFamily& family = choose_family(file, asked);
  BoardBuilder builder(file, std::string(family.dictionary), 2);
  builder.require_enough(std::int64_t{columns} * rows, "tagCols x tagRows");
  builder.set_beside("the squares between the tags");
  builder.begin(file.root());
  const Eigen::Matrix3d R_tag_marker = T_tag_marker(family).linear();
  const double pitch = size * (1 + spacing);
  for (int id = 0; id < columns * rows; ++id)
    builder.add("tag " + std::to_string(id), id, size,
                pose_at({id % columns * pitch + size / 2, id / columns * pitch + size / 2, 0}, R_tag_marker));
  return builder.finish();
}

// T_bundle_tag of an element of a bundle's layout; what is not there is 0, qw 1.
inline Eigen::Isometry3d read_tag_pose(const SettingsFile& file, const cv::FileNode& tag, const std::string& place) {
  const auto number = [&](const char* name, double otherwise) {
    return tag[name].empty() ? otherwise : file.number(tag[name], place + " " + name);
  };
  const Eigen::Quaterniond q(number("qw", 1), number("qx", 0), number("qy", 0), number("qz", 0));
  if (std::abs(q.norm() - 1) > 0.01)  // more than the rounding of its numbers
    file.fail(place + ": the quaternion (qw, qx, qy, qz) has length " + SettingsFile::show(q.norm()) + ", not 1");
  return pose_at({number("x", 0), number("y", 0), number("z", 0)}, q.normalized().toRotationMatrix());
}

// apriltag_ros: a board for each bundle. A tag's axes are x right, y up, z out of the tag as AprilTag prints it.
inline BoardFile read_tag_bundles(const SettingsFile& file, std::string_view asked) {
  const cv::FileNode bundles = file.required("tag_bundles");
  if (!bundles.isSeq() || bundles.size() == 0) file.fail("tag_bundles is not a list of bundles");
  const AprilTagFamily& family = choose_family(file, asked);
  BoardBuilder builder(file, std::string(family.dictionary));
  const Eigen::Isometry3d turn = T_tag_marker(family);
  int number = 0;
  for (const cv::FileNode& bundle : bundles) {
    const std::string place = "tag_bundles[" + std::to_string(number++) + "]";
    if (!bundle.isMap()) file.fail(place + " is not a map of name and layout");
    const cv::FileNode layout = file.field(bundle, place, "layout");
    if (!layout.isSeq()) file.fail(place + " layout is not a list");
    builder.begin(bundle, place + " ");
    int element = 0;
    for (const cv::FileNode& tag : layout) {
      const std::string which = place + " layout[" + std::to_string(element++) + "]";
      if (!tag.isMap()) file.fail(which + " is not a map of id, size, x, y, z, qw, qx, qy and qz");
      builder.add(which, file.whole_number(file.field(tag, which, "id"), which + " id"),
                  read_length(file, file.field(tag, which, "size"), which + " size"),
                  read_tag_pose(file, tag, which) * turn);
    }
  }
  return builder.finish();
}

}  // namespace evmarker::opencv::detail
