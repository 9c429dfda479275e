#pragma once
// Checks whether the markers of a board are where its file says.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/median.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/detection/board_fit.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"

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

/// True if at least half of the markers are farther from their places than errors of the detector and of the
/// calibration explain, or one of them is at another place altogether.
/// @param T T_camera_board that fits the markers best
/// @param focal_length [px]
inline bool contradicts_file(const std::vector<SeenMarker>& seen_markers, const Eigen::Isometry3d& T,
                             double focal_length) {
  constexpr double kDetector_px = 2;
  constexpr double kCalibration = 0.005;  // of the size of all seen markers together
  constexpr double kElsewhere = 0.25;     // of the marker's diagonal
  std::vector<double> off_px;
  Box box;
  bool elsewhere = false;
  for (const SeenMarker& marker : seen_markers) {
    double squares = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      squares += squared_norm(focal_length * (marker.seen[i] - on_plane(transform(T, marker.corners[i]))));
      box.extend(focal_length * marker.seen[i]);
    }
    off_px.push_back(std::sqrt(squares / 4));
    elsewhere |= off_px.back() > kElsewhere * focal_length * norm(marker.seen[0] - marker.seen[2]);
  }
  return elsewhere || median(std::move(off_px)) > std::hypot(kDetector_px, kCalibration * norm(box.high - box.low));
}

/// The two markers whose relative place, by their own poses, differs most from the file.
inline BoardContradiction worst_contradiction(MarkerId board, const std::vector<SeenMarker>& seen_markers) {
  const auto deviation_m = [](const BoardContradiction& pair) { return norm(Vec3(pair.seen) - Vec3(pair.in_file)); };
  BoardContradiction worst{.board = board};
  for (const SeenMarker& a : seen_markers)
    for (const SeenMarker& b : seen_markers) {
      if (&a == &b) continue;
      const Eigen::Isometry3d T_camera_a = product(a.T_camera_board[0], a.marker->T_board_marker);
      const Eigen::Isometry3d T_camera_b = product(b.T_camera_board[0], b.marker->T_board_marker);
      const BoardContradiction pair{
          board, a.marker->id, b.marker->id, transform(inverse(T_camera_a), translation(T_camera_b)),
          transform(inverse(a.marker->T_board_marker), translation(b.marker->T_board_marker))};
      if (deviation_m(pair) > deviation_m(worst)) worst = pair;
    }
  return worst;
}

}  // namespace evmarker
