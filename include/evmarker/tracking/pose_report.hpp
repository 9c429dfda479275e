#pragma once
// What an edge follower knows of a pose, as far as its rule estimates it.
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/pose_perturbation.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// Writes the pose, what the rule estimates beside it, and what the last update rested on. As events are late, the pose
/// that they show is that of some time ago: it is moved on by that delay.
// In place: with a pose for every event, making and copying it would cost as much as the matching. An optional that is
// assigned as a whole is copied by a slow instruction for long blocks.
template <PoseUpdateRule Rule>
void report(const EdgeFollower<Rule>& follower, PoseEstimate& pose) noexcept {
  const Rule& rule = follower.rule();
  pose.T_camera_marker = follower.T_camera_marker();
  if constexpr (MotionEstimatingRule<Rule>) {
    if (!pose.covariance) pose.covariance.emplace();
    pose.covariance->noalias() = rule.covariance();
    pose.twist = rule.twist();
  }
  if constexpr (SensorEstimatingRule<Rule>) {
    if (const double delay_s = rule.delay_s(); delay_s > 0) perturb(pose.T_camera_marker, delay_s * *pose.twist);
    pose.edge_offset_px = rule.edge_offset_px();
    pose.trail_px = rule.trail_px();
  }
  pose.quality.matched = follower.last_update().matched;
  pose.quality.offered = follower.last_update().offered;
  pose.quality.residual_px = follower.last_update().residual_px;
}

}  // namespace evmarker
