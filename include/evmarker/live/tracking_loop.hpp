#pragma once
// What the tracking thread does: it tracks the queued events, and calls the callbacks.
#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "evmarker/live/detection_thread.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/latency_histogram.hpp"
#include "evmarker/live/pipeline_settings.hpp"
#include "evmarker/live/published_state.hpp"
#include "evmarker/live/status.hpp"
#include "evmarker/live/tick_clock.hpp"
#include "evmarker/tracking/tracker_core.hpp"

namespace evmarker::live {

/// What the tracking thread shares with the threads that push, ask for the status or stop it.
template <PoseUpdateRule Rule>
struct SharedWithTracking {
  /// @throws std::invalid_argument like EventIntake
  SharedWithTracking(std::size_t queue_events, OverloadPolicy overload, std::chrono::microseconds gap)
      : intake(queue_events, overload, gap) {}

  EventIntake intake;
  PublishedState<Rule> published{};
  LatencyHistogram push_to_pose, queue_wait, detection;
  std::atomic<bool> stopping{false}, detection_on{true};
};

/// Tracks the events of a queue from one start of a pipeline to its stop, and calls the callbacks: poses, ticks and
/// triggers in the order of the stream of events. Belongs to the tracking thread alone.
template <MarkerDetector Detector, PoseUpdateRule Rule, EventFilter Filter>
class TrackingLoop {
 public:
  using PoseCallback = std::function<void(const PoseEstimate&)>;

  /// `settings`, `detector`, `on_pose` and `shared` must outlive the loop.
  /// @throws std::system_error if the detector's thread cannot be started
  TrackingLoop(const PipelineSettings<Rule>& settings, TrackerCore<Rule, Filter> core, const TickClock& clock,
               Detector& detector, const PoseCallback& on_pose, SharedWithTracking<Rule>& shared)
      : settings_(settings),
        on_pose_(on_pose),
        shared_(shared),
        core_(std::move(core)),
        clock_(clock),
        detection_thread_(detector, core_.polarity_frame().sensor_size(), settings.tracker.history_events) {
    tick_poses_.reserve(settings.tracker.max_markers);
  }

  /// Tracks until `SharedWithTracking::stopping` is set. What a callback, the detector or the use of its result throws
  /// is counted, and tracking goes on; any other exception ends it and is published.
  void run() noexcept {
    try {
      while (!shared_.stopping) track_next_block();
      shared_.published.publish_last(core_, progress_);
    } catch (...) {
      shared_.intake.close();
      shared_.intake.clear();
      shared_.published.fail(core_, progress_);
    }
  }

 private:
  // Longest wait for events before the loop looks for a stop, results of detections and triggers.
  static constexpr std::chrono::milliseconds kMaxWait{5};

  // Tracks the next block of events; if none comes, does what is due meanwhile.
  void track_next_block() {
    EventBlock* const block = shared_.intake.pop(max_wait());
    if (!settings_.wait_for_detector) receive_detection(std::chrono::microseconds(0), deliver_untimed());
    if (block != nullptr) {
      const BlockGuard guard(*this, block);
      deliver_triggers(block->number());
      // Were events before this block dropped by `push`, or removed from the queue unread? The latter leaves a gap in
      // the numbers of the blocks.
      if (block->follows_dropped() || block->number() != progress_.block + 1)
        core_.skip_to(block->first_t(), deliver_untimed());
      track(*block);
      progress_.block = block->number();
      // Before the block is free: refilled by a push, its events would count twice in `queue_depth`.
      shared_.published.publish(core_, progress_);
    } else {
      catch_up();
      deliver_triggers(progress_.block + 1);
      if (ticks_by_wall_clock()) deliver_ticks(clock_.now(Clock::now()), kPushedUntilUnknown);
      shared_.published.publish(core_, progress_);
    }
  }

  // Releases a block when the loop is done with it, and counts those of its events as dropped that were not tracked.
  struct BlockGuard {
    TrackingLoop& loop;
    EventBlock* block;
    std::uint64_t tracked_before;
    BlockGuard(TrackingLoop& l, EventBlock* b) : loop(l), block(b), tracked_before(l.core_.statistics().events) {}
    BlockGuard(const BlockGuard&) = delete;
    BlockGuard& operator=(const BlockGuard&) = delete;
    ~BlockGuard() {
      EventIntake& intake = loop.shared_.intake;
      intake.count_dropped(block->size() - (loop.core_.statistics().events - tracked_before));
      intake.release(block);
    }
  };

  // How long to wait for events before something else is due.
  std::chrono::microseconds max_wait() const {
    if (core_.behind() && !settings_.wait_for_detector) return std::chrono::microseconds(0);
    return ticks_by_wall_clock() ? clock_.wait(Clock::now(), kMaxWait) : kMaxWait;
  }

