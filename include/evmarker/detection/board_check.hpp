#pragma once
// Checks whether the markers of a board are where its file says.
#include <Eigen/Core>
#include <algorithm>
#include <cstdio>
#include <string>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// Two markers of a board whose places relative to each other contradict its file.
struct BoardContradiction {
  MarkerId board = 0, marker = 0, other = 0;  ///< ids
  /// From the centre of `marker` to that of `other`, as seen and as in the file [m, axes of `marker`].
  Eigen::Vector3d seen = Eigen::Vector3d::Zero(), in_file = Eigen::Vector3d::Zero();

  /// One line of text for users.
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

/// Weighs the frames that contradict the file of a board against those that agree with it. A board is refused once
/// `kEnough` more frames have contradicted than agreed, and until the balance is even again. The balance counts no more
/// than `kEnough` for the file and twice as many against it. If a share p of the frames of a correct board contradicts
/// by mistake, the probability that the board is refused before the balance reaches its limit for the file is about
/// (p / (1 - p))^kEnough: 1.5e-4 at 5 %. From then on, twice as many contradictions are needed.
class BoardCheck {
 public:
  static constexpr int kEnough = 3;

  /// Counts a frame in which at least two markers of the board were seen.
  void add(bool contradicts) noexcept {
    balance_ = std::clamp(balance_ + (contradicts ? 1 : -1), -kEnough, 2 * kEnough);
    doubtful_ = contradicts;
    if (balance_ >= kEnough) refused_ = true;
    if (balance_ <= 0) refused_ = false;
  }

  /// True if the board must not be tracked.
  bool refused() const noexcept { return refused_; }
  /// True if the last frame that was counted contradicted: then one marker alone is not enough to track the board.
  bool doubtful() const noexcept { return doubtful_; }

 private:
  int balance_ = 0;  // frames that contradicted less those that agreed, limited
  bool doubtful_ = false, refused_ = false;
};

}  // namespace evmarker
