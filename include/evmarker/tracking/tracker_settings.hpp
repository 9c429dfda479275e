#pragma once
// Settings and statistics of a tracker of many markers.
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "evmarker/base/require.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/tracking/marker_tracker_settings.hpp"

namespace evmarker {

template <PoseUpdateRule Rule = KalmanUpdate>
struct TrackerSettings {
  /// Of the spatiotemporal filter: by the sensor's noise, or fixed, as the paper's 2000 us.
  std::chrono::microseconds filter_window = kAutomaticWindow;
  std::chrono::microseconds detection_interval{25000};  ///< camera time from one detection to the next
  /// The same while something is searched for: until there is a marker, all are confirmed, and for 0.1 s after one was
  /// found or lost.
  std::chrono::microseconds search_interval{5000};
  /// Camera time from a detection to the registration of its markers, as if the detector took so long; the events in
  /// between are replayed into the new trackers.
  std::chrono::microseconds detection_latency{0};
  int min_events_per_detection = 200;  ///< no new detection before this many events have passed the filter
  int detections_to_confirm = 2;  ///< frames that must show a marker's code where it is tracked before it is announced
  std::size_t max_markers = 64;   ///< tracked at the same time
  std::size_t history_events = 1u << 18;  ///< kept to be replayed
  MarkerTrackerSettings<Rule> marker{};   ///< of every marker's tracker
};

/// @throws std::invalid_argument naming the setting that is out of range
template <PoseUpdateRule Rule>
void validate(const TrackerSettings<Rule>& settings) {
  const Require require("tracker");
  require(settings.detection_interval.count() > 0, "detection_interval [us]", settings.detection_interval.count());
  require(settings.search_interval.count() > 0, "search_interval [us]", settings.search_interval.count());
  require(settings.detection_latency.count() >= 0, "detection_latency [us]", settings.detection_latency.count());
  require(settings.detections_to_confirm > 0, "detections_to_confirm", settings.detections_to_confirm);
  require(settings.max_markers > 0, "max_markers", settings.max_markers);
  validate(settings.marker);  // here, and not when the first marker is found
}

/// What happened to the events so far.
struct TrackerStatistics {
  std::uint64_t events = 0;           ///< pushed
  std::uint64_t off_sensor = 0;       ///< discarded: outside the camera's image
  std::uint64_t filtered = 0;         ///< no support in space and time: for markers that are tracked already only
  std::uint64_t time_faults = 0;      ///< discarded: a time that the events before and after it contradict
  std::uint64_t matched = 0;          ///< taken into pose updates, all markers together
  std::uint64_t time_steps_back = 0;  ///< events earlier than the one before; taken as they are
  std::uint64_t detections = 0;       ///< polarity frames given to the detector
  std::uint64_t registered = 0;       ///< markers that were confirmed: from then on there are poses
  std::uint64_t replayed = 0;         ///< events replayed into markers that began to be tracked
  std::uint64_t replays_cut = 0;      ///< of these replays, how many lacked events: more than `history_events` since
  std::uint64_t lost = 0;             ///< of the registered
};

}  // namespace evmarker