  // While no events come, newly detected markers replay those that they have not had yet.
  void catch_up() {
    if (!settings_.wait_for_detector) core_.catch_up(EventBlock::kCapacity, deliver_untimed());
  }

  // Tracks the events of a block, with the ticks, detections and results that are due between them.
  void track(const EventBlock& block) {
    shared_.queue_wait.add(Clock::now() - block.pushed());
    clock_.begin(block);
    for (std::span<const Event> left = block.span(); !left.empty();) {
      if (shared_.stopping.load(std::memory_order_relaxed)) return;
      if (const auto next = core_.next_t(left.front())) deliver_ticks(*next, *next);
      std::optional<Timestamp> due;  // when to start a detection, or to wait for its result
      const auto show_and_stop_if_due = [&](const Event& event) {  // to the detector
        detection_thread_.add(event);
        if (should_detect(event.t) || should_wait_for_result(event.t)) due = event.t;
        return due.has_value();
      };
      const auto deliver_timed = [&](const PoseEstimate& pose) { deliver(pose, block.pushed()); };
      const auto until_tick = settings_.on_tick ? clock_.before_next(left) : left;
      left = left.subspan(core_.push(until_tick, show_and_stop_if_due, deliver_timed));
      if (!due) continue;
      if (should_detect(*due)) detection_thread_.start(core_.request_detection(*due), core_.polarity_frame());
      if (should_wait_for_result(*due))  // its poses are timed: the event that made it due has waited for them
        while (core_.result_pending() && !shared_.stopping) receive_detection(kMaxWait, deliver_timed);
    }
  }

  bool should_detect(Timestamp t) const { return shared_.detection_on && core_.detection_due(t); }
  bool should_wait_for_result(Timestamp t) const { return settings_.wait_for_detector && core_.result_due(t); }

  // Gives the tracker the result of the running detection, if it comes within the timeout.
  template <typename Deliver>
  void receive_detection(std::chrono::microseconds timeout, const Deliver& deliver) {
    const auto* const outcome = core_.result_pending() ? detection_thread_.receive_outcome(timeout) : nullptr;
    if (outcome == nullptr) return;
    shared_.detection.add(outcome->duration);
    try {
      if (outcome->error) std::rethrow_exception(outcome->error);
      core_.register_markers(outcome->result, deliver);
    } catch (...) {
      core_.cancel_detection();
      shared_.published.keep_error(&Status::detector_errors);
    }
  }

  // Delivers poses to which no event that was just pushed has led: they have no latency.
  auto deliver_untimed() {
    return [this](const PoseEstimate& pose) { deliver(pose, std::nullopt); };
  }

  void deliver(const PoseEstimate& pose, std::optional<Clock::time_point> pushed) {
    if (shared_.stopping.load(std::memory_order_relaxed)) return;
    if (pushed) shared_.push_to_pose.add(Clock::now() - *pushed);
    ++progress_.poses;
    call(on_pose_, pose);
  }

  // True if ticks are also due while no events come.
  bool ticks_by_wall_clock() const noexcept { return settings_.on_tick && !settings_.wait_for_detector; }

  // Calls `on_tick` for every tick until `now`. To be called before the next event is tracked, so that a tick's
  // poses depend on earlier events only. For `pushed_until`, see MarkerTracker::pose_at.
  void deliver_ticks(Timestamp now, Timestamp pushed_until) {
    if (!settings_.on_tick) return;
    while (!shared_.stopping) {
      const auto t = clock_.take_due(now);
      if (!t) return;
      tick_poses_.clear();
      for (const auto& marker : core_.markers())
        tick_poses_.push_back(*t > marker.estimate().t ? marker.pose_at(*t, pushed_until) : marker.estimate());
      ++progress_.ticks;
      call(settings_.on_tick, *t, std::span<const PoseEstimate>(tick_poses_));
    }
  }

  // Delivers the trigger events that were pushed before the block of this number.
  void deliver_triggers(std::uint64_t block_number) {
    while (!shared_.stopping) {
      const auto trigger = shared_.intake.pop_trigger(block_number);
      if (!trigger) return;
      ++progress_.triggers;
      call(settings_.on_trigger, *trigger);
    }
  }

  // Calls a callback, if there is one, and keeps what it throws.
  template <typename Callback, typename... Arguments>
  void call(const Callback& callback, const Arguments&... arguments) {
    if (!callback) return;
    try {
      callback(arguments...);
    } catch (...) {
      shared_.published.keep_error(&Status::callback_errors);
    }
  }

  const PipelineSettings<Rule>& settings_;
  const PoseCallback& on_pose_;
  SharedWithTracking<Rule>& shared_;
  TrackerCore<Rule, Filter> core_;
  TickClock clock_;
  Progress progress_;
  std::vector<PoseEstimate> tick_poses_;
  DetectionThread<Detector> detection_thread_;
};

}  // namespace evmarker::live
