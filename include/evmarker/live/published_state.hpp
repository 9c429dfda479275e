#pragma once
// The state of the tracking thread for other threads.
#include <cstdint>
#include <exception>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/status.hpp"
#include "evmarker/tracking/tracker_core.hpp"

namespace evmarker::live {

/// What the tracking thread has handed to callbacks.
struct Delivered {
  std::uint64_t poses = 0, ticks = 0, triggers = 0;
};

/// The last published state. Any thread may read it.
template <PoseUpdateRule Rule>
class PublishedState {
 public:
  /// Begins anew, together with the counters of the intake.
  void start(EventIntake& intake) {
    const std::lock_guard lock(mutex_);
    intake.open();
    status_ = {};
    status_.running = true;
    taken_ = triggers_taken_ = 0;
    last_t_ = 0;
    first_error_ = nullptr;
    markers_.clear();
  }

  void stop() {
    const std::lock_guard lock(mutex_);
    status_.running = false;
    markers_.clear();
  }

  template <EventFilter Filter>
  void publish(const TrackerCore<Rule, Filter>& core, const Delivered& delivered) {
    const TrackerStatistics& tracker = core.statistics();
    const std::lock_guard lock(mutex_);
    triggers_taken_ = delivered.triggers;
    status_.ticks = delivered.ticks;
    if (taken_ == tracker.events && status_.poses == delivered.poses && status_.registered == tracker.registered &&
        status_.replayed == tracker.replayed)
      return;
    taken_ = tracker.events;
    last_t_ = core.last_t();
    status_.filtered = tracker.filtered;
    status_.time_faults = tracker.time_faults;
    status_.off_sensor = tracker.off_sensor;
    status_.poses = delivered.poses;
    status_.detections = tracker.detections;
    status_.registered = tracker.registered;
    status_.replayed = tracker.replayed;
    status_.replays_cut = tracker.replays_cut;
    status_.lost = tracker.lost;
    markers_.clear();
    for (const auto& marker : core.markers()) markers_.push_back({marker.estimate(), marker.follower().rule()});
  }

  /// The exception that is being handled.
  /// @param counter of its kind
  void keep_error(std::uint64_t Status::*counter) {
    const std::lock_guard lock(mutex_);
    ++(status_.*counter);
    if (!status_.error.empty()) return;
    first_error_ = std::current_exception();
    status_.error = "unknown exception";
    try {
      throw;
    } catch (const std::exception& error) {
      if (*error.what() != '\0') status_.error = error.what();
    } catch (...) {
    }
  }

  /// The first exception that was kept; only once.
  std::exception_ptr take_error() {
    const std::lock_guard lock(mutex_);
    return std::exchange(first_error_, nullptr);
  }

  /// All counters and markers, no latencies.
  Status status(const EventIntake& intake) const {
    const std::lock_guard lock(mutex_);
    Status status = counters(intake);
    for (const auto& [estimate, rule] : markers_)
      status.markers.push_back({estimate.id, estimate.quality.state, estimate.quality.updated_t});
    return status;
  }

  /// True while the pipeline runs and has events or triggers that are neither taken nor dropped.
  bool busy(const EventIntake& intake) const {
    const std::lock_guard lock(mutex_);
    const std::uint64_t dropped = intake.dropped(), triggers_dropped = intake.triggers_dropped();
    return status_.running &&
           (intake.pushed() > taken_ + dropped || intake.triggers_pushed() > triggers_taken_ + triggers_dropped);
  }

  std::vector<PoseEstimate> poses_at(Timestamp now) const {
    std::vector<Tracked> markers;
    {
      const std::lock_guard lock(mutex_);
      markers = markers_;
    }
    std::vector<PoseEstimate> poses;
    for (const auto& [pose, rule] : markers) poses.push_back(now > pose.t ? extrapolated(pose, rule, now) : pose);
    return poses;
  }

 private:
  struct Tracked {
    PoseEstimate estimate;
    Rule rule;
  };

  // Read in the order in which an event goes from one counter to the next, backwards: so no difference is negative.
  Status counters(const EventIntake& intake) const {
    Status status = status_;
    status.dropped = intake.dropped();
    status.time_steps_back = intake.time_steps_back();
    status.time_gaps = intake.time_gaps();
    status.triggers_dropped = intake.triggers_dropped();
    status.triggers = intake.triggers_pushed();
    status.events = intake.pushed();
    status.processed = taken_ - status.filtered - status.time_faults - status.off_sensor;
    status.queue_depth = status.events - taken_ - status.dropped;
    const Timestamp pushed_t = intake.last_t();
    if (status.queue_depth > 0 && taken_ > 0 && pushed_t > last_t_) status.backlog_us = pushed_t - last_t_;
    return status;
  }

  mutable std::mutex mutex_;
  Status status_;            // what the tracking thread counts
  std::uint64_t taken_ = 0;  // events that the tracker was given
  Timestamp last_t_ = 0;     // of these
  std::uint64_t triggers_taken_ = 0;
  std::exception_ptr first_error_;
  std::vector<Tracked> markers_;
};

}  // namespace evmarker::live
