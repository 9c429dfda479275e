#pragma once
// Tracks a body without a detector, from a rough pose on; after each loss it is searched again.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <exception>
#include <limits>
#include <optional>
#include <ranges>
#include <stdexcept>
#include <string>
#include <utility>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/model/wireframe.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// Settings of a `WireframeTracker`.
template <PoseUpdateRule Rule = KalmanUpdate>
struct WireframeTrackerSettings {
  std::chrono::microseconds filter_window = TrackerSettings<Rule>{}.filter_window;  ///< see TrackerSettings
  MarkerTrackerSettings<Rule> marker{};  ///< `start_search` sets how far from its start the body is searched
};

/// Tracks a wireframe from a rough start on. After a loss it is searched where its motion must have taken it, again and
/// again until it is found. Runs on one thread and is deterministic: the same events give the same poses, however they
/// are batched. After construction nothing throws, and only the begin of a search after a loss allocates.
///
/// Only a search uses filtered events. A body that is being tracked gets all events: matching rejects those beside its
/// edges better than the filter, which needs recent neighbours that the events of a slow edge do not have. On the real
/// recording of a pyramid, 3 % of the poses were wrong with filtered events and none with all events; the median error
/// was 2.5 mm and 1.0 mm.
template <PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class WireframeTracker {
 public:
  using Settings = WireframeTrackerSettings<Rule>;

  /// @param body must have a start
  /// @throws std::invalid_argument naming the setting that is out of range or the fault of the body
  template <CameraModel Camera>
  WireframeTracker(const Camera& camera, const Wireframe& body, const Settings& settings = {})
      : WireframeTracker(camera, body, settings, Filter(camera.sensor_size(), settings.filter_window)) {}

  /// As above, with a noise filter of your own.
  template <CameraModel Camera>
  WireframeTracker(const Camera& camera, const Wireframe& body, const Settings& settings, Filter filter)
      : settings_(settings.marker),
        lines_of_sight_(camera),
        filter_(std::move(filter)),
        body_(body),
        tracker_(lines_of_sight_, body.model, checked_start(body), settings.marker, body.id),
        searched_at_(*body.start) {}

  /// Takes one event. Returns a pose as MarkerTracker does, valid until the next push, or null. After a pose with state
  /// `lost` there is none until the body is `tracking` again.
  template <EventLike E>
  const PoseEstimate* push(const E& foreign_event) noexcept {
    const Event event = to_event(foreign_event);
    if (!count_and_filter(event)) return nullptr;
    if (searching_again_ && !has_pose_) [[unlikely]] {
      if (elapsed_us(last_pose_.t, event.t) < kFlash_us) return nullptr;
      search_anew_if_moved(event.t);
    }
    const PoseEstimate* const pose = tracker_.push(event);
    if (pose == nullptr) return nullptr;
    has_pose_ = true;
    switch (pose->quality.state) {
      case TrackingState::lost: return after_loss(*pose, event.t);
      case TrackingState::converging:
        if (searching_again_) return nullptr;
        break;
      case TrackingState::tracking:
        if (!std::exchange(registered_, true)) ++statistics_.registered;
        searching_again_ = false;
    }
    statistics_.matched += static_cast<std::uint64_t>(pose->quality.matched);
    return pose;
  }

  /// Takes many events and calls `use(pose)` with each pose, valid during the call. The poses are the same as with
  /// single events.
  template <std::ranges::input_range Events, std::invocable<const PoseEstimate&> Use>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push(Events&& events, const Use& use) noexcept(
      std::ranges::contiguous_range<Events>&& noexcept(use(std::declval<const PoseEstimate&>()))) {
    for (auto&& event : events)
      if (const PoseEstimate* const pose = push(event)) use(*pose);
  }

  /// The present estimate; while the body is searched after a loss, the last one before the loss.
  PoseEstimate estimate() const noexcept { return searching_again_ ? lost_->estimate() : tracker_.estimate(); }

  /// The pose at a time at or after the last event, see MarkerTracker::pose_at.
  PoseEstimate pose_at(Timestamp t, Timestamp pushed_until = kPushedUntilUnknown) const noexcept {
    return searching_again_ ? lost_->pose_at(t) : tracker_.pose_at(t, pushed_until);
  }

  /// True if the body was lost and has not been found again.
  bool searching_again() const noexcept { return searching_again_; }
  MarkerId id() const noexcept { return body_.id; }
  const MarkerModel& model() const noexcept { return body_.model; }
  /// Statistics, where `registered` is how often the body was found, and `lost` how often it was lost, which includes
  /// that the first search did not find it.
  const TrackerStatistics& statistics() const noexcept { return statistics_; }

 private:
  // What covers a body all at once shows its edges a last time: for so long after a loss, nothing is found.
  static constexpr std::uint64_t kFlash_us = 1000;
  static constexpr std::uint64_t kPredictAgain_us = 5000;  // between two predictions of the place of a lost body
  static constexpr double kNearest_m = 1e-6;               // least depth of a vertex
  static constexpr double kWider = 1.5;  // a search begins again if it must reach farther by this factor
  static constexpr double kSure = 2;     // standard deviations that a search must reach
  // Limits of the search. Beyond half of the body's size, an edge would be found in the place of another.
  static constexpr double kFarthest_share = 0.5, kFarthest_depth_share = 0.3, kFarthest_rad = 0.4;

  // A predicted pose of the body, and how far from it a search must reach.
  struct Place {
    Eigen::Isometry3d T;
    StartPoseSearchSettings reach;
  };

  // Returns the start of a body; throws if the body or its start is not valid.
  static const Eigen::Isometry3d& checked_start(const Wireframe& body) {
    validate(body.model);
    if (!body.start) throw std::invalid_argument("wireframe " + std::to_string(body.id) + " has no start");
    validate_start(body.model, *body.start);
    return *body.start;
  }

  // Counts and filters an event. Returns false if it is discarded.
  bool count_and_filter(const Event& event) noexcept {
    ++statistics_.events;
    statistics_.time_steps_back += event.t < last_t_;
    last_t_ = event.t;
    if (!lines_of_sight_.sensor_size().contains(event.x, event.y)) {
      ++statistics_.off_sensor;
      return false;
    }
    // Called also where the result does not matter, as the filter needs all events.
    const bool supported = filter_.accept(event);
    if (supported || has_pose_) return true;
    ++statistics_.filtered;
    return false;
  }

  // Begins a search after a loss. Returns the lost pose at the first loss; a search that found nothing only begins
  // again.
  const PoseEstimate* after_loss(const PoseEstimate& pose, Timestamp t) noexcept {
    const bool first = !std::exchange(searching_again_, true);
    if (first) {
      ++statistics_.lost;
      knew_motion_ = std::exchange(registered_, false);
      if (knew_motion_) searched_at_ = pose.T_camera_marker;
      last_pose_ = pose;
      lost_ = std::move(tracker_);
    }
    predicted_t_ = t;
    const auto place = predicted_place(t);
    search(place.value_or(Place{searched_at_, settings_.start_search.value_or(StartPoseSearchSettings{})}));
    return first ? &last_pose_ : nullptr;
  }

  // Begins the search again if the body must have moved out of its reach.
  void search_anew_if_moved(Timestamp t) noexcept {
    if (elapsed_us(predicted_t_, t) < kPredictAgain_us) return;
    predicted_t_ = t;
    const auto place = predicted_place(t);
    if (!place) return;
    double moved_px = 0;
    for (const Eigen::Vector3d& vertex : model().vertices)
      moved_px = std::max(moved_px, norm(image(place->T, vertex) - image(searched_at_, vertex)));
    const double share = place->reach.reach_share;
    if (moved_px > share * size_px(place->T) / 2 || share > kWider * searched_share_) search(*place);
  }

  // The place that the motion before the loss predicts; nothing if the motion is not known or the prediction is less
  // certain than a search may reach.
  std::optional<Place> predicted_place(Timestamp t) const noexcept {
    if (!knew_motion_) return std::nullopt;
    const PoseEstimate pose = lost_->pose_at(std::max(t, lost_->estimate().t));
    Place place{pose.T_camera_marker, settings_.start_search.value_or(StartPoseSearchSettings{})};
    for (const Eigen::Vector3d& vertex : model().vertices)
      if (!(transform(place.T, vertex).z > kNearest_m)) return std::nullopt;
    if (!pose.covariance) return place;
    double variance_px2 = 0;
    for (const Eigen::Vector3d& vertex : model().vertices)
      variance_px2 = std::max(variance_px2, image_variance(pose, vertex, lines_of_sight_.focal_length()));
    const Matrix6d& P = *pose.covariance;
    const auto widen = [](double& reach, double deviation, double farthest) {
      if (!(kSure * deviation <= farthest)) return false;
      reach = std::max(reach, kSure * deviation);
      return true;
    };
    const bool sure =
        widen(place.reach.reach_share, std::sqrt(variance_px2) / size_px(place.T), kFarthest_share) &&
        widen(place.reach.depth_share, std::sqrt(P(2, 2)) / translation(place.T).z, kFarthest_depth_share) &&
        widen(place.reach.rotation_rad, std::sqrt(std::max({P(3, 3), P(4, 4), P(5, 5)})), kFarthest_rad);
    return sure ? std::optional(place) : std::nullopt;
  }

  // Begins a search with a new tracker, the only step that allocates. If there is no memory, the body stays lost.
  void search(const Place& place) noexcept try {
    MarkerTrackerSettings<Rule> settings = settings_;
    if (settings.start_search) settings.start_search = place.reach;
    tracker_ = MarkerTracker<Rule>(lines_of_sight_, model(), place.T, settings, id());
    searched_at_ = place.T;
    searched_share_ = place.reach.reach_share;
    has_pose_ = false;
  } catch (const std::exception&) {
    has_pose_ = false;
  }

  Vec2 image(const Eigen::Isometry3d& T, const Eigen::Vector3d& vertex) const noexcept {
    return lines_of_sight_.focal_length() * on_plane(transform(T, vertex));
  }

  // Longer side of the box around the body in the image.
  double size_px(const Eigen::Isometry3d& T) const noexcept {
    Box box;
    for (const Eigen::Vector3d& vertex : model().vertices) box.extend(image(T, vertex));
    return box.size();
  }

  MarkerTrackerSettings<Rule> settings_;
  UndistortionTable lines_of_sight_;
  Filter filter_;
  Wireframe body_;
  MarkerTracker<Rule> tracker_;              // tracks the body, or searches it
  std::optional<MarkerTracker<Rule>> lost_;  // what tracked it before the last reported loss
  bool searching_again_ = false;             // since the last reported loss
  bool has_pose_ = false;                    // `tracker_` has had a pose: its search is over
  bool knew_motion_ = false;                 // `lost_` had reached the state `tracking`: its motion is the body's
  bool registered_ = false;                  // the state `tracking` was reached since the last loss
  double searched_share_ = 0;                // reach_share of the present search, see StartPoseSearchSettings
  Eigen::Isometry3d searched_at_;            // the pose from which `tracker_` began
  Timestamp predicted_t_ = 0;                // when the place of the body was last predicted
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  PoseEstimate last_pose_;  // the last one that was reported, with the state `lost`
  TrackerStatistics statistics_;
};

}  // namespace evmarker
