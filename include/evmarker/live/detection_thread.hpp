#pragma once
// Runs a marker detector on a thread of its own.
#include <readerwriterqueue/readerwritercircularbuffer.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/thread_priority.hpp"

namespace evmarker::live {

/// Detects markers in polarity frames while tracking goes on. A request costs the tracking thread next to nothing: the
/// detector has a frame of its own, which is brought up to date with the events since the last request. There is one
/// detection at a time. Its thread has normal priority and not a lower one: a detector's library may start threads,
/// which inherit it and stay. All functions are for the tracking thread.
template <MarkerDetector Detector>
class DetectionThread {
 public:
  struct Outcome {
    DetectionResult result;
    std::exception_ptr error;    ///< what the detector threw; then `result` is void
    Clock::duration duration{};  ///< from the request to the end of the detection
  };

  /// @param detector must outlive this object; meanwhile it is used by its thread alone
  /// @param max_events kept between two requests; if there are more, or the frame was cleared, the request copies the
  /// whole frame
  /// @throws std::system_error if the thread cannot be started
  DetectionThread(Detector& detector, SensorSize size, std::size_t max_events)
      : detector_(detector), max_events_(max_events), frame_(size), job_{.frame = PolarityFrame(size)} {
    new_events_.reserve(max_events);
    job_.events.reserve(max_events);
    thread_ = std::thread([this] { work(); });  // last: nothing throws after it
  }

  DetectionThread(const DetectionThread&) = delete;
  DetectionThread& operator=(const DetectionThread&) = delete;

  /// Waits for the end of a detection that is going on.
  ~DetectionThread() {
    jobs_.wait_enqueue(nullptr);
    thread_.join();
  }

  /// The detector whose thread this is; null on any other.
  static const Detector* detector_of_this_thread() noexcept { return detector_of_this_thread_; }

  /// Adds an event to the frame of the next request.
  void add(const Event& event) {
    if (new_events_.size() < max_events_)
      new_events_.push_back(event);
    else
      overflowed_ = true;
  }

  /// Starts a detection. The outcome of the one before must have been received.
  /// @param frame that of all events added
  void start(DetectionRequest request, const PolarityFrame& frame) {
    job_.request = std::move(request);
    std::swap(job_.events, new_events_);
    new_events_.clear();
    const bool cleared = std::exchange(clears_, frame.clears()) != frame.clears();
    job_.frame_is_copied = std::exchange(overflowed_, false) || cleared;
    if (job_.frame_is_copied) job_.frame = frame;
    job_.requested = Clock::now();
    jobs_.wait_enqueue(&job_);
  }

  /// Receives the outcome of the last request, valid until the next one; null if it does not come within the timeout.
  const Outcome* receive_outcome(std::chrono::microseconds timeout) {
    Job* job = nullptr;
    const bool done = timeout.count() > 0 ? done_.wait_dequeue_timed(job, timeout) : done_.try_dequeue(job);
    return done ? &job->outcome : nullptr;
  }

 private:
  struct Job {
    DetectionRequest request{};
    std::vector<Event> events{};
    PolarityFrame frame;
    bool frame_is_copied = false;  // `frame` is to be used: it was cleared, or had more events than `events` holds
    Clock::time_point requested{};
    Outcome outcome{};
  };

  // The detector's thread: does jobs until one is null.
  void work() {
    drop_real_time_priority();
    detector_of_this_thread_ = &detector_;
    for (Job* job = nullptr;;) {
      jobs_.wait_dequeue(job);
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

  static inline thread_local const Detector* detector_of_this_thread_ = nullptr;

  Detector& detector_;
  std::size_t max_events_;
  PolarityFrame frame_;            // the detector's own, as of the last request
  std::vector<Event> new_events_;  // since the last request
  bool overflowed_ = false;
  std::uint64_t clears_ = 0;  // of the frame, as of the last request
  Job job_;                   // used by the detector's thread from `start` to its outcome, else by the tracking thread
  moodycamel::BlockingReaderWriterCircularBuffer<Job*> jobs_{2}, done_{2};
  std::thread thread_;
};

}  // namespace evmarker::live
