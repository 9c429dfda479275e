#pragma once
// Floor 1. Matched events number by number, for update rules that take eight of them at once.
#include <array>
#include <cstddef>

#include "evmarker/lanes.hpp"

namespace evmarker {

/// Up to eight events matched at one pose: what `Correspondence` says of each, in lanes, toward the dark side of its
/// edge. Lanes from `count` on are finite and mean nothing.
struct alignas(64) Correspondences {
  Lanes t;              ///< [us]
  Lanes distance_px;    ///< Eq. (1)
  Lanes M_x, M_y;       ///< line of sight (x, y; 1), Eq. (2)
  Lanes F_x, F_y, F_z;  ///< point on the line of sight, Eq. (3)
  Lanes E_x, E_y, E_z;  ///< point on the segment, Eq. (4)
  Lanes g_x, g_y, g_z;  ///< how far E moves along the edge's image normal, by E [px/m]
  Lanes is_event;       ///< 1, and 0 from `count` on
  std::size_t count = 0;

  void set_count(std::size_t events) noexcept {
    static constexpr std::array<double, 2 * kLanes> kOnes{1, 1, 1, 1, 1, 1, 1, 1};
    count = events;
    for (std::size_t i = 0; i < kLanes; ++i) is_event[i] = kOnes[kLanes - events + i];
  }
};

}  // namespace evmarker
