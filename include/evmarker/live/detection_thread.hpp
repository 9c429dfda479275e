#pragma once
// live. A detector on a thread of its own.
#include <readerwriterqueue/readerwritercircularbuffer.h>

#include <chrono>
#include <cstddef>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/detection.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/thread_priority.hpp"
#include "evmarker/look.hpp"

namespace evmarker::live {

/// Looks at polarity frames while tracking goes on. Handing over a look costs the tracking thread nothing: this thread
/// keeps a frame of its own, and gets the events since the last look. One thread uses it, one look at a time.
template <MarkerDetector Detector>
class DetectionThread {
 public:
  struct Answer {
    Findings findings;
    std::exception_ptr error;  ///< what the detector threw instead
    Clock::duration took{};
  };

  /// @param detector used by this thread alone as long as it runs
  /// @param max_events kept between looks; of more the whole frame is copied
  /// @param when_idle see `run_this_thread_when_idle`
  DetectionThread(Detector& detector, SensorSize size, std::size_t max_events, bool when_idle)
      : detector_(detector),
        max_events_(max_events),
        when_idle_(when_idle),
        frame_(size),
        job_{{}, {}, PolarityFrame(size), false, {}} {
    new_events_.reserve(max_events);
    job_.events.reserve(max_events);
    thread_ = std::thread([this] { run(); });
  }

  DetectionThread(const DetectionThread&) = delete;
  DetectionThread& operator=(const DetectionThread&) = delete;

  /// Waits for the end of the look that is going on.
  ~DetectionThread() {
    jobs_.wait_enqueue(nullptr);
    thread_.join();
  }

  /// An event that went into the frame.
  void add(const Event& event) {
    if (new_events_.size() < max_events_)
      new_events_.push_back(event);
    else
      too_many_ = true;
  }

  /// Starts a look at the frame of all events added. The last answer must have been taken.
  void look(Look look, const PolarityFrame& frame) {
    job_.look = std::move(look);
    std::swap(job_.events, new_events_);
    new_events_.clear();
    job_.whole = std::exchange(too_many_, false);
    if (job_.whole) job_.frame = frame;
    jobs_.wait_enqueue(&job_);
  }

  /// The answer to the look, valid until the next one, or nothing in time.
  const Answer* answer(std::chrono::microseconds timeout) {
    Job* job = nullptr;
    const bool there = timeout.count() > 0 ? answers_.wait_dequeue_timed(job, timeout) : answers_.try_dequeue(job);
    return there ? &job->answer : nullptr;
  }

 private:
  struct Job {
    Look look;
    std::vector<Event> events;
    PolarityFrame frame;
    bool whole;  // all of `frame` counts, not the events
    Answer answer;
  };

  void run() {
    if (when_idle_)
      run_this_thread_when_idle();
    else
      lower_priority_of_this_thread();
    for (Job* job = nullptr;;) {
      jobs_.wait_dequeue(job);
      if (job == nullptr) return;
      const auto start = Clock::now();
      job->answer.error = nullptr;
      if (job->whole)
        std::swap(frame_, job->frame);
      else
        for (const Event& event : job->events) frame_.update(event);
      try {
        job->answer.findings = evmarker::answer(detector_, frame_, job->look);
      } catch (...) {
        job->answer.error = std::current_exception();
      }
      job->answer.took = Clock::now() - start;
      answers_.wait_enqueue(job);
    }
  }

  Detector& detector_;
  std::size_t max_events_;
  bool when_idle_;
  PolarityFrame frame_;            // of the last look
  std::vector<Event> new_events_;  // since then
  bool too_many_ = false;
  Job job_;  // belongs to one side at a time
  moodycamel::BlockingReaderWriterCircularBuffer<Job*> jobs_{2}, answers_{2};
  std::thread thread_;
};

}  // namespace evmarker::live
