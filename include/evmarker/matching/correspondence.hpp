#pragma once
// Matched events with the geometry of their edges, single and in batches of eight.
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <limits>

#include "evmarker/events/event.hpp"
#include "evmarker/simd/lanes.hpp"

namespace evmarker {

/// An event and the point of the model that is assumed to have made it. Points are in the camera frame [m].
struct Correspondence {
  Timestamp t = 0;         ///< of the event [us]
  double polarity = 0;     ///< of the event: 1 ON, -1 OFF, 0 unknown
  int segment = 0;         ///< index into MarkerModel::segments
  double distance_px = 0;  ///< Eq. (1), signed: positive along `normal`
  double squared_px = 0;   ///< `distance_px` squared
  /// Squared distance of E's image from that of the edge's nearer end [px^2]; infinite in the edge's middle half.
  double from_end_px2 = std::numeric_limits<double>::infinity();
  Eigen::Vector2d normal{0, 0};                 ///< unit normal of the projected edge, toward its dark side if known
  bool dark_side_known = false;                 ///< whether `normal` points to the dark side
  double contrast = 1;                          ///< of the edge, relative to the mean of all, see EdgeContrasts
  Eigen::Vector3d gradient{0, 0, 0};            ///< derivative by E of the place of E's image along `normal` [px/m]
  Eigen::Vector3d M = Eigen::Vector3d::Zero();  ///< line of sight, Eq. (2)
  Eigen::Vector3d F = Eigen::Vector3d::Zero();  ///< point on the line of sight, Eq. (3)
  Eigen::Vector3d E = Eigen::Vector3d::Zero();  ///< point on the segment, Eq. (4)
};

/// Up to eight events matched at one pose, with one array for each component of their `Correspondence`. Normals point
/// to the dark sides of the edges, which must be known. Lanes from `count` on are finite, but mean nothing.
struct alignas(64) Correspondences {
  simd::Lanes t;                          ///< [us]
  simd::Lanes polarity;                   ///< 1 ON, -1 OFF, 0 unknown
  simd::Lanes distance_px;                ///< Eq. (1)
  simd::Lanes M_x, M_y;                   ///< line of sight (x, y; 1), Eq. (2)
  simd::Lanes F_x, F_y, F_z;              ///< point on the line of sight, Eq. (3)
  simd::Lanes E_x, E_y, E_z;              ///< point on the segment, Eq. (4)
  simd::Lanes g_x, g_y, g_z;              ///< derivative by E of the place of E's image along the edge's normal [px/m]
  simd::Lanes from_end_px2;               ///< as in Correspondence
  simd::Lanes contrast;                   ///< as in Correspondence
  simd::Lanes is_event;                   ///< 1 for events, 0 in the lanes from `count` on
  std::array<int, simd::kLanes> segment;  ///< as in Correspondence
  std::size_t count = 0;

  /// Sets `count`, at most eight, and `is_event`.
  void set_count(std::size_t events) noexcept {
    static constexpr std::array<double, 2 * simd::kLanes> kOnes{1, 1, 1, 1, 1, 1, 1, 1};
    count = events;
    for (std::size_t i = 0; i < simd::kLanes; ++i) is_event[i] = kOnes[simd::kLanes - events + i];
  }
};

/// How far behind a moving edge its events lie [px]: a pixel fires only after a whole contrast step, so on average half
/// a step late.
/// @param edge_width_px width of the blurred edge
/// @param events_per_passage how many events one pixel makes while the edge passes over it
inline double expected_trail_px(double edge_width_px, double events_per_passage) noexcept {
  return edge_width_px / (2 * events_per_passage);
}

}  // namespace evmarker
