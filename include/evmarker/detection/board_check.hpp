#pragma once
// Checks whether the markers of a board are where its file says.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
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

/// How a board contradicts its file, by the two markers whose places relative to each other differ most from it.
struct BoardContradiction {
  MarkerId board = 0, marker = 0, other = 0;  ///< ids
  /// From the centre of `marker` to that of `other`, as seen and as in the file [m, axes of `marker`].
  Eigen::Vector3d seen = Eigen::Vector3d::Zero(), in_file = Eigen::Vector3d::Zero();
  double marker_scale = 1;  ///< size of the markers against their distances, seen / in file, where that contradicts it

  /// One line of text for users.
  std::string message() const {
    const auto show = [](const Eigen::Vector3d& v) {
      char text[80];
      std::snprintf(text, sizeof text, "(%.3f, %.3f, %.3f) m", v.x(), v.y(), v.z());
      return std::string(text);
    };
    char size[80] = "";
    if (marker_scale != 1)
      std::snprintf(size, sizeof size, "; against their distances its markers are %.1f %% %s than there",
                    100 * std::abs(marker_scale - 1), marker_scale < 1 ? "smaller" : "larger");
    return "board " + std::to_string(board) + " does not fit its file: marker " + std::to_string(other) +
           " is seen at " + show(seen) + " from marker " + std::to_string(marker) + ", the file says " + show(in_file) +
           size;
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

  /// True if the file is right as far as can be told.
  bool settled() const noexcept { return balance_ == -kEnough; }
  /// True if the board must not be tracked.
  bool refused() const noexcept { return refused_; }
  /// True if the last frame that was counted contradicted: then one marker alone is not enough to track the board.
  bool doubtful() const noexcept { return doubtful_; }

 private:
  int balance_ = 0;  // frames that contradicted less those that agreed, limited
  bool doubtful_ = false, refused_ = false;
};

/// How much larger or smaller all markers are, against the distances between them, than in the file, as a multiple of
/// what errors of the detector and of the calibration explain.
/// @param scale of the markers, by `fit_marker_scale`
/// @param focal_length [px]
inline double size_deviation(const std::vector<SeenMarker>& seen_markers, MarkerScale scale, double focal_length) {
  // All edges of a detected marker may lie on its outside, or all on its inside: by .35 px at most in real recordings.
  constexpr double kOutwards_px = 0.7;
  constexpr double kDistortion = 0.015;  // sizes change by three times the share by which it moves the rim
  constexpr double kSigmas = 3;
  double diagonals_px = 0;
  for (const SeenMarker& marker : seen_markers) diagonals_px += focal_length * norm(marker.seen[0] - marker.seen[2]);
  const double half_side_px = diagonals_px / static_cast<double>(seen_markers.size()) / (2 * std::numbers::sqrt2);
  return std::abs(scale.value - 1) / (kOutwards_px / half_side_px + kDistortion + kSigmas * scale.sigma);
}

/// True if at least half of the markers are farther from their places than errors of the detector and of the
/// calibration explain, or one of them is at another place altogether.
/// @param T T_camera_board that fits the markers best
/// @param focal_length [px]
inline bool contradicts_places(const std::vector<SeenMarker>& seen_markers, const Eigen::Isometry3d& T,
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

namespace detail {

// The centre of b in the axes of a [m], by those of their two poses each that contradict the file least.
inline Eigen::Vector3d seen_from(const SeenMarker& a, const SeenMarker& b, const Eigen::Vector3d& in_file) {
  Eigen::Vector3d nearest = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  for (const Eigen::Isometry3d& by_a : a.T_camera_board)
    for (const Eigen::Isometry3d& by_b : b.T_camera_board) {
      const Eigen::Isometry3d T_camera_a = product(by_a, a.marker->T_board_marker);
      const Eigen::Vector3d seen = transform(inverse(T_camera_a), translation(product(by_b, b.marker->T_board_marker)));
      if (norm(Vec3(seen) - Vec3(in_file)) < norm(Vec3(nearest) - Vec3(in_file))) nearest = seen;
    }
  return nearest;
}

}  // namespace detail

/// What to say of a board that contradicts its file: of the two markers whose relative place, by their own poses,
/// differs most from it.
/// @param marker_scale 1 where it does not contradict
inline BoardContradiction worst_contradiction(MarkerId board, const std::vector<SeenMarker>& seen_markers,
                                              double marker_scale) {
  const auto deviation_m = [](const BoardContradiction& pair) { return norm(Vec3(pair.seen) - Vec3(pair.in_file)); };
  BoardContradiction worst{.board = board, .marker_scale = marker_scale};
  for (const SeenMarker& a : seen_markers)
    for (const SeenMarker& b : seen_markers) {
      if (&a == &b) continue;
      const Eigen::Vector3d in_file =
          transform(inverse(a.marker->T_board_marker), translation(b.marker->T_board_marker));
      const BoardContradiction pair{board,   a.marker->id, b.marker->id, detail::seen_from(a, b, in_file),
                                    in_file, marker_scale};
      if (deviation_m(pair) > deviation_m(worst)) worst = pair;
    }
  return worst;
}

}  // namespace evmarker
