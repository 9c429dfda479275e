#pragma once
// Settings of a tracker of one marker.
#include <optional>

#include "evmarker/base/require.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/search/start_pose_search.hpp"
#include "evmarker/tracking/edge_follower_settings.hpp"
#include "evmarker/tracking/track_health.hpp"
#include "evmarker/tracking/verification.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// Settings of a `MarkerTracker`.
template <PoseUpdateRule Rule = KalmanUpdate>
struct MarkerTrackerSettings {
  int events_per_update = kAutomatic;   ///< the paper's n, matched events; automatic: see EdgeFollowerSettings
  SegmentMatcherSettings matching{};    ///< the paper's segment matching
  typename Rule::Settings update{};     ///< gains of the update rule
  VerificationSettings verification{};  ///< tracking backwards, the paper's verification
  TrackHealthSettings health{};         ///< when a marker is declared lost
  int converging_events = 0;  ///< least matched events before the pose is `tracking`; the evidence may need more
  /// Search for the marker around its start pose; without it, the marker is tracked from there at once.
  std::optional<StartPoseSearchSettings> start_search = StartPoseSearchSettings{};
};

/// The settings of a marker tracker that are those of its edge follower.
template <PoseUpdateRule Rule>
EdgeFollowerSettings<Rule> follower_settings(const MarkerTrackerSettings<Rule>& settings) {
  return {settings.events_per_update, settings.matching, settings.update};
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
