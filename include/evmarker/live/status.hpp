#pragma once
// The status of a pipeline: counters, latencies and tracked markers.
#include <cstdint>
#include <string>
#include <vector>

#include "evmarker/live/latency_histogram.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::live {

/// A marker that is being tracked.
struct MarkerStatus {
  MarkerId id = 0;
  TrackingState state = TrackingState::converging;
  Timestamp updated_t = 0;  ///< camera time of the last update [us]
};

/// Counters since the last start. At any time, exactly: events = processed + filtered + off_sensor + hot +
/// time_faults + dropped + queue_depth.
struct Status {
  bool running = false;                ///< neither stopped nor ended by an error
  bool real_time = false;              ///< the tracking thread has real-time priority; if not, see kRealTimeHint
  std::uint64_t events = 0;            ///< pushed
  std::uint64_t processed = 0;         ///< tracked
  std::uint64_t filtered = 0;          ///< not supported by a neighbour: used only for markers that are tracked already
  std::uint64_t off_sensor = 0;        ///< discarded: outside the camera's image
  std::uint64_t hot = 0;               ///< discarded: of pixels that go on firing, see HotPixels
  std::uint64_t time_faults = 0;       ///< discarded: their times contradict those of the events before and after
  std::uint64_t dropped = 0;           ///< by the overload policy, while stopped, or left in the queue by `stop`
  std::uint64_t queue_depth = 0;       ///< pushed, but not yet any of these
  Timestamp backlog_us = 0;            ///< camera time from the last event processed to the last one pushed
  std::uint64_t time_steps_back = 0;   ///< events earlier than the one before, as after a restart of the camera
  std::uint64_t time_gaps = 0;         ///< intervals without events, at least as long as `PipelineSettings::gap`
  std::uint64_t outages = 0;           ///< times in which even the noise has stopped, see NoiseFloor
  std::uint64_t poses = 0;             ///< delivered
  std::uint64_t ticks = 0;             ///< calls of `PipelineSettings::on_tick`
  std::uint64_t triggers = 0;          ///< pushed
  std::uint64_t triggers_dropped = 0;  ///< for lack of room, while stopped, or left in the queue by `stop`
  std::uint64_t detections = 0;        ///< polarity frames given to the detector
  std::uint64_t registered = 0;        ///< markers that were confirmed
  std::uint64_t replayed = 0;          ///< events replayed into the trackers of newly detected markers
  std::uint64_t replays_cut = 0;       ///< replays that lacked events, as there were more than `history_events`
  std::uint64_t lost = 0;              ///< how often a registered marker was lost
  std::uint64_t callback_errors = 0;   ///< exceptions that the callbacks threw
  std::uint64_t detector_errors = 0;   ///< exceptions that the detector or the use of its result threw
  std::string error;                   ///< message of the first exception, or of the one that ended the tracking
  Latency push_to_pose;                ///< from `push` of the event that completed a pose, or of one that waited in the
                                       ///< same block of 256, to its delivery
  Latency queue_wait;                  ///< from the `push` of a block of events to the begin of its tracking
  Latency detection;                   ///< of a detection, from the request on, waiting for a processor included
  std::vector<MarkerStatus> markers;   ///< being tracked
};

}  // namespace evmarker::live
