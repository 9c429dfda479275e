#pragma once
// Is a flat marker tilted to the side that its tracker says?
#include <algorithm>
#include <cmath>
#include <optional>

#include "evmarker/base/box.hpp"
#include "evmarker/model/planar_ambiguity.hpp"
#include "evmarker/model/pose_perturbation.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/tracking/pose_comparison.hpp"

namespace evmarker {

/// From afar, a flat marker looks nearly alike at two poses, tilted to one side of the line of sight or as much to the
/// other, see `mirrored`. While it nearly faces the camera it makes few events, and a tracker cannot tell whether it
/// goes on turning, to the other side, or turns back. From the moment it turns away again, both poses are followed
/// until the events have decided; meanwhile the covariance covers both. Needs a MirrorableRule: with others it does
/// nothing.
template <PoseUpdateRule Rule>
class TiltCheck {
 public:
  explicit TiltCheck(const EdgeFollower<Rule>& follower) {
    if constexpr (MirrorableRule<Rule>)
      if ((plane_ = plane_of(follower.matcher().model()))) other_.emplace(follower);
  }

  /// True while both poses are followed: every event that either reaches must be pushed.
  bool comparing() const noexcept { return phase_ == Phase::comparing; }
  /// True while the pose may be off by more than 20 deg.
  bool doubtful() const noexcept { return comparing() && between_rad_ > kWild_rad; }

  /// What both poses together reach, see MarkerTracker::reach.
  /// @param reach of the follower's pose
  Box reach(Box reach, double border_cells) const noexcept {
    if (comparing()) reach.extend(other_->matcher().reach(border_cells));
    return reach;
  }

  /// Takes an event that the follower has not taken yet, while both poses are followed.
  void push(const EdgeFollower<Rule>& follower, Vec2 m, Timestamp t, double polarity) noexcept {
    const double squared_px2 = other_->squared_residual_px2(m, polarity);
    const bool on_edge = squared_px2 < 1;  // 1 where there is none, see squared_residual_px2
    if (settling_ > 0)
      settling_ -= on_edge;
    else
      comparison_.add(follower.squared_residual_px2(m, polarity), squared_px2);
    other_->push(m, t, polarity);
  }

  /// To be called after every update. Returns true if the mirrored pose is the right one: the follower then goes on at
  /// it.
  bool judge(EdgeFollower<Rule>& follower) noexcept {
    if (!other_ || --until_judged_ > 0) return false;
    until_judged_ = std::max(1, kEventsBetweenJudgements / follower.events_per_update());
    const SeenPlane seen(follower.T_camera_marker(), *plane_);
    const double tilt = seen.tilt();
    switch (phase_) {
      case Phase::sure: {
        const bool facing = tilt < kMostUnsure_rad && tilt < unsure_below(follower, seen);
        if ((facing && was_tilted_) || tilt < kAlike_rad) {
          phase_ = Phase::facing;
          least_tilt_ = tilt;
        }
        was_tilted_ |= !facing;
        if (phase_ == Phase::sure && size_px(follower, seen) > kGrown * asked_px_) ask_again(follower, seen);
        return false;
      }
      case Phase::facing:
        least_tilt_ = std::min(least_tilt_, tilt);
        if (tilt > least_tilt_ + std::max(kAlike_rad, tilt_deviation(follower, seen))) begin_to_compare(follower);
        return false;
      case Phase::comparing: return decide(follower, tilt);
    }
    return false;
  }

  /// Follows one pose only, as after a gap.
  void stop(EdgeFollower<Rule>& follower) noexcept {
    if (comparing()) end_comparison(follower, Phase::facing);
  }

 private:
  enum class Phase {
    sure,       // of the side
    facing,     // it nearly faces the camera, or has not turned away again
    comparing,  // it turns away: both poses are followed
  };

  static constexpr int kEventsBetweenJudgements = 256;
  static constexpr double kAlike_rad = 0.05;       // the side of a smaller tilt does not matter
  static constexpr double kMostUnsure_rad = 0.35;  // the side of a larger tilt is never lost
  static constexpr double kWild_rad = 0.35;        // between both poses: 20 deg
  static constexpr double kSigmas = 3;             // of the tilt
  static constexpr double kGrown = 1.5;            // a marker that much larger is asked again

