#pragma once
// A detector on threads of its own.
#include <readerwriterqueue/readerwritercircularbuffer.h>

#include <chrono>
#include <cstddef>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/detection/detection.hpp"
#include "evmarker/detection/look.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/thread_priority.hpp"

namespace evmarker::live {

/// Looks at polarity frames while tracking goes on. Handing over a look costs the tracking thread nothing: the detector
/// has a frame of its own, and gets the events since the last look. One thread uses it, one look at a time; looks that
/// may wait are on a thread that runs where a processor is free.
template <MarkerDetector Detector>
class DetectionThread {
 public:
  struct Answer {
    Findings findings;
    std::exception_ptr error;  ///< what the detector threw instead
    Clock::duration took{};
  };

  /// @param detector used by these threads alone as long as they run
  /// @param max_events kept between looks; of more the whole frame is copied
  /// @param when_idle whether any look may wait, see `run_this_thread_when_idle`
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

  /// Waits for the end of the look that is going on.
  ~DetectionThread() {
    for (Worker* worker : {&soon_, &idle_}) {
      if (!worker->thread.joinable()) continue;
      worker->jobs.wait_enqueue(nullptr);
      worker->thread.join();
    }
  }

  /// An event that went into the frame.
  void add(const Event& event) {
    if (new_events_.size() < max_events_)
      new_events_.push_back(event);
    else
      too_many_ = true;
  }

  /// Starts a look at the frame of all events added. The last answer must have been taken.
  /// @param may_wait whether tracking comes first
  void look(Look look, const PolarityFrame& frame, bool may_wait) {
    job_.look = std::move(look);
    std::swap(job_.events, new_events_);
    new_events_.clear();
    job_.whole = std::exchange(too_many_, false);
    if (job_.whole) job_.frame = frame;
    job_.since = Clock::now();
    (may_wait && idle_is_served_ ? idle_ : soon_).jobs.wait_enqueue(&job_);
  }

  /// The answer to the look, valid until the next one, or nothing in time.
  const Answer* answer(std::chrono::microseconds timeout) {
    Job* job = nullptr;
    const bool there = timeout.count() > 0 ? answers_.wait_dequeue_timed(job, timeout) : answers_.try_dequeue(job);
    if (!there) return nullptr;
    // Other programs keep all processors busy: from now on the detector takes its share.
    if (job->answer.took > kStarved) idle_is_served_ = false;
    return &job->answer;
  }

 private:
  struct Job {
    Look look;
    std::vector<Event> events;
    PolarityFrame frame;
    bool whole;  // all of `frame` counts, not the events
    Clock::time_point since;
    Answer answer;
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
      job->answer.took = Clock::now() - job->since;
      answers_.wait_enqueue(job);
    }
  }

  Detector& detector_;
  std::size_t max_events_;
  PolarityFrame frame_;            // of the last look
  std::vector<Event> new_events_;  // since then
  bool too_many_ = false;
  Job job_;  // belongs to one side at a time
  bool idle_is_served_;
  moodycamel::BlockingReaderWriterCircularBuffer<Job*> answers_{2};
  Worker soon_, idle_;
};

}  // namespace evmarker::live
