#pragma once
// A trajectory of sampled poses, interpolated to any time between them.
#include <Eigen/Geometry>
#include <algorithm>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker::io {

struct TimedPose {
  Timestamp t = 0;                                                    ///< [us]
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();  ///< [m]
};

/// Sampled poses of one marker; positions are interpolated linearly, rotations along the shortest arc (slerp).
class Trajectory {
 public:
  Trajectory() = default;

  /// @throws std::invalid_argument where the times do not increase
  explicit Trajectory(std::vector<TimedPose> poses) : poses_(std::move(poses)) {
    for (std::size_t i = 1; i < poses_.size(); ++i)
      if (poses_[i].t <= poses_[i - 1].t)
        throw std::invalid_argument("trajectory: pose " + std::to_string(i) + " at " + std::to_string(poses_[i].t) +
                                    " us does not follow " + std::to_string(poses_[i - 1].t) + " us");
  }

  /// Pose at `t` [us]; nothing before the first or after the last sample.
  std::optional<Eigen::Isometry3d> at(Timestamp t) const {
    const auto next = std::ranges::lower_bound(poses_, t, {}, &TimedPose::t);
    if (next == poses_.end()) return std::nullopt;
    if (next->t == t) return next->T_camera_marker;
    if (next == poses_.begin()) return std::nullopt;
    const TimedPose &a = next[-1], &b = *next;
    const double part = static_cast<double>(elapsed_us(a.t, t)) / static_cast<double>(elapsed_us(a.t, b.t));
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() =
        a.T_camera_marker.translation() + part * (b.T_camera_marker.translation() - a.T_camera_marker.translation());
    const Eigen::Quaterniond from(a.T_camera_marker.linear()), to(b.T_camera_marker.linear());
    pose.linear() = from.slerp(part, to).normalized().toRotationMatrix();
    return pose;
  }

  std::span<const TimedPose> poses() const noexcept { return poses_; }

 private:
  std::vector<TimedPose> poses_;
};

}  // namespace evmarker::io