  // Standard deviation of the tilt, of both axes together [rad].
  static double tilt_deviation(const EdgeFollower<Rule>& follower, const SeenPlane& seen) noexcept {
    if constexpr (MirrorableRule<Rule>) {
      const Matrix6d P = follower.rule().covariance_by_events();
      const Eigen::Vector3d sight = seen.to_camera;
      const Eigen::Matrix3d of_rotation = P.template bottomRightCorner<3, 3>();
      return std::sqrt(std::max(0.0, of_rotation.trace() - sight.dot(of_rotation * sight)));
    } else {
      return 0;
    }
  }

  double size_px(const EdgeFollower<Rule>& follower, const SeenPlane& seen) const noexcept {
    return follower.matcher().focal_length() * plane_->size / norm(seen.centre);
  }

  // The side of a smaller tilt is not sure: a tilt below sqrt(1 / size) shortens the marker by less than half a pixel,
  // as 1 - cos(tilt) = tilt^2 / 2, and the estimated tilt may be wrong by kSigmas deviations.
  double unsure_below(const EdgeFollower<Rule>& follower, const SeenPlane& seen) const noexcept {
    return std::sqrt(1 / size_px(follower, seen)) + kSigmas * tilt_deviation(follower, seen);
  }

  // What was decided while the marker was smaller in the image may have been wrong.
  void ask_again(EdgeFollower<Rule>& follower, const SeenPlane& seen) noexcept {
    const bool first = asked_px_ == 0;
    asked_px_ = size_px(follower, seen);
    if (first) return;  // as it was detected: PlanarHypotheses decides
    least_tilt_ = 0;
    begin_to_compare(follower);
  }

  void begin_to_compare(EdgeFollower<Rule>& follower) noexcept {
    if constexpr (MirrorableRule<Rule>) {
      *other_ = follower;
      other_->mirror(*plane_);
      comparison_ = {};
      settling_ = follower.events_to_fix_pose();
      phase_ = Phase::comparing;
      tell(follower);
    }
  }

  // Ends the comparison when the poses have met, the events have decided, or the marker turns back.
  bool decide(EdgeFollower<Rule>& follower, double tilt) noexcept {
    tell(follower);
    if (tilt < least_tilt_) {
      least_tilt_ = tilt;
      end_comparison(follower, Phase::facing);
    } else if (between_rad_ < 2 * kAlike_rad || comparison_.decided()) {
      const bool other_is_right = comparison_.decided() && comparison_.z() < 0;
      if (other_is_right) follower = *other_;
      end_comparison(follower, Phase::sure);
      was_tilted_ = false;
      return other_is_right;
    }
    return false;
  }

  // Measures the angle between both poses, and tells the follower of the other one, times the square root of its
  // probability p: the covariance then has p d d^T of it, see MirrorableRule.
  void tell(EdgeFollower<Rule>& follower) noexcept {
    if constexpr (MirrorableRule<Rule>) {
      const Vec6 to_other = Vec6(pose_difference(follower.T_camera_marker(), other_->T_camera_marker()));
      between_rad_ = norm(to_other.r);
      follower.set_other_pose(std::sqrt(comparison_.probability_of_second()) * to_other);
    }
  }

  void end_comparison(EdgeFollower<Rule>& follower, Phase next) noexcept {
    phase_ = next;
    if constexpr (MirrorableRule<Rule>) follower.set_other_pose({});
  }

  std::optional<ModelPlane> plane_;
  std::optional<EdgeFollower<Rule>> other_;  // at the mirrored pose; kept, so that copying into it does not allocate
  Phase phase_ = Phase::sure;
  // It was clearly tilted at some time since the start or the last decision. What was known of the side then holds
  // until it nearly faces the camera.
  bool was_tilted_ = false;
  double asked_px_ = 0;     // size of the marker when `ask_again` last asked; 0 before it was judged
  double least_tilt_ = 0;   // since it nearly faces the camera
  double between_rad_ = 0;  // angle between both poses
  int until_judged_ = 1;    // updates
  int settling_ = 0;        // events that the mirrored pose still needs to settle, before it is compared
  PoseComparison comparison_;
};

}  // namespace evmarker
