#pragma once
// Settings of an edge follower.
#include "evmarker/base/require.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// Settings of an `EdgeFollower`.
template <PoseUpdateRule Rule>
struct EdgeFollowerSettings {
  /// The paper's n, matched events. Automatic: as many as the edges make while they move by a tenth of a pixel, at most
  /// the paper's 100. For a rule without a motion model, one event per pixel and passage of an edge is assumed, even if
  /// there are more: it is updated more often and lags less.
  int events_per_update = kAutomatic;
  SegmentMatcherSettings matching{};  ///< the paper's segment matching
  typename Rule::Settings update{};   ///< gains of the update rule
};

/// @throws std::invalid_argument naming the setting that is out of range
template <PoseUpdateRule Rule>
void validate(const EdgeFollowerSettings<Rule>& settings) {
  const Require require("edge follower");
  require(settings.events_per_update >= 1 || settings.events_per_update == kAutomatic, "events_per_update",
          settings.events_per_update);
  validate(settings.matching);
  (void)Rule(settings.update, 1);  // validates the rule's own
}

}  // namespace evmarker
