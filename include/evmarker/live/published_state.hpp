#pragma once
// The state of the tracking thread, published for other threads.
#include <algorithm>
#include <cstdint>
#include <exception>
#include <limits>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/status.hpp"
#include "evmarker/tracking/tracker_core.hpp"

namespace evmarker::live {

/// How far the tracking thread has come: what it has delivered to callbacks, and the number of the last block that it
/// has tracked.
struct Progress {
  std::uint64_t poses = 0, ticks = 0, triggers = 0, block = 0;
};

/// A moment in a run of the pipeline, by what had been put into its queue.
struct PushMark {
  std::uint64_t run = 0, block = 0, triggers = 0;
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
    ++run_;
    taken_ = 0;
    progress_ = {};
    last_t_ = 0;
    failed_ = false;
    first_error_ = nullptr;
    markers_.clear();
  }

  /// Marks the pipeline as stopped, without markers; counters and errors stay.
  void stop() {
    const std::lock_guard lock(mutex_);
    status_.running = false;
    markers_.clear();
  }

  bool running() const {
    const std::lock_guard lock(mutex_);
    return status_.running;
  }

  void set_real_time(bool real_time) {
    const std::lock_guard lock(mutex_);
    status_.real_time = real_time;
  }

  /// Publishes the present state of the tracker, or leaves it to the next time if another thread goes on reading: the
  /// tracking thread does not wait for one that has to wait for a processor.
  template <EventFilter Filter>
  void publish(const TrackerCore<Rule, Filter>& core, const Progress& progress) {
    constexpr int kTries = 1000;  // longer than a reader takes
    std::unique_lock lock(mutex_, std::try_to_lock);
    for (int i = 0; i < kTries && !lock; ++i) lock.try_lock();
    if (!lock || !set_counters(core, progress)) return;
    markers_.clear();
    for (const auto& marker : core.markers()) markers_.push_back({marker.estimate(), marker.follower().rule()});
  }

  /// Publishes the last counters of the tracker before it stops, however many threads are reading.
  template <EventFilter Filter>
  void publish_last(const TrackerCore<Rule, Filter>& core, const Progress& progress) {
    const std::lock_guard lock(mutex_);
    set_counters(core, progress);
  }

  /// Publishes the last state of the tracker, and that the exception that is being handled has ended the tracking.
  template <EventFilter Filter>
  void fail(const TrackerCore<Rule, Filter>& core, const Progress& progress) {
    const std::lock_guard lock(mutex_);
    set_counters(core, progress);
    status_.running = false;
    markers_.clear();
    failed_ = true;
    set_error();
  }

  /// Counts the exception that is being handled, and keeps the first one.
  /// @param counter the member of Status that counts exceptions of its kind
  void keep_error(std::uint64_t Status::*counter) {
    const std::lock_guard lock(mutex_);
    ++(status_.*counter);
    if (status_.error.empty()) set_error();
  }

  /// Throws the exception that ended the tracking, if one did.
  void rethrow_failure() const {
    const std::lock_guard lock(mutex_);
    if (failed_ && first_error_) std::rethrow_exception(first_error_);
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

  /// What has been pushed until now.
  PushMark mark(const EventIntake& intake) const {
    const std::lock_guard lock(mutex_);
    return {run_, intake.last_block_number(), intake.triggers_taken_in()};
  }

  /// True if everything that was pushed before the mark has been tracked and delivered, or dropped.
  bool has_passed(const PushMark& mark) const {
    const std::lock_guard lock(mutex_);
    return !status_.running || run_ != mark.run ||
           (progress_.block >= mark.block && progress_.triggers >= mark.triggers);
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

  // Returns false if the markers are those of the last time.
  template <EventFilter Filter>
  bool set_counters(const TrackerCore<Rule, Filter>& core, const Progress& progress) {
    const TrackerStatistics& tracker = core.statistics();
    const bool same = taken_ == tracker.events && progress_.poses == progress.poses &&
                      status_.registered == tracker.registered && status_.replayed == tracker.replayed;
    progress_ = progress;
    if (same) return false;
    taken_ = tracker.events;
    last_t_ = core.last_t();
    status_.filtered = tracker.filtered;
    status_.time_faults = tracker.time_faults;
    status_.off_sensor = tracker.off_sensor;
    status_.hot = tracker.hot;
    status_.outages = tracker.outages;
    status_.detections = tracker.detections;
    status_.registered = tracker.registered;
    status_.replayed = tracker.replayed;
    status_.replays_cut = tracker.replays_cut;
    status_.lost = tracker.lost;
    return true;
  }

  // Keeps the exception that is being handled, and its message.
  void set_error() noexcept {
    first_error_ = std::current_exception();
    const auto set_message = [this](const char* message) noexcept {
      try {
        status_.error = *message != '\0' ? message : "unknown exception";
      } catch (...) {  // there is no memory: the exception itself is kept
      }
    };
    try {
      throw;
    } catch (const std::exception& error) {
      set_message(error.what());
    } catch (...) {
      set_message("");
    }
  }

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
    status.processed = taken_ - status.filtered - status.time_faults - status.off_sensor - status.hot;
    status.poses = progress_.poses;
    status.ticks = progress_.ticks;
    status.queue_depth = status.events - taken_ - status.dropped;
    constexpr std::uint64_t kMost = std::numeric_limits<Timestamp>::max();  // wrong times may be further apart
    const Timestamp pushed_t = intake.last_t();
    if (status.queue_depth > 0 && taken_ > 0 && pushed_t > last_t_)
      status.backlog_us = static_cast<Timestamp>(std::min(elapsed_us(last_t_, pushed_t), kMost));
    return status;
  }

  mutable std::mutex mutex_;
  Status status_;            // counters of the tracking thread
  std::uint64_t run_ = 0;    // number of the start
  std::uint64_t taken_ = 0;  // events that the tracker has taken
  Progress progress_;
  Timestamp last_t_ = 0;            // of the last event taken [us]
  bool failed_ = false;             // an exception ended the tracking
  std::exception_ptr first_error_;  // or the one that ended the tracking
  std::vector<Tracked> markers_;
};

}  // namespace evmarker::live
