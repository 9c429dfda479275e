#pragma once
// Floor 4. The paper's tracking loop for one marker: match, collect, update every n matched events.
#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "evmarker/pose_update.hpp"
#include "evmarker/segment_matcher.hpp"

namespace evmarker {

template <PoseUpdateRule Rule>
struct EdgeFollowerSettings {
  int events_per_update = 100;        ///< the paper's n, matched events
  SegmentMatcherSettings matching{};  ///< the paper's segment matching
  typename Rule::Settings update{};   ///< gains of the update rule
};

/// What one update rested on.
struct UpdateStatistics {
  int matched = 0;         ///< events that took part
  int offered = 0;         ///< events on or near the wireframe since the update before, matched or not
  double residual_px = 0;  ///< root mean square distance of the matched events to their segments [px]
};

/// Follows a wireframe from a known pose on. A copyable value that knows nothing but the events it is given, so that a
/// copy can be run backwards to verify it.
template <PoseUpdateRule Rule>
class EdgeFollower {
 public:
  using Settings = EdgeFollowerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting, or a pose that does not have the model in front of the camera
  EdgeFollower(MarkerModel model, double focal_length, const Eigen::Isometry3d& T_camera_marker,
               const Settings& settings)
      : events_per_update_(settings.events_per_update),
        matcher_(std::move(model), focal_length, settings.matching),
        rule_(settings.update, settings.events_per_update),
        T_camera_marker_(T_camera_marker) {
    if (events_per_update_ < 1)
      throw std::invalid_argument("events_per_update is " + std::to_string(events_per_update_));
    if (!matcher_.project(T_camera_marker_))
      throw std::invalid_argument("T_camera_marker does not put the marker in front of the camera");
  }

  struct Result {
    MatchResult match = MatchResult::far;
    bool updated = false;
  };

  /// Takes the event with line of sight (m; 1) at time t [us].
  Result push(const Eigen::Vector2d& m, Timestamp t) noexcept {
    Correspondence correspondence;
    const MatchResult match = matcher_.match(m, correspondence);
    if (match == MatchResult::far) return {match, false};
    ++offered_;
    if (match != MatchResult::matched) return {match, false};
    rule_.add(correspondence, T_camera_marker_);
    squared_px_ += correspondence.distance_px * correspondence.distance_px;
    if (++matched_ < events_per_update_) return {match, false};
    return {match, update(t)};
  }

  /// Prepares to be fed the past, newest event first, with times that go on forward.
  void reverse() noexcept {
    rule_.reverse();
    start_collecting();
  }

  const Eigen::Isometry3d& T_camera_marker() const noexcept { return T_camera_marker_; }
  const Rule& rule() const noexcept { return rule_; }
  const SegmentMatcher& matcher() const noexcept { return matcher_; }
  const UpdateStatistics& last_update() const noexcept { return last_update_; }
  /// False once the marker is not wholly in front of the camera: nothing will match any more.
  bool in_front() const noexcept { return in_front_; }
  /// Updates that the rule could not do because they were singular.
  int skipped_updates() const noexcept { return skipped_updates_; }

 private:
  bool update(Timestamp t) noexcept {
    last_update_ = {matched_, offered_, std::sqrt(squared_px_ / matched_)};
    start_collecting();
    if (!rule_.update(T_camera_marker_, t)) {
      ++skipped_updates_;
      return false;
    }
    in_front_ = matcher_.project(T_camera_marker_);
    return true;
  }

  void start_collecting() noexcept {
    matched_ = offered_ = 0;
    squared_px_ = 0;
  }

  int events_per_update_;
  SegmentMatcher matcher_;
  Rule rule_;
  Eigen::Isometry3d T_camera_marker_;
  bool in_front_ = true;
  int matched_ = 0, offered_ = 0, skipped_updates_ = 0;
  double squared_px_ = 0;
  UpdateStatistics last_update_;
};

}  // namespace evmarker
