#pragma once
// Sorts the poses of several markers by time.
#include <algorithm>
#include <concepts>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// Hands poses over in order of time.
class ByTime {
 public:
  /// @param poses most poses at a time for which nothing is allocated
  explicit ByTime(std::size_t poses) { order_.reserve(poses); }

  /// Calls `use(pose)` with each pose, in order of time, poses of the same time in their present order; then clears
  /// them.
  template <std::invocable<const PoseEstimate&> Use>
  void hand_over(std::vector<PoseEstimate>& poses, const Use& use) {
    order_.resize(poses.size());
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    std::ranges::sort(order_, {}, [&](std::size_t i) { return std::pair(poses[i].t, i); });
    for (const std::size_t i : order_) use(poses[i]);
    poses.clear();
  }

 private:
  std::vector<std::size_t> order_;
};

}  // namespace evmarker
