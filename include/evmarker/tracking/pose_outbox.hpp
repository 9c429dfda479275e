#pragma once
// Poses that wait to be handed over in order.
#include <algorithm>
#include <concepts>
#include <cstddef>
#include <numeric>
#include <tuple>
#include <vector>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// The poses that a batch of events has led to. They come marker by marker, and are handed over in the order of the
/// events: the order of one event after the other, also where times are equal or step back.
class PoseOutbox {
 public:
  /// @param most poses at a time for which nothing is allocated
  explicit PoseOutbox(std::size_t most) {
    poses_.reserve(most);
    order_.reserve(most);
  }

  /// @param event number, in its batch, of the event that led to the pose
  void add(const PoseEstimate& pose, std::size_t event) { poses_.push_back({event, pose}); }
  bool empty() const noexcept { return poses_.empty(); }

  /// Calls `use(pose)` with each pose, in the order of the events, those of one event in order of time; then clears
  /// them, also those that follow if `use` throws.
  template <std::invocable<const PoseEstimate&> Use>
  void hand_over(const Use& use) {
    const struct Clear {
      std::vector<Waiting>& poses;
      ~Clear() { poses.clear(); }
    } clear{poses_};
    order_.resize(poses_.size());
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    std::ranges::sort(order_, {}, [&](std::size_t i) { return std::tuple(poses_[i].event, poses_[i].pose.t, i); });
    for (const std::size_t i : order_) use(poses_[i].pose);
  }

 private:
  struct Waiting {
    std::size_t event;
    PoseEstimate pose;
  };

  std::vector<Waiting> poses_;
  std::vector<std::size_t> order_;
};

}  // namespace evmarker
