#pragma once
// A plain square that faces the camera 0.6 m away, for tests that tell what its edges do.
#include <cstdint>
#include <vector>

#include "evmarker/simulation/trajectory.hpp"

namespace evmarker::test {

constexpr double kFocalLength = 533;
inline const MarkerModel kSquare = make_square_marker(0.1);  // top, right, bottom, left: 89 px each

inline const std::vector<std::uint32_t> kNoCounts(4);  // of events in the middle of its edges

inline Eigen::Isometry3d square_at(double x_px, double y_px) {
  return facing_pose({x_px * 0.6 / kFocalLength, y_px * 0.6 / kFocalLength, 0.6});
}

}  // namespace evmarker::test
