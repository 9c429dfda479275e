#pragma once
// The concept of an update rule: how matched events move the pose.
#include <algorithm>
#include <concepts>
#include <limits>

#include "evmarker/matching/correspondence.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// A rule collects matched events at one pose with `add` and moves the pose with `update`. None of its functions throws
/// or allocates. It is a value: a copy goes on independently.
template <typename R>
concept PoseUpdateRule = std::copyable<R> &&
    requires(R& rule, const Correspondence& correspondence, Eigen::Isometry3d& T_camera_marker, Timestamp t,
             int events_per_update, const typename R::Settings& settings) {
  /// Settings are validated here: std::invalid_argument names what is wrong.
  R(settings, events_per_update);
  /// Sets the number of events between two updates.
  { rule.set_events_per_update(events_per_update) }
  noexcept;
  /// Takes one matched event; the pose is the one at which it was matched.
  { rule.add(correspondence, T_camera_marker) }
  noexcept;
  /// Moves the pose to the time of the last event. False, with the pose as it was, for a skipped (singular) step.
  { rule.update(T_camera_marker, t) }
  noexcept->std::same_as<bool>;
  /// Forgets what was collected and prepares to run backwards in time.
  { rule.reverse() }
  noexcept;
};

/// A rule that takes eight matched events as fast as one: its `add` is inline and made of loops over lanes.
template <typename R>
concept GroupUpdateRule = PoseUpdateRule<R> &&
    requires(R& rule, const Correspondences& correspondences, Eigen::Isometry3d& T_camera_marker) {
  { rule.add(correspondences, T_camera_marker) }
  noexcept;
};

/// A rule that allows for background among the matched events: while the marker rests, all of them are.
template <typename R>
concept RestingRule = PoseUpdateRule<R> && requires(R& rule) {
  /// Sets the share of the matched events that are the marker's, 0 at rest.
  { rule.expect_signal(1.0) }
  noexcept;
};

/// A rule that estimates the motion and the covariance, too.
template <typename R>
concept MotionEstimatingRule = PoseUpdateRule<R> &&
    requires(R& rule, const R& constant, Eigen::Isometry3d& T_camera_marker, Timestamp t) {
  /// Moves the pose on to a later time without events; forgets what was collected.
  { rule.extrapolate(T_camera_marker, t) }
  noexcept;
  { constant.covariance() } -> std::same_as<Matrix6d>;
  { constant.twist() } -> std::same_as<Vector6d>;
};

/// No event since the marker's last one.
inline constexpr Timestamp kNothingHeard = std::numeric_limits<Timestamp>::min();

/// A pose moved on to a later time by the motion model of its rule, if there is one.
/// @param heard all events before this time have been pushed: the fewer there were, the less the marker moved
template <PoseUpdateRule Rule>
PoseEstimate extrapolated(PoseEstimate pose, Rule rule, Timestamp t, Timestamp heard = kNothingHeard) noexcept {
  if constexpr (requires { rule.wait(pose.T_camera_marker, t); })
    if (pose.quality.state != TrackingState::lost)
      rule.wait(pose.T_camera_marker, std::max(pose.t, std::min(heard, t)));
  pose.t = t;
  if constexpr (MotionEstimatingRule<Rule>) {
    rule.extrapolate(pose.T_camera_marker, t);
    pose.covariance = rule.covariance();
    pose.twist = rule.twist();
  }
  return pose;
}

}  // namespace evmarker
