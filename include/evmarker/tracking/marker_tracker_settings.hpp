#pragma once
// Settings of a tracker of one marker.
#include <optional>

#include "evmarker/base/require.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/search/start_pose_search.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/tracking/track_health.hpp"
#include "evmarker/tracking/verification.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

template <PoseUpdateRule Rule = KalmanUpdate>
struct MarkerTrackerSettings {
  int events_per_update = kAutomatic;   ///< the paper's n, matched events; automatic: see EdgeFollower
  SegmentMatcherSettings matching{};    ///< the paper's segment matching
  typename Rule::Settings update{};     ///< gains of the update rule
  VerificationSettings verification{};  ///< the paper's backtracking
  TrackHealthSettings health{};         ///< what loses a marker
  bool polarity_check = false;          ///< events that contradict their edge's motion do not update, see EdgeFollower
  double polarity_check_px_per_s = 50;  ///< slower edges are not checked [px/s along the normal]
  int converging_events = 0;            ///< matched at least before the pose is `tracking`; the evidence may want more
  /// The marker is first searched around its start pose; without it, tracked from there.
  std::optional<StartPoseSearchSettings> start_search = StartPoseSearchSettings{};
};

/// The part that its edge follower has.
template <PoseUpdateRule Rule>
EdgeFollowerSettings<Rule> follower_settings(const MarkerTrackerSettings<Rule>& settings) {
  return {settings.events_per_update, settings.matching, settings.update, settings.polarity_check,
          settings.polarity_check_px_per_s};
}

/// @throws std::invalid_argument naming the setting that is out of range
template <PoseUpdateRule Rule>
void validate(const MarkerTrackerSettings<Rule>& settings) {
  validate(follower_settings(settings));
  validate(settings.verification);
  validate(settings.health);
  if (settings.start_search) validate(*settings.start_search);
  Require("marker tracker")(settings.converging_events >= 0, "converging_events", settings.converging_events);
}

}  // namespace evmarker
