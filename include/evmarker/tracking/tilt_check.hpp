#pragma once
// Is a flat marker tilted to the side that its tracker says?
#include <algorithm>
#include <cmath>
#include <optional>

#include "evmarker/base/box.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/planar_ambiguity.hpp"
#include "evmarker/model/pose_perturbation.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/tracking/pose_comparison.hpp"

namespace evmarker {

/// From afar, a flat marker looks nearly alike at two poses, tilted to one side of the line of sight or as much to the
/// other, see `mirrored`. While it nearly faces the camera it makes few events, and a tracker cannot tell whether it
/// goes on turning, to the other side, or turns back. From the moment it turns away again, both poses are followed
/// until the events have decided; meanwhile the covariance covers both. A pose is trusted if its covariance excluded
/// the other side all the time that it faced the camera: then it is in doubt only once events speak for the other one.
/// Needs a MirrorableRule: with others it does nothing.
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
  bool doubtful() const noexcept { return apart_rad_ > kWild_rad; }

  /// What both poses together reach, see MarkerTracker::reach.
  /// @param reach of the follower's pose
  Box reach(Box reach, double border_cells) const noexcept {
    if (comparing()) reach.extend(other_->matcher().reach(border_cells));
    return reach;
  }

  /// Takes an event that the follower has not taken yet, while both poses are followed.
  void push(const EdgeFollower<Rule>& follower, Vec2 m, Timestamp t, double polarity) noexcept {
    if (other_->follows_motion()) comparison_.add(follower.residual(m, polarity), other_->residual(m, polarity));
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
        const bool facing = is_facing(follower, seen);
        if ((facing && was_tilted_) || tilt < kAlike_rad) begin_to_face(seen, true);  // until it is unsure, see below
        was_tilted_ |= !facing;
        if (phase_ == Phase::sure && size_px(follower, seen) > kGrown * compared_px_) compare_grown(follower, seen);
        return false;
      }
      case Phase::facing:
        least_tilt_ = std::min(least_tilt_, tilt);
        trusted_ = trusted_ && tilt > kAlike_rad && !is_unsure(follower, seen);
        apart_rad_ = trusted_ ? 0 : 2 * tilt;
        if (tilt > least_tilt_ + std::max(kAlike_rad, tilt_deviation(follower, seen)))
          begin_to_compare(follower, seen, trusted_);
        return false;
      case Phase::comparing: return decide(follower, seen);
    }
    return false;
  }

  /// Says that another pose has been dropped, although the events had not decided against it.
  /// @param both_alike it was nearly the same pose
  void doubt(EdgeFollower<Rule>& follower, bool both_alike) noexcept {
    if (!other_) return;
    const SeenPlane seen(follower.T_camera_marker(), *plane_);
    if (!both_alike) {
      least_tilt_ = 0;  // so that turning back does not end the comparison
      begin_to_compare(follower, seen);
    } else if (is_unsure(follower, seen)) {
      begin_to_face(seen);
    }
  }

  /// Follows one pose only, as after a gap.
  void stop(EdgeFollower<Rule>& follower) noexcept {
    if (!comparing()) return;
    const bool in_doubt = apart_rad_ > 0;
    end_comparison(follower);
    if (!in_doubt) return;
    begin_to_face(SeenPlane(follower.T_camera_marker(), *plane_));
    least_tilt_ = 0;  // so that both poses are compared again at once
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
  static constexpr double kGrown = 1.5;            // poses of a marker that much larger are compared again

  // Standard deviation of the tilt, of both axes together [rad].
  static double tilt_deviation(const EdgeFollower<Rule>& follower, const SeenPlane& seen) noexcept {
    if constexpr (MirrorableRule<Rule>) {
      const Matrix6d P = follower.rule().covariance_by_events();
      const Vec6 about_sight({}, seen.to_camera);
      const double about_all = P(3, 3) + P(4, 4) + P(5, 5);
      return std::sqrt(std::max(0.0, about_all - dot(about_sight.r, product(P, about_sight).r)));
    } else {
      return 0;
    }
  }

  double size_px(const EdgeFollower<Rule>& follower, const SeenPlane& seen) const noexcept {
    return follower.matcher().focal_length() * plane_->size / norm(seen.centre);
  }

  // True if the marker may as well be tilted to the other side, by what is known of the tilt.
  bool is_unsure(const EdgeFollower<Rule>& follower, const SeenPlane& seen) const noexcept {
    const double tilt = seen.tilt();
    return tilt < kMostUnsure_rad && tilt < kSigmas * tilt_deviation(follower, seen);
  }

  // True if the tilt shortens the marker by less than half a pixel, as 1 - cos(tilt) = tilt^2 / 2, or may do so.
  bool is_facing(const EdgeFollower<Rule>& follower, const SeenPlane& seen) const noexcept {
    const double tilt = seen.tilt();
    return tilt < kMostUnsure_rad &&
           tilt < std::sqrt(1 / size_px(follower, seen)) + kSigmas * tilt_deviation(follower, seen);
  }

  void begin_to_face(const SeenPlane& seen, bool trusted = false) noexcept {
    phase_ = Phase::facing;
    trusted_ = trusted;
    least_tilt_ = seen.tilt();
    apart_rad_ = trusted ? 0 : 2 * least_tilt_;  // the mirrored pose is twice the tilt away
  }

  // What was decided while the marker was smaller in the image may have been wrong.
  void compare_grown(EdgeFollower<Rule>& follower, const SeenPlane& seen) noexcept {
    const bool first = compared_px_ == 0;
    compared_px_ = size_px(follower, seen);
    if (first) return;  // as it was detected: PlanarHypotheses compares
    least_tilt_ = 0;    // so that turning back does not end the comparison
    begin_to_compare(follower, seen, true);
  }

  // Follows both poses from now on.
  // @param trusted the pose is not in doubt before events speak for the other one
  void begin_to_compare(EdgeFollower<Rule>& follower, const SeenPlane& seen, bool trusted = false) noexcept {
    if constexpr (MirrorableRule<Rule>) {
      *other_ = follower;
      other_->mirror(*plane_);
      comparison_ = {};
      trusted_ = trusted;
      phase_ = Phase::comparing;
      update_doubt(follower, seen);
    }
  }

  // Ends the comparison when the poses have met, the events have decided, or the marker turns back.
  bool decide(EdgeFollower<Rule>& follower, const SeenPlane& seen) noexcept {
    const double between_rad = update_doubt(follower, seen), tilt = seen.tilt();
    const bool turns_back = tilt < least_tilt_, decided = comparison_.decided();
    if (!turns_back && !decided && between_rad > 2 * kAlike_rad) return false;
    const bool other_is_right = !turns_back && decided && comparison_.second_is_nearer();
    if (other_is_right) follower = *other_;
    end_comparison(follower);
    if (turns_back || (!decided && is_unsure(follower, seen))) begin_to_face(seen, trusted_);
    return other_is_right;
  }

  // Tells the follower of the other pose, sets apart_rad_, and returns the angle between both poses.
  double update_doubt(EdgeFollower<Rule>& follower, const SeenPlane& seen) noexcept {
    const Eigen::Isometry3d &T = follower.T_camera_marker(), &T_other = other_->T_camera_marker();
    const double between_rad = geodesic_angle(T.linear(), T_other.linear());
    const double probability = comparison_.probability_of_second();
    const bool in_doubt = !trusted_ || probability > 0.5;
    follower.set_other_pose(T_other, in_doubt ? probability : 0);
    apart_rad_ = in_doubt ? between_rad + kSigmas * tilt_deviation(follower, seen) : 0;
    return between_rad;
  }

  void end_comparison(EdgeFollower<Rule>& follower) noexcept {
    phase_ = Phase::sure;
    was_tilted_ = false;
    apart_rad_ = 0;
    follower.set_no_other_pose();
  }

  std::optional<ModelPlane> plane_;
  std::optional<EdgeFollower<Rule>> other_;  // at the mirrored pose; kept, so that copying into it does not allocate
  Phase phase_ = Phase::sure;
  // It was clearly tilted at some time since the start or the last decision. What was known of the side then holds
  // until it nearly faces the camera.
  bool was_tilted_ = false;
  double compared_px_ = 0;  // size of the marker at the last `compare_grown`; 0 before it was judged
  double least_tilt_ = 0;   // since it nearly faces the camera
  double apart_rad_ = 0;    // how far the pose may be off by the wrong side; 0 while the side is not in doubt
  int until_judged_ = 1;    // updates
  bool trusted_ = false;    // while it faces the camera, and while both poses are followed
  PoseComparison comparison_;
};

}  // namespace evmarker
