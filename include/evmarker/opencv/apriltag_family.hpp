#pragma once
// The AprilTag families among OpenCV's dictionaries, and which way up their authors print the tags.
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <numbers>
#include <opencv2/core.hpp>
#include <string_view>

#include "evmarker/base/so3.hpp"
#include "evmarker/opencv/aruco_shim.hpp"

namespace evmarker::opencv::detail {

struct AprilTagFamily {
  std::string_view dictionary;  // OpenCV's name
  std::string_view family;      // AprilTag's
  std::uint64_t first_code;  // of tag 0 as its authors print it: rows from top to bottom, 1 white, first cell highest
};

inline constexpr auto kAprilTagFamilies = std::to_array<AprilTagFamily>({
    {"DICT_APRILTAG_16h5", "tag16h5", 0x231b},
    {"DICT_APRILTAG_25h9", "tag25h9", 0x155cbf1},
    {"DICT_APRILTAG_36h10", "tag36h10", 0x1ca92a687},
    {"DICT_APRILTAG_36h11", "tag36h11", 0xd5d628584},
});

// From the axes of OpenCV's marker to those of the tag as AprilTag prints it (x right, y up, z out of the tag). Up to
// version 4, OpenCV has all tags upside down.
inline Eigen::Isometry3d T_tag_marker(const AprilTagFamily& family) {
  std::uint64_t code = 0;
  const CodeBits bits = marker_bits(make_dictionary(family.dictionary), 0);
  for (Eigen::Index i = 0; i < bits.size(); ++i) code = code << 1 | bits.data()[i];  // row by row
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  if (code != family.first_code) T.linear() = so3_exp({0, 0, std::numbers::pi});
  return T;
}

}  // namespace evmarker::opencv::detail
