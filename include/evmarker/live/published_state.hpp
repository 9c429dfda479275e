#pragma once
// The state of the tracking thread, published for other threads.
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

/// How many poses, ticks and trigger events the tracking thread has delivered to callbacks.
struct Delivered {
  std::uint64_t poses = 0, ticks = 0, triggers = 0;
};

/// The state of the tracking thread when it was last published. All functions may be called from any thread.
template <PoseUpdateRule Rule>
class PublishedState {
 public:
  /// Resets everything for a start, and opens the intake, which resets its counters.
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

  /// Marks the pipeline as stopped, without markers; counters and errors stay.
  void stop() {
    const std::lock_guard lock(mutex_);
    status_.running = false;
    markers_.clear();
  }

  /// Publishes the present state of the tracker.
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

  /// Counts the exception that is being handled, and keeps the first one.
  /// @param counter the member of Status that counts exceptions of its kind
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

  /// Returns the exception that was kept, and forgets it; null if there is none.
  std::exception_ptr take_error() {
    const std::lock_guard lock(mutex_);
    return std::exchange(first_error_, nullptr);
  }

  /// All counters and markers, without the latencies.
  Status status(const EventIntake& intake) const {
    const std::lock_guard lock(mutex_);
    Status status = counters(intake);
    for (const auto& [estimate, rule] : markers_)
      status.markers.push_back({estimate.id, estimate.quality.state, estimate.quality.updated_t});
    return status;
  }

  /// True while the pipeline runs and has events that were neither tracked nor dropped, or triggers that were neither
  /// delivered nor dropped.
  bool busy(const EventIntake& intake) const {
    const std::lock_guard lock(mutex_);
    const std::uint64_t dropped = intake.dropped(), triggers_dropped = intake.triggers_dropped();
    return status_.running &&
           (intake.pushed() > taken_ + dropped || intake.triggers_pushed() > triggers_taken_ + triggers_dropped);
  }

  /// See Pipeline::poses_at.
  std::vector<PoseEstimate> poses_at(Timestamp t) const {
    std::vector<Tracked> markers;
    {
      const std::lock_guard lock(mutex_);
      markers = markers_;
    }
    std::vector<PoseEstimate> poses;
    for (const auto& [pose, rule] : markers) poses.push_back(t > pose.t ? extrapolated(pose, rule, t) : pose);
    return poses;
  }

 private:
  struct Tracked {
    PoseEstimate estimate;
    Rule rule;  // predicts the pose
  };

  // The counters as one consistent set. An event moves on from counter to counter while they are read. They are read in
  // the opposite order, the number of pushed events last, so that no difference is negative.
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
  Status status_;            // counters of the tracking thread
  std::uint64_t taken_ = 0;  // events that the tracker has taken
  Timestamp last_t_ = 0;     // of the last one [us]
  std::uint64_t triggers_taken_ = 0;
  std::exception_ptr first_error_;
  std::vector<Tracked> markers_;
};

}  // namespace evmarker::live
