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

#include "evmarker/live/latency_histogram.hpp"
#include "evmarker/live/pipeline_settings.hpp"
#include "evmarker/live/published_state.hpp"
#include "evmarker/live/status.hpp"
#include "evmarker/live/thread_priority.hpp"
#include "evmarker/live/tick_clock.hpp"
#include "evmarker/live/tracking_loop.hpp"
#include "evmarker/tracking/tracker_core.hpp"

namespace evmarker::live {

/// Tracks markers in the events that a camera's thread pushes: a `Tracker` on a thread of its own, with its detector on
/// another. All functions may be called from any thread, but `start`, `stop` and `flush` neither from a callback nor
/// from the detector or the filter. All callbacks are called on the tracking thread, one at a time; while one runs,
/// nothing is tracked. What is still in the queue when the pipeline is stopped or destroyed is dropped; call `flush`
/// first to have it tracked.
///
/// What a callback or the detector throws is counted, and tracking goes on. Any other exception, such as one of the
/// filter, ends it: `Status::running` is false then, `Status::error` is its message, `flush` and `stop`
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

  /// As above, with a noise filter of your own.
  template <CameraModel Camera>
  Pipeline(const Camera& camera, Detector detector, PoseCallback on_pose, const Settings& settings, Filter filter)
      : settings_(settings),
        detector_(std::move(detector)),
        on_pose_(std::move(on_pose)),
        // A core is made for every start: a copy of one that is kept would have no memory in reserve.
        make_core_([camera, settings = settings.tracker, filter = std::move(filter)] {
          return TrackerCore<Rule, Filter>(camera, settings, filter);
        }),
        initial_clock_(settings.tick_interval, settings.gap),
        shared_(settings.queue_events, settings.overload, settings.gap) {
    start();
  }

  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;
  ~Pipeline() { halt(); }  // where `halt` throws, in a callback or the detector, the program ends

  /// Queues events, which come in order of camera time. The events of one call stay together; calls of several threads
  /// are not merged by time. While the pipeline is stopped, all are dropped and counted. With the policy `block`, waits
  /// while the queue is full. In a callback it never waits, as only the tracking thread makes room: events for which
  /// there is no room are dropped and counted. Neither the detector, for which tracking may be waiting, nor the filter
  /// may push.
  template <std::ranges::input_range Events>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push(Events&& events) { shared_.intake.push(events); }
  template <EventLike E>
  void push(const E* begin, const E* end) {
    push(std::span(begin, end));
  }
  template <EventLike E>
  void push(const E& event) {
    push(std::span(&event, 1));
  }

  /// Queues a trigger event for PipelineSettings::on_trigger, between the events pushed before and after it. The queue
  /// holds 4096 trigger events. When it is full, more are dropped and counted; with the policy `block`, `push` waits
  /// instead, but not in a callback.
  void push(const TriggerEvent& trigger) { shared_.intake.push(trigger); }

  /// Starts again after `stop` or an error, with all counters at zero and without markers. Does nothing while the
  /// pipeline runs.
  /// @throws std::logic_error when called from a callback, the filter or the detector
  /// @throws std::system_error if a thread cannot be started; then the pipeline is stopped
  void start() {
    refuse_in_callback("started");
    const std::lock_guard control(control_);
    if (shared_.published.running()) return;
    halt();  // after an error, the tracking thread has ended but still has to be joined
    for (LatencyHistogram* histogram : {&shared_.push_to_pose, &shared_.queue_wait, &shared_.detection})
      histogram->clear();
    shared_.stopping = started_ = false;
    try {
      loop_.emplace(settings_, make_core_(), initial_clock_, detector_, on_pose_, shared_);
      shared_.published.start(shared_.intake);
      thread_ = std::thread([this] { run(); });
    } catch (...) {
      halt();
      throw;
    }
    started_.wait(false);  // until the thread has set its priority, which `status` reports
  }

