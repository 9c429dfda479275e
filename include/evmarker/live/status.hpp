#pragma once
// How a pipeline is doing.
#include <cstdint>
#include <string>
#include <vector>

#include "evmarker/live/latency_histogram.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::live {

struct MarkerStatus {
  MarkerId id = 0;
  TrackingState state = TrackingState::converging;
  Timestamp updated_t = 0;  ///< camera time of the last update [us]
};

/// Counters since the last start. At any time, to the event: events = processed + filtered + off_sensor + time_faults +
/// dropped + queue_depth.
struct Status {
  bool running = false;
  std::uint64_t events = 0;            ///< pushed
  std::uint64_t processed = 0;         ///< tracked
  std::uint64_t filtered = 0;          ///< no support in space and time: for markers that are tracked already only
  std::uint64_t off_sensor = 0;        ///< discarded: outside the camera's image
  std::uint64_t time_faults = 0;       ///< discarded: a time that the events before and after it contradict
  std::uint64_t dropped = 0;           ///< by the overload policy, while stopped, or left in the queue by `stop`
  std::uint64_t queue_depth = 0;       ///< pushed, but not yet any of these
  Timestamp backlog_us = 0;            ///< camera time from the last event processed to the last one pushed
  std::uint64_t time_steps_back = 0;   ///< events earlier than the one before, as after a restart of the camera
  std::uint64_t time_gaps = 0;         ///< times without events for as long as `PipelineSettings::gap`
  std::uint64_t poses = 0;             ///< delivered
  std::uint64_t ticks = 0;             ///< calls of `PipelineSettings::on_tick`
  std::uint64_t triggers = 0;          ///< pushed
  std::uint64_t triggers_dropped = 0;  ///< for lack of room, while stopped, or left by `stop`
  std::uint64_t detections = 0;        ///< polarity frames given to the detector
  std::uint64_t registered = 0;        ///< markers that were confirmed
  std::uint64_t replayed = 0;          ///< events since a detection, replayed into its markers
  std::uint64_t replays_cut = 0;       ///< of these replays, how many lacked events: there were too many to be kept
  std::uint64_t lost = 0;              ///< of the registered
  std::uint64_t callback_errors = 0;   ///< exceptions that the callbacks threw
  std::uint64_t detector_errors = 0;   ///< exceptions that the detector threw, or its result led to
  std::string error;                   ///< the first of these
  Latency push_to_pose;                ///< from `push` of the event that completed a pose to its delivery
  Latency queue_wait;                  ///< from `push` to tracking, of blocks of events
  Latency detection;                   ///< of one detection, waiting for a processor included
  std::vector<MarkerStatus> markers;   ///< being tracked
};

}  // namespace evmarker::live
