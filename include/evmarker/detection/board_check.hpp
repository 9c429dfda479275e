#pragma once
// Are a board's markers where its file says?
#include <Eigen/Core>
#include <algorithm>
#include <cstdio>
#include <string>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// Two markers of a board that are seen at other places than its file says.
struct BoardContradiction {
  MarkerId board = 0, marker = 0, other = 0;
  /// From the middle of `marker` to that of `other` [m, axes of `marker`].
  Eigen::Vector3d seen = Eigen::Vector3d::Zero(), in_file = Eigen::Vector3d::Zero();

  /// One line that says so.
  std::string message() const {
    const auto show = [](const Eigen::Vector3d& v) {
      char text[80];
      std::snprintf(text, sizeof text, "(%.3f, %.3f, %.3f) m", v.x(), v.y(), v.z());
      return std::string(text);
    };
    return "board " + std::to_string(board) + " does not fit its file: marker " + std::to_string(other) +
           " is seen at " + show(seen) + " from marker " + std::to_string(marker) + ", the file says " + show(in_file);
  }
};

/// Weighs the frames in which at least two markers of a board were seen: one that contradicts the file against one that
/// agrees with it. A board is refused when `kEnough` more have contradicted. If of a right board's frames a share p
/// contradicts by mistake, it is ever refused with probability (p / (1 - p))^kEnough: 1.5e-4 at 5 %.
class BoardCheck {
 public:
  static constexpr int kEnough = 3;

  void add(bool contradicts) noexcept {
    balance_ = std::clamp(balance_ + (contradicts ? 1 : -1), -kEnough, 2 * kEnough);
    doubtful_ = contradicts;
    if (balance_ >= kEnough) refused_ = true;
    if (balance_ <= 0) refused_ = false;
  }

  /// Not to be tracked.
  bool refused() const noexcept { return refused_; }
  /// The last frame with at least two markers contradicted: one marker alone is no ground to track the board.
  bool doubtful() const noexcept { return doubtful_; }

 private:
  int balance_ = 0;
  bool doubtful_ = false, refused_ = false;
};

}  // namespace evmarker