  /// Stops tracking, within 100 ms; if a callback or a detection is still running, when that has returned. Events still
  /// in the queue are dropped and counted; to have them tracked, call `flush` first.
  /// @throws std::logic_error when called from a callback, the filter or the detector (a pipeline that is destroyed in
  /// one ends the program)
  /// @throws the exception that ended the tracking, else the first one since the start that a callback or the detector
  /// threw; each only once
  void stop() {
    refuse_in_callback("stopped");
    const std::lock_guard control(control_);
    halt();
    if (const std::exception_ptr error = shared_.published.take_error()) std::rethrow_exception(error);
  }

  /// Waits until all that was pushed before this call has been tracked and delivered, or dropped, or the pipeline is
  /// stopped; not for what other threads push meanwhile, nor for a detection that is running.
  /// @throws std::logic_error when called from a callback, the filter or the detector
  /// @throws the exception that ended the tracking, if one did
  void flush() const {
    refuse_in_callback("flushed");
    for (const PushMark mark = shared_.published.mark(shared_.intake); !shared_.published.has_passed(mark);)
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    shared_.published.rethrow_failure();
  }

  /// Switches the detector on or off; without it, markers that are tracked stay so until they are lost.
  void set_detection(bool on) noexcept { shared_.detection_on = on; }

  /// Counters, markers and latencies since the last start.
  Status status() const {
    Status status = shared_.published.status(shared_.intake);
    status.push_to_pose = shared_.push_to_pose.summary();
    status.queue_wait = shared_.queue_wait.summary();
    status.detection = shared_.detection.summary();
    return status;
  }

  /// Latencies from the `push` of the event that led to a pose, or of an earlier one in its block of 256, to the pose's
  /// delivery.
  const LatencyHistogram& latency() const noexcept { return shared_.push_to_pose; }

  /// Every tracked marker's pose at a camera time, predicted if the rule estimates the velocity, else the last one: for
  /// a controller, at its own rate, whether events come or not. The covariance grows with the pose's age, `t -
  /// quality.updated_t`. If the last pose is of a later time than t, it is returned as it is.
  std::vector<PoseEstimate> poses_at(Timestamp t) const { return shared_.published.poses_at(t); }

 private:
  void refuse_in_callback(const char* what) const {
    if (shared_.intake.on_consumer_thread())
      throw std::logic_error(std::string("pipeline: ") + what + " from its own callback or filter");
    if (DetectionThread<Detector>::detector_of_this_thread() == &detector_)
      throw std::logic_error(std::string("pipeline: ") + what + " from its own detector");
  }

  // Stops the threads, if they run.
  void halt() {
    refuse_in_callback("stopped");
    shared_.stopping = true;
    shared_.intake.close();
    if (thread_.joinable()) thread_.join();
    loop_.reset();
    shared_.intake.clear();
    shared_.published.stop();
  }

  // The tracking thread.
  void run() noexcept {
    shared_.intake.set_consumer_thread(std::this_thread::get_id());
    // Not where it waits for the detector, as with files: nothing there is urgent.
    if (settings_.priority == TrackingPriority::automatic && !settings_.wait_for_detector)
      shared_.published.set_real_time(request_real_time_priority());
    request_short_time_slices();
    started_ = true;
    started_.notify_one();
    loop_->run();
    shared_.intake.set_consumer_thread({});
  }

  Settings settings_;
  Detector detector_;
  PoseCallback on_pose_;
  std::function<TrackerCore<Rule, Filter>()> make_core_;  // for every start
  const TickClock initial_clock_;                         // copied at every start
  SharedWithTracking<Rule> shared_;
  std::atomic<bool> started_{false};

  std::mutex control_;  // held by `start` and `stop`, guards thread_ and loop_
  std::thread thread_;
  std::optional<TrackingLoop<Detector, Rule, Filter>> loop_;  // run by thread_
};

}  // namespace evmarker::live
