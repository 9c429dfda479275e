#pragma once
// Tracks markers in a camera's events, on threads of its own.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <ranges>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/live/detection_thread.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/latency_histogram.hpp"
#include "evmarker/live/pipeline_settings.hpp"
#include "evmarker/live/published_state.hpp"
#include "evmarker/live/status.hpp"
#include "evmarker/live/thread_priority.hpp"
#include "evmarker/live/tick_clock.hpp"
#include "evmarker/tracking/tracker_core.hpp"

namespace evmarker::live {

/// Tracks markers in the events that a camera's thread pushes: a `Tracker` on a thread of its own, with its detector on
/// another. All functions may be called from any thread, but `start`, `stop` and `flush` not from a callback. All
/// callbacks are called on the tracking thread, one at a time; while one runs, nothing is tracked. What is still in the
/// queue when the pipeline is stopped or destroyed is dropped: `flush` before.
///
/// What a callback or the detector throws is counted, and tracking goes on. Any other exception, as of the filter or
/// for lack of memory, ends it: `Status::running` is false then, `Status::error` is its message, `flush` and `stop`
/// throw it, and what is pushed is dropped and counted until `start`.
template <MarkerDetector Detector, PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class Pipeline {
 public:
  using Settings = PipelineSettings<Rule>;
  using PoseCallback = std::function<void(const PoseEstimate&)>;

  /// Starts tracking at once.
  /// @param on_pose called with every pose, in the order in which they arise
  /// @throws std::invalid_argument naming the setting that is out of range
  /// @throws std::system_error if a thread cannot be started
  template <CameraModel Camera>
  Pipeline(const Camera& camera, Detector detector, PoseCallback on_pose, const Settings& settings = {})
      : Pipeline(camera, std::move(detector), std::move(on_pose), settings,
                 Filter(camera.sensor_size(), settings.tracker.filter_window)) {}

  /// The same with a filter of one's own.
  template <CameraModel Camera>
  Pipeline(const Camera& camera, Detector detector, PoseCallback on_pose, const Settings& settings, Filter filter)
      : settings_(settings),
        detector_(std::move(detector)),
        on_pose_(std::move(on_pose)),
        initial_core_(camera, settings.tracker, std::move(filter)),
        intake_(settings.queue_events, settings.overload, settings.gap),
        initial_clock_(settings.tick_interval, settings.gap),
        clock_(initial_clock_) {
    ticks_.reserve(settings.tracker.max_markers);
    start();
  }

  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;
  ~Pipeline() { halt(); }

  /// Takes in events, in order of camera time. The events of one call stay together; calls of several threads are not
  /// merged by time. While the pipeline is stopped, all are dropped and counted. With the policy `block`, waits while
  /// the queue is full. In a callback it never waits, as only the tracking thread makes room: events for which there is
  /// no room are dropped and counted. A detector or a filter must not push.
  template <std::ranges::contiguous_range Events>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push(const Events& events) { intake_.push(std::span<const std::ranges::range_value_t<Events>>(events)); }
  template <EventLike E>
  void push(const E* begin, const E* end) {
    intake_.push(std::span<const E>(begin, end));
  }

  /// Takes in a trigger event, between the events pushed before and after it. The queue holds 4096 trigger events. When
  /// it is full, more are dropped and counted; with the policy `block`, `push` waits instead, but not in a callback.
  void push(const TriggerEvent& trigger) { intake_.push(trigger); }

  /// Starts again after `stop` or an error, with all counters at zero and without markers. Does nothing while the
  /// pipeline runs.
  /// @throws std::logic_error when called from a callback
  /// @throws std::system_error if a thread cannot be started; then the pipeline is stopped
  void start() {
    refuse_in_callback("started");
    const std::lock_guard control(control_);
    if (published_.running()) return;
    halt();  // after an error, the tracking thread has ended but is still there
    for (LatencyHistogram* histogram : {&push_to_pose_, &queue_wait_, &detection_time_}) histogram->clear();
    stopping_ = started_ = false;
    progress_ = {};
    clock_ = initial_clock_;
    try {
      core_.emplace(initial_core_);
      detection_thread_.emplace(detector_, initial_core_.polarity_frame().sensor_size(),
                                settings_.tracker.history_events);
      published_.start(intake_);
      thread_ = std::thread([this] { run(); });
    } catch (...) {
      halt();
      throw;
    }
    started_.wait(false);  // then the status says which priority it has
  }

  /// Stops tracking, within 100 ms; if a callback or a detection is still running, when that has returned. Events still
  /// in the queue are dropped and counted; to have them tracked, call `flush` first.
  /// @throws std::logic_error when called from a callback (a pipeline that is destroyed in one ends the program)
  /// @throws the exception that ended the tracking, or else the first one that a callback or the detector threw, if
  /// there was one since the start
  void stop() {
    refuse_in_callback("stopped");
    const std::lock_guard control(control_);
    halt();
    if (const std::exception_ptr error = published_.take_error()) std::rethrow_exception(error);
  }

  /// Waits until all that was pushed before this call has been tracked and delivered, or dropped, or the pipeline is
  /// stopped; not for what other threads push meanwhile.
  /// @throws std::logic_error when called from a callback
  /// @throws the exception that ended the tracking, if one did
  void flush() const {
    refuse_in_callback("flushed");
    for (const PushMark mark = published_.mark(intake_); !published_.has_passed(mark);)
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    published_.rethrow_failure();
  }

  /// Switches the detector on or off; without it, markers that are tracked stay so until they are lost.
  void set_detection(bool on) noexcept { detection_on_ = on; }

  /// Counters, markers and latencies since the last start.
  Status status() const {
    Status status = published_.status(intake_);
    status.push_to_pose = push_to_pose_.summary();
    status.queue_wait = queue_wait_.summary();
    status.detection = detection_time_.summary();
    return status;
  }

  /// Latencies from the `push` of a pose's last event to the pose's delivery.
  const LatencyHistogram& latency() const noexcept { return push_to_pose_; }

  /// Every tracked marker's pose at a camera time, predicted by a rule that estimates the velocity: for a controller,
  /// at its own rate, whether events come or not. The covariance grows with the pose's age, `t - quality.updated_t`. If
  /// the last pose is of a later time than t, it is returned as it is.
  std::vector<PoseEstimate> poses_at(Timestamp t) const { return published_.poses_at(t); }

 private:
  static constexpr std::chrono::milliseconds kPatience{5};  // longest wait before the next check whether to stop

  void refuse_in_callback(const char* what) const {
    if (intake_.on_taking_thread()) throw std::logic_error(std::string("pipeline: ") + what + " from its own callback");
  }

  // Stops the threads, if they run.
  void halt() {
    refuse_in_callback("stopped");
    intake_.close();
    stopping_ = true;
    if (thread_.joinable()) thread_.join();
    detection_thread_.reset();
    core_.reset();
    intake_.clear();
    published_.stop();
  }

  // The tracking thread.
  void run() noexcept {
    intake_.set_taking_thread(std::this_thread::get_id());
    if (settings_.priority == TrackingPriority::automatic && !settings_.wait_for_detector)
      published_.set_real_time(request_real_time_priority());
    shorten_turns_of_this_thread();
    started_ = true;
    started_.notify_one();
    try {
      while (!stopping_) take_turn();
      published_.publish_last(*core_, progress_);
    } catch (...) {
      intake_.close();
      intake_.clear();
      published_.fail(*core_, progress_);
    }
    intake_.set_taking_thread({});
  }

  // Tracks the next block of events, or uses the time until it comes.
  void take_turn() {
    EventBlock* const block = intake_.take(patience());
    if (!settings_.wait_for_detector) receive_detection(std::chrono::microseconds(0), deliver_untimed());
    if (block != nullptr) {
      const ReturnedBlock returned{*this, block, core_->statistics().events};
      deliver_triggers(block->number());
      // Events are missing before this block: refused by `push`, or dropped from the queue, which leaves a gap in the
      // numbers.
      if (block->follows_dropped() || block->number() != progress_.block + 1)
        core_->skip_to(block->first_t(), deliver_untimed());
      track(*block);
      progress_.block = block->number();
      published_.publish(*core_, progress_);  // before the block is given back: queue_depth never exceeds the queue
    } else {
      catch_up();
      deliver_triggers(progress_.block + 1);
      if (ticks_by_wall()) deliver_ticks(clock_.now(Clock::now()), kPushedUntilUnknown);
      published_.publish(*core_, progress_);
    }
  }

  // Gives a block back at the end of its turn, and counts those of its events as dropped that were not tracked.
  struct ReturnedBlock {
    Pipeline& pipeline;
    EventBlock* block;
    std::uint64_t taken_before;
    ReturnedBlock(Pipeline& p, EventBlock* b, std::uint64_t t) : pipeline(p), block(b), taken_before(t) {}
    ReturnedBlock(const ReturnedBlock&) = delete;
    ReturnedBlock& operator=(const ReturnedBlock&) = delete;
    ~ReturnedBlock() {
      pipeline.intake_.count_dropped(block->size() - (pipeline.core_->statistics().events - taken_before));
      pipeline.intake_.give_back(block);
    }
  };

  // How long to wait for events.
  std::chrono::microseconds patience() const {
    if (core_->behind() && !settings_.wait_for_detector) return std::chrono::microseconds(0);
    return ticks_by_wall() ? clock_.wait(Clock::now(), kPatience) : kPatience;
  }

  // While no events come, newly detected markers replay those that they have not had yet.
  void catch_up() {
    if (!settings_.wait_for_detector) core_->catch_up(EventBlock::kCapacity, deliver_untimed());
  }

  // Tracks the events of a block, with the ticks, detections and results that are due between them.
  void track(const EventBlock& block) {
    queue_wait_.add(Clock::now() - block.pushed());
    clock_.begin(block);
    for (std::span<const Event> left = block.span(); !left.empty();) {
      if (stopping_.load(std::memory_order_relaxed)) return;
      if (const auto next = core_->next_t(left.front())) deliver_ticks(*next, *next);
      std::optional<Timestamp> due;  // when to start a detection, or to wait for its result
      const auto feed_detector = [&](const Event& event) {
        detection_thread_->add(event);
        if (should_detect(event.t) || should_wait_for_result(event.t)) due = event.t;
        return due.has_value();
      };
      const auto deliver_timed = [&](const PoseEstimate& pose) { deliver(pose, block.pushed()); };
      left =
          left.subspan(core_->push(settings_.on_tick ? clock_.before_next(left) : left, feed_detector, deliver_timed));
      if (!due) continue;
      if (should_detect(*due)) detection_thread_->start(core_->request_detection(*due), core_->polarity_frame());
      if (should_wait_for_result(*due))
        while (core_->result_pending() && !stopping_) receive_detection(kPatience, deliver_timed);
    }
  }

  bool should_detect(Timestamp t) const { return detection_on_ && core_->detection_due(t); }
  bool should_wait_for_result(Timestamp t) const { return settings_.wait_for_detector && core_->result_due(t); }

  // Hands the result of the detection that is going on to the tracker, if it comes within the timeout.
  template <typename Deliver>
  void receive_detection(std::chrono::microseconds timeout, const Deliver& deliver) {
    const auto* const outcome = core_->result_pending() ? detection_thread_->receive_outcome(timeout) : nullptr;
    if (outcome == nullptr) return;
    detection_time_.add(outcome->duration);
    try {
      if (outcome->error) std::rethrow_exception(outcome->error);
      core_->register_markers(outcome->result, deliver);
    } catch (...) {
      core_->cancel_detection();
      published_.keep_error(&Status::detector_errors);
    }
  }

  // Delivers without a latency: no event that was just pushed has caused these poses.
  auto deliver_untimed() {
    return [this](const PoseEstimate& pose) { deliver(pose, std::nullopt); };
  }

  void deliver(const PoseEstimate& pose, std::optional<Clock::time_point> pushed) {
    if (stopping_.load(std::memory_order_relaxed)) return;
    if (pushed) push_to_pose_.add(Clock::now() - *pushed);
    ++progress_.poses;
    call(on_pose_, pose);
  }

  bool ticks_by_wall() const noexcept { return settings_.on_tick && !settings_.wait_for_detector; }

  // Calls `on_tick` for every tick until `now`. Before the next event is tracked, so that a tick's poses depend on
  // earlier events only. For `pushed_until`, see MarkerTracker::pose_at.
  void deliver_ticks(Timestamp now, Timestamp pushed_until) {
    if (!settings_.on_tick) return;
    while (!stopping_) {
      const auto t = clock_.take_due(now);
      if (!t) return;
      ticks_.clear();
      for (const auto& marker : core_->markers())
        ticks_.push_back(*t > marker.estimate().t ? marker.pose_at(*t, pushed_until) : marker.estimate());
      ++progress_.ticks;
      call(settings_.on_tick, *t, std::span<const PoseEstimate>(ticks_));
    }
  }

  // Delivers the trigger events that were pushed before the block of this number.
  void deliver_triggers(std::uint64_t block_number) {
    while (!stopping_) {
      const auto trigger = intake_.take_trigger(block_number);
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
      published_.keep_error(&Status::callback_errors);
    }
  }

  Settings settings_;
  Detector detector_;
  PoseCallback on_pose_;
  const TrackerCore<Rule, Filter> initial_core_;  // copied at every start
  EventIntake intake_;
  const TickClock initial_clock_;
  LatencyHistogram push_to_pose_, queue_wait_, detection_time_;
  std::atomic<bool> started_{false}, stopping_{false}, detection_on_{true};

  std::mutex control_;  // held by `start` and `stop`, guards thread_
  std::thread thread_;
  PublishedState<Rule> published_;

  // Used by the tracking thread alone while it runs:
  std::optional<TrackerCore<Rule, Filter>> core_;
  std::optional<DetectionThread<Detector>> detection_thread_;
  Progress progress_;
  TickClock clock_;
  std::vector<PoseEstimate> ticks_;  // poses of one tick
};

}  // namespace evmarker::live
