#pragma once
// Runs a marker detector on threads of its own.
#include <readerwriterqueue/readerwritercircularbuffer.h>

#include <chrono>
#include <cstddef>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/thread_priority.hpp"

namespace evmarker::live {

/// Detects markers in polarity frames while tracking goes on. A request costs the tracking thread next to nothing: the
/// detector has a frame of its own, which is brought up to date with the events since the last request. There is one
/// detection at a time; one that may wait runs on a thread that only uses free processors. All functions are for the
/// tracking thread.
template <MarkerDetector Detector>
class DetectionThread {
 public:
  struct Outcome {
    DetectionResult result;
    std::exception_ptr error;    ///< what the detector threw; then `result` is void
    Clock::duration duration{};  ///< from the request to the end of the detection
  };

  /// @param detector must outlive this object; meanwhile it is used by its threads alone
  /// @param max_events kept between two requests; if there are more, the request copies the whole frame
  /// @param when_idle whether requests that may wait are left to a thread with `run_this_thread_when_idle`
  DetectionThread(Detector& detector, SensorSize size, std::size_t max_events, bool when_idle)
      : detector_(detector),
        max_events_(max_events),
        frame_(size),
        job_{{}, {}, PolarityFrame(size), false, Clock::now(), {}},
        use_idle_worker_(when_idle) {
    new_events_.reserve(max_events);
    job_.events.reserve(max_events);
    prompt_worker_.thread = std::thread([this] {
      lower_priority_of_this_thread();
      work(prompt_worker_);
    });
    if (when_idle)
      idle_worker_.thread = std::thread([this] {
        run_this_thread_when_idle();
        work(idle_worker_);
      });
  }

  DetectionThread(const DetectionThread&) = delete;
  DetectionThread& operator=(const DetectionThread&) = delete;

  /// Waits for the end of a detection that is going on.
  ~DetectionThread() {
    for (Worker* worker : {&prompt_worker_, &idle_worker_}) {
      if (!worker->thread.joinable()) continue;
      worker->jobs.wait_enqueue(nullptr);
      worker->thread.join();
    }
  }

  /// Adds an event to the frame of the next request.
  void add(const Event& event) {
    if (new_events_.size() < max_events_)
      new_events_.push_back(event);
    else
      overflowed_ = true;
  }

  /// Starts a detection. The outcome of the one before must have been received.
  /// @param frame that of all events added
  /// @param may_wait whether the detection may wait for a free processor
  void start(DetectionRequest request, const PolarityFrame& frame, bool may_wait) {
    job_.request = std::move(request);
    std::swap(job_.events, new_events_);
    new_events_.clear();
    job_.frame_is_copied = std::exchange(overflowed_, false);
    if (job_.frame_is_copied) job_.frame = frame;
    job_.requested = Clock::now();
    (may_wait && use_idle_worker_ ? idle_worker_ : prompt_worker_).jobs.wait_enqueue(&job_);
  }

  /// Receives the outcome of the last request, valid until the next one; null if it does not come within the timeout.
  const Outcome* receive_outcome(std::chrono::microseconds timeout) {
    Job* job = nullptr;
    const bool done = timeout.count() > 0 ? done_.wait_dequeue_timed(job, timeout) : done_.try_dequeue(job);
    if (!done) return nullptr;
    // So slow: other programs keep all processors busy. From now on the detector does not wait for a free one.
    if (job->outcome.duration > kStarved) use_idle_worker_ = false;
    return &job->outcome;
  }

 private:
  struct Job {
    DetectionRequest request;
    std::vector<Event> events;
    PolarityFrame frame;
    bool frame_is_copied;  // `frame` is to be used: there were more events than `events` holds
    Clock::time_point requested;
    Outcome outcome;
  };

  struct Worker {
    moodycamel::BlockingReaderWriterCircularBuffer<Job*> jobs{2};
    std::thread thread;
  };

  static constexpr std::chrono::milliseconds kStarved{200};

  // The detector's threads: does the jobs of a worker until one is null.
  void work(Worker& worker) {
    for (Job* job = nullptr;;) {
      worker.jobs.wait_dequeue(job);
      if (job == nullptr) return;
      job->outcome.error = nullptr;
      if (job->frame_is_copied)
        std::swap(frame_, job->frame);
      else
        for (const Event& event : job->events) frame_.update(event);
      try {
        job->outcome.result = answer_request(detector_, frame_, job->request);
      } catch (...) {
        job->outcome.error = std::current_exception();
      }
      job->outcome.duration = Clock::now() - job->requested;
      done_.wait_enqueue(job);
    }
  }

  Detector& detector_;
  std::size_t max_events_;
  PolarityFrame frame_;            // the detector's own, as of the last request
  std::vector<Event> new_events_;  // since the last request
  bool overflowed_ = false;
  Job job_;  // used by the detector's threads from `start` to its outcome, else by the tracking thread
  bool use_idle_worker_;
  moodycamel::BlockingReaderWriterCircularBuffer<Job*> done_{2};
  Worker prompt_worker_, idle_worker_;
};

}  // namespace evmarker::live
