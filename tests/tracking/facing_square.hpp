#pragma once
// A plain square that faces the camera 0.6 m away, for tests that tell what its edges do.
#include <Eigen/Core>
#include <cstddef>
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

// True if an edge of the square makes ON events on this way [px]: it is dark, so that its top and left do when it moves
// down and to the right.
inline bool makes_on(std::size_t segment, const Eigen::Vector2d& way) {
  const double toward_right_or_bottom = segment % 2 == 0 ? way.y() : way.x();
  return (segment % 4 == 0 || segment % 4 == 3) == (toward_right_or_bottom > 0);
}

}  // namespace evmarker::test
