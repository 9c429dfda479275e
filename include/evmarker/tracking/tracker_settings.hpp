#pragma once
// Settings and statistics of a tracker of many markers.
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "evmarker/base/require.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/tracking/marker_tracker_settings.hpp"

namespace evmarker {

/// Settings of a `Tracker`.
template <PoseUpdateRule Rule = KalmanUpdate>
struct TrackerSettings {
  /// Window of the spatiotemporal filter: automatic, by the sensor's noise, or fixed, as the paper's 2000 us.
  std::chrono::microseconds filter_window = kAutomaticWindow;
  std::chrono::microseconds detection_interval{25000};  ///< camera time from one detection to the next
  /// The same while a marker is missing: none is tracked, one is not confirmed yet, or one was confirmed or lost less
  /// than 0.1 s ago.
  std::chrono::microseconds search_interval{5000};
  /// The same while every marker that the detector may find is tracked, see EnumeratingDetector: a detection then only
  /// shows whether one of them is elsewhere.
  std::chrono::microseconds check_interval{250000};
  /// Camera time from the request of a detection to the use of its result, as if the detector took so long. The events
  /// in between are replayed into the trackers of the new markers.
  std::chrono::microseconds detection_latency{0};
  int min_events_per_detection = 200;  ///< no new detection before this many events have passed the filter
  /// How many frames must show a marker's code at its tracked pose before its poses are reported.
  int detections_to_confirm = 2;
  std::size_t max_markers = 64;           ///< tracked at the same time
  std::size_t history_events = 1u << 18;  ///< events kept for replay
  MarkerTrackerSettings<Rule> marker{};   ///< of every marker's tracker
};

/// @throws std::invalid_argument naming the setting that is out of range
template <PoseUpdateRule Rule>
void validate(const TrackerSettings<Rule>& settings) {
  const Require require("tracker");
  require(settings.detection_interval.count() > 0, "detection_interval [us]", settings.detection_interval.count());
  require(settings.search_interval.count() > 0, "search_interval [us]", settings.search_interval.count());
  require(settings.check_interval.count() > 0, "check_interval [us]", settings.check_interval.count());
  require(settings.detection_latency.count() >= 0, "detection_latency [us]", settings.detection_latency.count());
  require(settings.detections_to_confirm > 0, "detections_to_confirm", settings.detections_to_confirm);
  require(settings.max_markers > 0, "max_markers", settings.max_markers);
  require(settings.history_events > 0, "history_events", settings.history_events);
  validate(settings.marker);  // here, and not when the first marker is found
}

/// What has happened to the events and the markers so far.
struct TrackerStatistics {
  std::uint64_t events = 0;           ///< pushed
  std::uint64_t off_sensor = 0;       ///< discarded: outside the camera's image
  std::uint64_t hot = 0;              ///< discarded: of hot pixels, see HotPixels
  std::uint64_t filtered = 0;         ///< not supported by a neighbour: used only for markers that are tracked already
  std::uint64_t time_faults = 0;      ///< discarded: their times contradict those of the events before and after
  std::uint64_t matched = 0;          ///< used in pose updates, all markers together
  std::uint64_t time_steps_back = 0;  ///< events earlier than the one before; used all the same
  std::uint64_t outages = 0;          ///< times without even the noise: their events are missing, see NoiseFloor
  std::uint64_t detections = 0;       ///< polarity frames given to the detector
  std::uint64_t unusable_poses = 0;   ///< of the detector: no rigid motion, or not in front of the camera
  std::uint64_t registered = 0;       ///< markers that were confirmed: from then on there are poses
  std::uint64_t replayed = 0;         ///< events replayed into the trackers of newly detected markers
  std::uint64_t replays_cut = 0;      ///< replays that lacked events, as there were more than `history_events`
  std::uint64_t lost = 0;             ///< how often a registered marker was lost
};

}  // namespace evmarker
