#pragma once
// Floor 9. Many markers from what a detector finds, whenever that is told: filter, register, track, verify, drop.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <ranges>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/candidate.hpp"
#include "evmarker/event_history.hpp"
#include "evmarker/found_marker.hpp"
#include "evmarker/look.hpp"
#include "evmarker/look_schedule.hpp"
#include "evmarker/polarity_frame.hpp"
#include "evmarker/spatiotemporal_filter.hpp"
#include "evmarker/tile_map.hpp"
#include "evmarker/tracker_settings.hpp"
#include "evmarker/undistortion_table.hpp"
#include "evmarker/visible_markers.hpp"

namespace evmarker {

/// Everything that tracks markers but the detector: says when a look at the polarity frame is due, and is told at any
/// time after it what was found. What `Tracker` is made of, for those who run the detector elsewhere. Between looks
/// nothing throws or allocates.
template <PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class TrackerCore {
 public:
  using Settings = TrackerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting that is out of range
  template <CameraModel Camera>
  TrackerCore(const Camera& camera, const Settings& settings, Filter filter)
      : settings_(settings),
        lines_(camera),
        filter_(std::move(filter)),
        frame_(camera.sensor_size()),
        history_(settings.history_events),
        looks_(settings),
        tiles_(lines_) {
    const auto require = [](bool good, const char* name, auto value) {
      if (!good) throw std::invalid_argument(std::string("tracker: ") + name + " is " + std::to_string(value));
    };
    require(settings.detection_interval.count() > 0, "detection_interval [us]", settings.detection_interval.count());
    require(settings.search_interval.count() > 0, "search_interval [us]", settings.search_interval.count());
    require(settings.detection_latency.count() >= 0, "detection_latency [us]", settings.detection_latency.count());
    require(settings.detections_to_confirm > 0, "detections_to_confirm", settings.detections_to_confirm);
    require(settings.max_markers > 0, "max_markers", settings.max_markers);
    settings_.marker.capture.reset();  // a detection has been fitted to the edges already
    markers_.reserve(settings.max_markers);
    candidates_.reserve(settings.max_markers);
    missing_.reserve(settings.max_markers);
    poses_.reserve(settings.max_markers);
  }

  /// Takes one event: `poses()` are then those that it led to. False if it was discarded.
  bool push(const Event& event) {
    poses_.clear();
    if (!count(event)) return false;
    if (!filter_.accept(event)) {
      ++statistics_.filtered;
      return false;
    }
    looks_.count_event();
    frame_.update(event);
    history_.push(event);
    if (tiles_.shared(event)) [[unlikely]]
      for_each_visible_at(event, lines_(event), tiles_, markers_, [&](std::size_t i) { push_to(i, event); });
    else
      tiles_.for_each_at(event, [&](std::size_t i) { push_to(i, event); });
    if (!poses_.empty()) drop_lost();
    if (!candidates_.empty()) [[unlikely]]
      catch_up(kEventsForOne);
    return true;
  }

  /// Whether a marker that was found has not seen all events yet that came since the look.
  bool behind() const noexcept {
    return !std::ranges::all_of(candidates_, [&](const auto& candidate) { return candidate.caught_up(history_); });
  }

  /// Has such markers take so many of these events, for the time in which no others come. Adds to `poses()`.
  void catch_up(int events) {
    for (Candidate<Rule>& candidate : candidates_) candidate.catch_up(history_, events, statistics_);
    announce_confirmed();
  }

  /// Goes on at a later time, the events until then missing: `poses()` are those of the markers that this loses. What
  /// is found in a look before it is not followed.
  void skip_to(Timestamp t) {
    poses_.clear();
    if (!(t > last_t_)) return;
    const auto missing = std::chrono::microseconds(std::min<std::uint64_t>(elapsed_us(last_t_, t), kForEver));
    if (missing <= MarkerTracker<Rule>::kBriefly) return;
    followable_since_ = history_.pushed();
    std::erase_if(candidates_, [&](Candidate<Rule>& candidate) {
      candidate.marker().skip(missing);
      return !candidate.caught_up(history_);
    });
    for (FoundMarker<Rule>& marker : markers_)
      if (const PoseEstimate* const lost = marker.skip(missing)) deliver(*lost);
    drop_lost();
    place_markers();
  }

  /// The poses since the last event was pushed, valid until the next one is.
  std::span<const PoseEstimate> poses() const noexcept { return poses_; }
  void clear_poses() noexcept { poses_.clear(); }

  /// Whether the frame should be looked at after this event that was taken. Not while an answer is awaited.
  bool look_due(Timestamp t) const noexcept { return looks_.due(t, searching()); }

  /// Whether a marker is looked for that should be there: none is tracked, or not confirmed, or one was just lost.
  bool searching() const noexcept { return markers_.empty() || !candidates_.empty() || !missing_.empty(); }

  /// What to ask the detector about the frame as it is now. From here on the answer is awaited.
  Look look(Timestamp t) {
    ++statistics_.detections;
    looks_.begin(t);
    forget_missing(t);
    Look look{
        .t = t, .position = history_.pushed(), .focal_length = lines_.focal_length(), .unconfirmed = {}, .missing = {}};
    for (Candidate<Rule>& candidate : candidates_)
      if (candidate.ask(history_))
        look.unconfirmed.push_back({candidate.marker().id(), candidate.marker().tracker().T_camera_marker()});
    for (const Missing& missing : missing_)
      look.missing.push_back({missing.marker.id(), missing.marker.tracker().pose_at(t).T_camera_marker});
    return look;
  }

  /// Whether the answer is due, `detection_latency` after the look.
  bool answer_due(Timestamp t) const noexcept { return looks_.answer_due(t); }
  bool answer_awaited() const noexcept { return looks_.answer_awaited(); }
  /// No answer will come to the look.
  void give_up_look() noexcept { looks_.end(); }

  /// The answer to the look: announces the markers that were seen often enough, starts a tracker for every marker that
  /// is not tracked yet, with the events since the look. Adds to `poses()`.
  void take(const Findings& findings) {
    looks_.end();
    std::erase_if(missing_, [&](const Missing& missing) {
      return std::ranges::any_of(findings.found | std::views::take(findings.detected),
                                 [&](const auto& found) { return found.detection.id == missing.marker.id(); });
    });
    confirm(findings);
    for (const Findings::Found& found : findings.found) {
      if (findings.position <= followable_since_ || tracked(found.detection)) continue;
      if (markers_.size() + candidates_.size() == settings_.max_markers) break;
      candidates_.emplace_back(FoundMarker<Rule>(lines_, found.model, found.detection, settings_.marker),
                               findings.position, history_);
    }
    announce_confirmed();
    drop_lost();
  }

  const TrackerStatistics& statistics() const noexcept { return statistics_; }
  const PolarityFrame& polarity_frame() const noexcept { return frame_; }
  /// Time of the last event pushed [us].
  Timestamp last_t() const noexcept { return last_t_; }
  /// The `MarkerTracker` of every marker that is being tracked.
  auto markers() const noexcept {
    return std::views::transform(
        markers_, [](const auto& marker) -> const auto& { return marker.tracker(); });
  }

 private:
  static constexpr std::uint64_t kForEver = 1000000000;  // [us]
  static constexpr int kEventsForOne = 2;  // that candidates take for each that comes: a look's lag is soon gone

  struct Missing {
    FoundMarker<Rule> marker;
    Timestamp since;
  };

  [[gnu::always_inline]] void push_to(std::size_t i, const Event& event) {
    const PoseEstimate* const pose = markers_[i].push(event);
    if (pose == nullptr) return;
    deliver(*pose);
    place_marker(i);
  }

  // Counts the event; false if it is not on the sensor.
  bool count(const Event& event) noexcept {
    ++statistics_.events;
    statistics_.time_steps_back += event.t < last_t_;
    last_t_ = event.t;
    if (lines_.sensor_size().contains(event.x, event.y)) return true;
    ++statistics_.off_sensor;
    return false;
  }

  void deliver(const PoseEstimate& pose) {
    poses_.push_back(pose);
    if (pose.quality.state == TrackingState::lost)
      ++statistics_.lost;
    else
      statistics_.matched += static_cast<std::uint64_t>(pose.quality.matched);
  }

  // A lost marker's id goes back to the detector.
  void drop_lost() {
    for (FoundMarker<Rule>& marker : markers_)
      if (marker.lost() && missing_.size() < settings_.max_markers) missing_.push_back({std::move(marker), last_t_});
    if (std::erase_if(markers_, [](const auto& marker) { return marker.lost(); }) > 0) place_markers();
  }

  // Enters all markers into the tiles anew: their places in the list have changed.
  void place_markers() {
    tiles_.resize(markers_.size());
    for (std::size_t i = 0; i < markers_.size(); ++i) place_marker(i);
  }

  // Where it may have events, and where its paper may hide other markers.
  void place_marker(std::size_t i) noexcept {
    tiles_.move(i, markers_[i].reach(markers_.size() > 1 ? LatticeMatcher::kRim : 0));
  }

  // A marker that was just lost is looked for where its motion must have taken it.
  void forget_missing(Timestamp t) {
    constexpr std::uint64_t kPredictable = 100000;  // [us]
    std::erase_if(missing_, [&](const Missing& missing) { return elapsed_us(missing.since, t) > kPredictable; });
  }

  // What the look says of the candidates that it was asked about. None of them has been announced since.
  void confirm(const Findings& findings) {
    std::size_t place = 0;
    for (Candidate<Rule>& candidate : candidates_)
      if (candidate.asked()) {
        candidate.answer(place < findings.confirmed.size() && findings.confirmed[place]);
        ++place;
      }
    announce_confirmed();
    std::erase_if(candidates_, [](const auto& candidate) { return candidate.hopeless(); });
  }

  // Announces the candidates that were seen often enough and have seen all events.
  void announce_confirmed() {
    std::erase_if(candidates_, [&](Candidate<Rule>& candidate) {
      FoundMarker<Rule>& marker = candidate.marker();
      if (marker.lost() || candidate.sightings() < settings_.detections_to_confirm || !candidate.caught_up(history_))
        return false;
      if (marker.tracker().estimate().quality.matched > 0) deliver(marker.tracker().estimate());
      ++statistics_.registered;
      looks_.note_found(last_t_);
      markers_.push_back(std::move(marker));
      place_markers();
      return true;
    });
  }

  // Whether the id is being tracked where it was found. A tracker that has had no event while its marker is seen
  // elsewhere has lost it: nothing moved where it waits; nor has one whose events are of a time to come, before the
  // camera was started anew. One that was never confirmed has followed something else.
  bool tracked(const MarkerDetection& detection) {
    const auto candidate = std::ranges::find(candidates_, detection.id, [](const auto& c) { return c.marker().id(); });
    if (candidate != candidates_.end()) {
      if (same_place(detection, candidate->marker().tracker().T_camera_marker())) return true;
      candidates_.erase(candidate);
      return false;
    }
    const auto marker = std::ranges::find(markers_, detection.id, &FoundMarker<Rule>::id);
    if (marker == markers_.end()) return false;
    const Timestamp seen = marker->tracker().estimate().t;
    constexpr std::uint64_t kRestart_us = 1000000;
    const bool silent = seen < detection.t ? elapsed_us(seen, detection.t) >
                                                 static_cast<std::uint64_t>(settings_.detection_interval.count())
                                           : elapsed_us(detection.t, seen) > kRestart_us;
    if (!silent || same_place(detection, marker->tracker().T_camera_marker())) return true;
    deliver(marker->tracker().lose());
    markers_.erase(marker);
    place_markers();
    return false;
  }

  bool same_place(const MarkerDetection& detection, const Eigen::Isometry3d& T) const noexcept {
    return evmarker::same_place(detection, T, lines_.focal_length());
  }

  Settings settings_;
  UndistortionTable lines_;
  Filter filter_;
  PolarityFrame frame_;
  EventHistory history_;
  LookSchedule looks_;
  TileMap tiles_;                           // of `markers_`
  std::vector<FoundMarker<Rule>> markers_;  // announced
  std::vector<Candidate<Rule>> candidates_;
  std::vector<Missing> missing_;  // lost a short time ago
  std::vector<PoseEstimate> poses_;
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  std::uint64_t followable_since_ = 0;  // position in the history after which no events are missing
  TrackerStatistics statistics_;
};

}  // namespace evmarker
