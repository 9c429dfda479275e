#pragma once
// Floor 8. Many markers, found by themselves: filter, detect, register, track, verify, drop, find again.
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
#include "evmarker/found_marker.hpp"
#include "evmarker/marker_tracker.hpp"
#include "evmarker/polarity_frame.hpp"
#include "evmarker/spatiotemporal_filter.hpp"
#include "evmarker/undistortion_table.hpp"

namespace evmarker {

template <PoseUpdateRule Rule = KalmanUpdate>
struct TrackerSettings {
  std::chrono::microseconds filter_window{2000};        ///< of the spatiotemporal filter
  std::chrono::microseconds detection_interval{10000};  ///< event time from one look at the polarity frame to the next
  std::chrono::microseconds search_interval{5000};      ///< the same until there is a marker, all confirmed
  /// Event time from a look to the registration of what it found, as if the detector took so long; the events between
  /// are replayed into the new trackers.
  std::chrono::microseconds detection_latency{0};
  int min_events_per_detection = 200;  ///< no new look before this many events have passed the filter
  int detections_to_confirm = 2;  ///< looks that must show a marker's code where it is tracked before it is announced
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
  std::uint64_t registered = 0;       ///< markers that were confirmed: from then on there are poses
  std::uint64_t replayed = 0;         ///< events replayed into markers that began to be tracked
  std::uint64_t lost = 0;             ///< of the registered
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
    require(settings.search_interval.count() > 0, "search_interval [us]", settings.search_interval.count());
    require(settings.detection_latency.count() >= 0, "detection_latency [us]", settings.detection_latency.count());
    require(settings.detections_to_confirm > 0, "detections_to_confirm", settings.detections_to_confirm);
    require(settings.max_markers > 0, "max_markers", settings.max_markers);
    markers_.reserve(settings.max_markers);
    missing_.reserve(settings.max_markers);
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
    for (Unconfirmed& unconfirmed : unconfirmed_) unconfirmed.marker.push(event);
    for (FoundMarker<Rule>& marker : markers_)
      if (const auto pose = marker.push(event)) deliver(*pose);
    if (!poses_.empty()) drop_lost();
    if (detection_due(event.t)) detect(event.t);
    if (registration_due(event.t)) register_detections();
    return poses_;
  }

  const TrackerStatistics& statistics() const noexcept { return statistics_; }
  const PolarityFrame& polarity_frame() const noexcept { return frame_; }
  /// The `MarkerTracker` of every marker that is being tracked.
  auto markers() const noexcept {
    return std::views::transform(
        markers_, [](const auto& marker) -> const auto& { return marker.tracker(); });
  }

 private:
  // Tracked since it was found; its poses are kept back until more looks have shown its code where the tracker has it.
  struct Unconfirmed {
    FoundMarker<Rule> marker;
    int sightings = 1;
    int looks = 1;
  };

  struct Missing {
    FoundMarker<Rule> marker;
    Timestamp since;
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

  // A lost marker's id goes back to the detector.
  void drop_lost() {
    for (FoundMarker<Rule>& marker : markers_)
      if (marker.lost() && missing_.size() < settings_.max_markers) missing_.push_back({std::move(marker), last_t_});
    std::erase_if(markers_, [](const auto& marker) { return marker.lost(); });
  }

  bool detection_due(Timestamp t) const noexcept {
    const bool searching = markers_.empty() || !unconfirmed_.empty();
    return passed_ >= settings_.min_events_per_detection && !registration_pending_ &&
           time_for(t, searching ? settings_.search_interval : settings_.detection_interval);
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
    found_.clear();
    for (const MarkerDetection& detection : detector_.detect(frame_)) found_.push_back(detection);
    search_missing(t);
    confirm();
    registration_pending_ = !found_.empty();
  }

