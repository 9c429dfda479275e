#pragma once
// A detector on threads of its own.
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

/// Detects markers in polarity frames while tracking goes on. A request costs the tracking thread nothing: the detector
/// has a frame of its own, and gets the events since its last one. One detection at a time; those that may wait are on
/// a thread that runs where a processor is free.
template <MarkerDetector Detector>
class DetectionThread {
 public:
  struct Outcome {
    DetectionResult result;
    std::exception_ptr error;  ///< what the detector threw instead
    Clock::duration duration{};
  };

  /// @param detector used by these threads alone as long as they run
  /// @param max_events kept between requests; if there are more, the whole frame is copied
  /// @param when_idle true if requests may wait at all, see `run_this_thread_when_idle`
  DetectionThread(Detector& detector, SensorSize size, std::size_t max_events, bool when_idle)
      : detector_(detector),
        max_events_(max_events),
        frame_(size),
        job_{{}, {}, PolarityFrame(size), false, Clock::now(), {}},
        idle_is_served_(when_idle) {
    new_events_.reserve(max_events);
    job_.events.reserve(max_events);
    soon_.thread = std::thread([this] {
      lower_priority_of_this_thread();
      work(soon_);
    });
    if (when_idle)
      idle_.thread = std::thread([this] {
        run_this_thread_when_idle();
        work(idle_);
      });
  }

  DetectionThread(const DetectionThread&) = delete;
  DetectionThread& operator=(const DetectionThread&) = delete;

  /// Waits for the end of the detection that is going on.
  ~DetectionThread() {
    for (Worker* worker : {&soon_, &idle_}) {
      if (!worker->thread.joinable()) continue;
      worker->jobs.wait_enqueue(nullptr);
      worker->thread.join();
    }
  }

  /// Takes an event that is in the next frame.
  void add(const Event& event) {
    if (new_events_.size() < max_events_)
      new_events_.push_back(event);
    else
      too_many_ = true;
  }

  /// Starts a detection in the frame of all events added. There must have been an outcome of the one before.
  /// @param may_wait true if tracking comes first
  void start(DetectionRequest request, const PolarityFrame& frame, bool may_wait) {
    job_.request = std::move(request);
    std::swap(job_.events, new_events_);
    new_events_.clear();
    job_.whole = std::exchange(too_many_, false);
    if (job_.whole) job_.frame = frame;
    job_.since = Clock::now();
    (may_wait && idle_is_served_ ? idle_ : soon_).jobs.wait_enqueue(&job_);
  }

  /// The outcome of the last request, valid until the next one; null if it is not there in time.
  const Outcome* outcome(std::chrono::microseconds timeout) {
    Job* job = nullptr;
    const bool done = timeout.count() > 0 ? done_.wait_dequeue_timed(job, timeout) : done_.try_dequeue(job);
    if (!done) return nullptr;
    // Other programs keep all processors busy: from now on the detector takes its share.
    if (job->outcome.duration > kStarved) idle_is_served_ = false;
    return &job->outcome;
  }

 private:
  struct Job {
    DetectionRequest request;
    std::vector<Event> events;
    PolarityFrame frame;
    bool whole;  // `frame` is complete, `events` are not
    Clock::time_point since;
    Outcome outcome;
  };

  struct Worker {
    moodycamel::BlockingReaderWriterCircularBuffer<Job*> jobs{2};
    std::thread thread;
  };

  static constexpr std::chrono::milliseconds kStarved{200};

  void work(Worker& worker) {
    for (Job* job = nullptr;;) {
      worker.jobs.wait_dequeue(job);
      if (job == nullptr) return;
      job->outcome.error = nullptr;
      if (job->whole)
        std::swap(frame_, job->frame);
      else
        for (const Event& event : job->events) frame_.update(event);
      try {
        job->outcome.result = answer_request(detector_, frame_, job->request);
      } catch (...) {
        job->outcome.error = std::current_exception();
      }
      job->outcome.duration = Clock::now() - job->since;
      done_.wait_enqueue(job);
    }
  }

  Detector& detector_;
  std::size_t max_events_;
  PolarityFrame frame_;            // of the last request
  std::vector<Event> new_events_;  // since then
  bool too_many_ = false;
  Job job_;  // belongs to one side at a time
  bool idle_is_served_;
  moodycamel::BlockingReaderWriterCircularBuffer<Job*> done_{2};
  Worker soon_, idle_;
};

}  // namespace evmarker::live
