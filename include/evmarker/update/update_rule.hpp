#pragma once
// The concept of an update rule: how matched events move the pose.
#include <algorithm>
#include <concepts>
#include <limits>

#include "evmarker/matching/correspondence.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/update/matched_background.hpp"

namespace evmarker {

// clang-format off

/// A rule collects matched events at one pose with `add` and moves the pose with `update`. None of its functions throws
/// or allocates. It is a value: a copy goes on independently.
template <typename R>
concept PoseUpdateRule = std::copyable<R> &&
    requires(R& rule, const Correspondence& correspondence, Eigen::Isometry3d& T_camera_marker, Timestamp t,
             int events_per_update, const typename R::Settings& settings) {
  /// Settings are validated here: std::invalid_argument names what is wrong.
  R(settings, events_per_update);
  /// Sets the number of events between two updates.
  { rule.set_events_per_update(events_per_update) } noexcept;
  /// Adds one matched event; the pose is the one at which it was matched.
  { rule.add(correspondence, T_camera_marker) } noexcept;
  /// Moves the pose to the time of the last event. False if the events cannot be used (singular): then the pose is as it
  /// was or, by a rule with a motion model, only predicted.
  { rule.update(T_camera_marker, t) } noexcept -> std::same_as<bool>;
  /// Forgets what was collected and prepares for past events, newest first. The caller mirrors their times, so that t
  /// still increases.
  { rule.reverse() } noexcept;
};

/// A rule whose `add` also takes up to eight matched events at once.
template <typename R>
concept BatchUpdateRule = PoseUpdateRule<R> &&
    requires(R& rule, const Correspondences& correspondences, Eigen::Isometry3d& T_camera_marker) {
  { rule.add(correspondences, T_camera_marker) } noexcept;
};

/// A rule that can allow for background among the matched events; while the marker is at rest, all of them are
/// background.
template <typename R>
concept NoiseAwareRule = PoseUpdateRule<R> && requires(R& rule, const R& constant, const MatchedBackground& background) {
  /// Share of the events since the last `set_background` that come from moving edges, as far as the rule can tell.
  { constant.moving_share() } noexcept -> std::same_as<MovingShare>;
  { rule.set_background(background) } noexcept;
};

/// A rule that estimates the motion and the covariance, too.
template <typename R>
concept MotionEstimatingRule = PoseUpdateRule<R> &&
    requires(R& rule, const R& constant, Eigen::Isometry3d& T_camera_marker, Timestamp t) {
  /// Moves the pose on to a later time without events; forgets what was collected.
  { rule.extrapolate(T_camera_marker, t) } noexcept;
  { constant.covariance() } -> std::same_as<Matrix6d>;
  { constant.twist() } -> std::same_as<Vector6d>;
};

/// A rule that bounds the motion by the number of events that there were.
template <typename R>
concept MotionBoundingRule = MotionEstimatingRule<R> && requires(R& rule, Eigen::Isometry3d& T_camera_marker, Timestamp t) {
  /// Moves the pose on to a time until which all events have been added.
  { rule.advance_by_event_count(T_camera_marker, t) } noexcept;
};

/// A rule that estimates how far blur, and the pixels' response time while edges move, spread events.
template <typename R>
concept SmearEstimatingRule = PoseUpdateRule<R> && requires(R& rule, const R& constant, double distance_px) {
  /// Standard deviation by the response time now [px].
  { constant.smear_px() } noexcept -> std::same_as<double>;
  /// By how much wider edges are, moving or not, than those of a focused sensor.
  { constant.blur() } noexcept -> std::same_as<double>;
  /// Sets within which distance of an edge events are matched, which follows it.
  { rule.set_max_distance_px(distance_px) } noexcept;
};

/// A rule that estimates, too, where and how late the sensor makes the events of an edge.
template <typename R>
concept SensorEstimatingRule = MotionEstimatingRule<R> && SmearEstimatingRule<R> &&
    requires(R& rule, const R& constant, const Correspondence& correspondence, Eigen::Isometry3d& T_camera_marker,
             double events_per_passage) {
  /// Takes how many events a pixel makes while an edge passes over it: corrects the trail, and what follows from it for
  /// state and pose.
  { rule.measure_trail(T_camera_marker, events_per_passage) } noexcept;
  /// Signed distance of an event from where its edge makes events [px].
  { constant.residual_px(correspondence, T_camera_marker) } noexcept -> std::same_as<double>;
  /// How far on the dark side of an edge its events lie, and how far behind it while it moves [px].
  { constant.edge_offset_px() } noexcept -> std::same_as<double>;
  { constant.trail_px() } noexcept -> std::same_as<double>;
  /// By how much events are late [s].
  { constant.delay_s() } noexcept -> std::same_as<double>;
  /// True if events lie nearly evenly over the matching distance: then they do not show where their edges are.
  { constant.events_fill_distance() } noexcept -> std::same_as<bool>;
};

/// A rule that estimates no trail, and takes the one that follows from the events of a passage.
template <typename R>
concept TrailTakingRule = PoseUpdateRule<R> && requires(R& rule, double events_per_passage, double focal_length) {
  { rule.set_trail_by_events_per_passage(events_per_passage, focal_length) } noexcept;
};

/// A rule that can go over to the other pose at which a flat wireframe looks alike.
template <typename R>
concept MirrorableRule = MotionEstimatingRule<R> &&
    requires(R& rule, const R& constant, const Matrix6d& J, const Vec6& deviation) {
  /// Covariance of the pose without what an unknown delay, errors of the model or another pose add.
  { constant.covariance_by_events() } -> std::same_as<Matrix6d>;
  /// True once the velocity is known, since the start or `transform`: the pose then does not lag behind the marker.
  { constant.follows_motion() } -> std::same_as<bool>;
  /// Goes over to another pose, whose motions are J times those of the present one, and which is nearly right.
  { rule.transform(J) } noexcept;
  /// Says that another pose may be right: `deviation` is the perturbation to it, times the square root of its
  /// probability. Its covariance says so, too.
  { rule.set_other_pose(deviation) } noexcept;
};

// clang-format on

/// It is not known whether there were events after the marker's last one.
inline constexpr Timestamp kPushedUntilUnknown = std::numeric_limits<Timestamp>::min();

/// A pose moved on to a later time by the motion model of its rule, if there is one.
/// @param last_rule as of the last update
/// @param pushed_until all events before this time have been pushed: until then, few of them mean little motion
template <PoseUpdateRule Rule>
PoseEstimate extrapolated(PoseEstimate pose, const Rule& last_rule, Timestamp t,
                          Timestamp pushed_until = kPushedUntilUnknown) noexcept {
  Rule rule = last_rule;
  if constexpr (MotionBoundingRule<Rule>)
    if (pose.quality.state != TrackingState::lost)  // a lost tracker takes no events: having none says nothing
      rule.advance_by_event_count(pose.T_camera_marker, std::max(pose.t, std::min(pushed_until, t)));
  pose.t = t;
  if constexpr (MotionEstimatingRule<Rule>) {
    rule.extrapolate(pose.T_camera_marker, t);
    pose.covariance = rule.covariance();
    pose.twist = rule.twist();
  }
  return pose;
}

}  // namespace evmarker