  // A marker that was just lost is looked for where its motion must have taken it: the detector may not find it there
  // by itself, if a part of it is hidden.
  void search_missing(Timestamp t) {
    constexpr std::uint64_t kPredictable = 100000;  // [us]
    std::erase_if(missing_, [&](const Missing& missing) {
      const MarkerId id = missing.marker.id();
      return elapsed_us(missing.since, t) > kPredictable || std::ranges::count(found_, id, &MarkerDetection::id) > 0;
    });
    if constexpr (requires(MarkerId id, Eigen::Isometry3d T) { detector_.search(id, T); })
      for (const auto& [marker, since] : missing_)
        if (const auto found = detector_.search(marker.id(), marker.tracker().pose_at(t).T_camera_marker))
          found_.push_back(*found);
  }

  // Whether the last look shows the marker's code where it is tracked.
  bool shown(const MarkerTracker<Rule>& marker) const {
    if constexpr (requires { detector_.shows(marker.id(), marker.T_camera_marker()); })
      return detector_.shows(marker.id(), marker.T_camera_marker());
    else
      return std::ranges::any_of(found_, [&](const MarkerDetection& detection) {
        return detection.id == marker.id() && same_place(detection, marker.T_camera_marker());
      });
  }

  // Announces the markers that were seen often enough; the others have some looks left.
  void confirm() {
    constexpr int kPatience = 10;  // [looks]
    std::erase_if(unconfirmed_, [&](Unconfirmed& unconfirmed) {
      auto& [marker, sightings, looks] = unconfirmed;
      if (marker.lost() || ++looks > kPatience) return true;
      sightings += shown(marker.tracker());
      if (sightings < settings_.detections_to_confirm) return false;
      deliver(marker.tracker().estimate());
      announce(std::move(marker));
      return true;
    });
  }

  void announce(FoundMarker<Rule> marker) {
    ++statistics_.registered;
    markers_.push_back(std::move(marker));
  }

  // Starts a tracker for every marker that is not tracked yet, with the events since it was found.
  void register_detections() {
    registration_pending_ = false;
    for (const MarkerDetection& detection : found_) {
      if (tracked(detection)) continue;
      if (markers_.size() + unconfirmed_.size() == settings_.max_markers) break;
      FoundMarker<Rule> marker(lines_, detector_.model(detection.id), detection, settings_.marker);
      const bool confirmed = settings_.detections_to_confirm == 1;
      history_.for_each_since(looked_at_, [&](const Event& event) {
        ++statistics_.replayed;
        if (const auto pose = marker.push(event); pose && confirmed) deliver(*pose);
      });
      if (confirmed)
        announce(std::move(marker));
      else
        unconfirmed_.push_back({std::move(marker)});
    }
    drop_lost();
  }

  // Whether the id is being tracked where it was found. A tracker that has had no update while its marker is seen
  // elsewhere has lost it: nothing moved where it waits. One that was never confirmed has followed something else.
  bool tracked(const MarkerDetection& detection) {
    const auto unconfirmed = std::ranges::find(unconfirmed_, detection.id, [](const auto& u) { return u.marker.id(); });
    if (unconfirmed != unconfirmed_.end()) {
      if (same_place(detection, unconfirmed->marker.tracker().T_camera_marker())) return true;
      unconfirmed_.erase(unconfirmed);
      return false;
    }
    const auto marker = std::ranges::find(markers_, detection.id, &FoundMarker<Rule>::id);
    if (marker == markers_.end()) return false;
    const Timestamp seen = marker->tracker().estimate().t;
    const bool silent = seen < detection.t && elapsed_us(seen, detection.t) >
                                                  static_cast<std::uint64_t>(settings_.detection_interval.count());
    if (!silent || same_place(detection, marker->tracker().T_camera_marker())) return true;
    deliver(marker->tracker().lose());
    markers_.erase(marker);
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
  std::vector<FoundMarker<Rule>> markers_;  // announced
  std::vector<Unconfirmed> unconfirmed_;
  std::vector<Missing> missing_;        // lost a short time ago
  std::vector<MarkerDetection> found_;  // in the last look
  std::vector<PoseEstimate> poses_;
  bool registration_pending_ = false;
  Timestamp last_look_ = std::numeric_limits<Timestamp>::min();
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  std::uint64_t looked_at_ = 0;  // position in the history of the last look
  int passed_ = 0;               // events through the filter since the last look
  TrackerStatistics statistics_;
};

}  // namespace evmarker
