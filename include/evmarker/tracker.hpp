#pragma once
// Floor 7. Many markers, found by themselves: filter, detect, register, track, verify, drop, find again.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstdint>
#include <ranges>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/detection.hpp"
#include "evmarker/event_history.hpp"
#include "evmarker/marker_tracker.hpp"
#include "evmarker/polarity_frame.hpp"
#include "evmarker/spatiotemporal_filter.hpp"
#include "evmarker/undistortion_table.hpp"

namespace evmarker {

template <PoseUpdateRule Rule = KalmanUpdate>
struct TrackerSettings {
  std::chrono::microseconds filter_window{2000};        ///< of the spatiotemporal filter
  std::chrono::microseconds detection_interval{10000};  ///< event time from one look at the polarity frame to the next
  /// Event time from a look to the registration of what it found, as if the detector took so long; the events between
  /// are replayed into the new trackers.
  std::chrono::microseconds detection_latency{0};
  int min_events_per_detection = 200;  ///< no new look before this many events have passed the filter
  int detections_to_confirm = 2;  ///< looks in a row that must find a marker in the same place before it is tracked
  std::size_t max_markers = 64;   ///< tracked at the same time
  std::size_t history_events = 1u << 18;  ///< kept to be replayed
  MarkerTrackerSettings<Rule> marker{};   ///< of every marker's tracker
};

/// What happened to the events so far.
struct TrackerStatistics {
  std::uint64_t events = 0;           ///< pushed
  std::uint64_t off_sensor = 0;       ///< discarded: outside the camera's image
  std::uint64_t filtered = 0;         ///< discarded: no support in space and time
  std::uint64_t matched = 0;          ///< taken into pose updates, all markers together
  std::uint64_t time_steps_back = 0;  ///< events earlier than the one before; taken as they are
  std::uint64_t detections = 0;       ///< looks at the polarity frame
  std::uint64_t registered = 0;       ///< markers that began to be tracked
  std::uint64_t replayed = 0;         ///< events replayed into markers that began to be tracked
  std::uint64_t lost = 0;             ///< markers that were lost
};

/// Tracks every marker that the detector finds. One thread, deterministic: the same events give the same poses, bit for
/// bit, however they are batched. Between detections nothing throws or allocates.
template <MarkerDetector Detector, PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class Tracker {
 public:
  using Settings = TrackerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting that is out of range
  template <CameraModel Camera>
  Tracker(const Camera& camera, Detector detector, const Settings& settings = {})
      : Tracker(camera, std::move(detector), settings, Filter(camera.sensor_size(), settings.filter_window)) {}

  /// The same with a filter of one's own.
  template <CameraModel Camera>
  Tracker(const Camera& camera, Detector detector, const Settings& settings, Filter filter)
      : settings_(settings),
        lines_(camera),
        detector_(std::move(detector)),
        filter_(std::move(filter)),
        frame_(camera.sensor_size()),
        history_(settings.history_events) {
    const auto require = [](bool good, const char* name, auto value) {
      if (!good) throw std::invalid_argument(std::string("tracker: ") + name + " is " + std::to_string(value));
    };
    require(settings.detection_interval.count() > 0, "detection_interval [us]", settings.detection_interval.count());
    require(settings.detection_latency.count() >= 0, "detection_latency [us]", settings.detection_latency.count());
    require(settings.detections_to_confirm > 0, "detections_to_confirm", settings.detections_to_confirm);
    require(settings.max_markers > 0, "max_markers", settings.max_markers);
    markers_.reserve(settings.max_markers);
    poses_.reserve(settings.max_markers);
  }

  /// Takes one event. Returns the poses that it led to, valid until the next push.
  template <EventLike E>
  std::span<const PoseEstimate> push(const E& foreign_event) {
    poses_.clear();
    const Event event = to_event(foreign_event);
    if (!count(event)) return poses_;
    if (!filter_.accept(event)) {
      ++statistics_.filtered;
      return poses_;
    }
    ++passed_;
    frame_.update(event);
    history_.push(event);
    for (MarkerTracker<Rule>& rival : rivals_) rival.push(event);
    for (MarkerTracker<Rule>& marker : markers_) track(marker, event);
    if (!poses_.empty()) drop_lost();
    if (detection_due(event.t)) detect(event.t);
    if (registration_due(event.t)) register_detections();
    return poses_;
  }

  const TrackerStatistics& statistics() const noexcept { return statistics_; }
  const PolarityFrame& polarity_frame() const noexcept { return frame_; }
  std::span<const MarkerTracker<Rule>> markers() const noexcept { return markers_; }

 private:
  struct Candidate {
    MarkerDetection detection;
    int sightings = 0;
  };

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

  void track(MarkerTracker<Rule>& marker, const Event& event) {
    if (const auto pose = marker.push(event)) deliver(settle(marker) ? marker.estimate() : *pose);
  }

  // A planar marker has two poses that look alike from afar. Both were started; once the likelier one has converged,
  // the one whose edges explained the events better goes on. True if it is the other.
  bool settle(MarkerTracker<Rule>& marker) noexcept {
    if (marker.state() == TrackingState::converging) return false;
    const auto rival = std::ranges::find(rivals_, marker.id(), &MarkerTracker<Rule>::id);
    if (rival == rivals_.end()) return false;
    const bool better = rival->state() != TrackingState::lost &&
                        (marker.state() == TrackingState::lost || rival->misfit_px() < marker.misfit_px());
    if (better) std::swap(marker, *rival);
    rivals_.erase(rival);
    return better;
  }

  // A lost marker's id goes back to the detector.
  void drop_lost() noexcept {
    std::erase_if(markers_, [](const auto& marker) { return marker.state() == TrackingState::lost; });
  }

  bool detection_due(Timestamp t) const noexcept {
    return passed_ >= settings_.min_events_per_detection && !registration_pending_ &&
           time_for(t, settings_.detection_interval);
  }

  bool registration_due(Timestamp t) const noexcept {
    return registration_pending_ && time_for(t, settings_.detection_latency);
  }

  // So much later than the last look, or before it: a step back in time must not stop the detection.
  bool time_for(Timestamp t, std::chrono::microseconds wait) const noexcept {
    return t < last_look_ || elapsed_us(last_look_, t) >= static_cast<std::uint64_t>(wait.count());
  }

  // Looks at the frame and keeps what it finds until the registration.
  void detect(Timestamp t) {
    ++statistics_.detections;
    last_look_ = t;
    passed_ = 0;
    looked_at_ = history_.pushed();
    std::vector<Candidate> seen;
    for (const MarkerDetection& detection : detector_.detect(frame_)) {
      const auto before = std::ranges::find_if(candidates_, [&](const Candidate& candidate) {
        return candidate.detection.id == detection.id && same_place(candidate.detection, detection.T_camera_marker);
      });
      seen.push_back({detection, before == candidates_.end() ? 1 : before->sightings + 1});
    }
    candidates_ = std::move(seen);
    registration_pending_ = !candidates_.empty();
  }

  // Starts a tracker for every confirmed marker that is not tracked yet, with the events since it was found.
  void register_detections() {
    registration_pending_ = false;
    for (const auto& [detection, sightings] : candidates_) {
      if (sightings < settings_.detections_to_confirm || tracked(detection)) continue;
      if (markers_.size() == settings_.max_markers) break;
      ++statistics_.registered;
      if (detection.T_camera_marker_alternative)
        rivals_.push_back(start(detection, *detection.T_camera_marker_alternative));
      markers_.push_back(start(detection, detection.T_camera_marker));
      history_.for_each_since(looked_at_, [&](const Event& event) {
        ++statistics_.replayed;
        if (!rivals_.empty() && rivals_.back().id() == detection.id) rivals_.back().push(event);
        track(markers_.back(), event);
      });
    }
    drop_lost();
  }

  MarkerTracker<Rule> start(const MarkerDetection& detection, const Eigen::Isometry3d& T_camera_marker) {
    return {lines_, detector_.model(detection.id), T_camera_marker, settings_.marker, detection.id};
  }

  // Whether the id is being tracked where it was found. A tracker that has had no update while its marker is seen
  // elsewhere has lost it: nothing moved where it waits.
  bool tracked(const MarkerDetection& detection) {
    const auto marker = std::ranges::find(markers_, detection.id, &MarkerTracker<Rule>::id);
    if (marker == markers_.end()) return false;
    const Timestamp seen = marker->estimate().t;
    const bool silent = seen < detection.t && elapsed_us(seen, detection.t) >
                                                  static_cast<std::uint64_t>(settings_.detection_interval.count());
    if (!silent || same_place(detection, marker->T_camera_marker())) return true;
    deliver(marker->lose());
    markers_.erase(marker);
    std::erase_if(rivals_, [&](const auto& rival) { return rival.id() == detection.id; });
    return false;
  }

  // Within half the marker's own size of where it was detected.
  bool same_place(const MarkerDetection& detection, const Eigen::Isometry3d& T) const noexcept {
    const Eigen::Vector3d& a = detection.T_camera_marker.translation();
    const Eigen::Vector3d& b = T.translation();
    const double apart_px = lines_.focal_length() * (a.head<2>() / a.z() - b.head<2>() / b.z()).norm();
    return apart_px < 0.25 * ((detection.corners_px[0] - detection.corners_px[2]).norm() +
                              (detection.corners_px[1] - detection.corners_px[3]).norm());
  }

  Settings settings_;
  UndistortionTable lines_;
  Detector detector_;
  Filter filter_;
  PolarityFrame frame_;
  EventHistory history_;
  std::vector<MarkerTracker<Rule>> markers_;
  std::vector<MarkerTracker<Rule>> rivals_;  // from the other pose of a planar marker, until one of the two is dropped
  std::vector<PoseEstimate> poses_;
  std::vector<Candidate> candidates_;  // found in the last look
  bool registration_pending_ = false;
  Timestamp last_look_ = std::numeric_limits<Timestamp>::min();
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  std::uint64_t looked_at_ = 0;  // position in the history of the last look
  int passed_ = 0;               // events through the filter since the last look
  TrackerStatistics statistics_;
};

}  // namespace evmarker
