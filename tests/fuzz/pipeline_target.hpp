#pragma once
// Fuzzed: a pipeline, by calls in any order, with callbacks and detectors that throw.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/live/pipeline.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/pose_promises.hpp"
#include "fuzz/target.hpp"
#include "fuzz/tracking_targets.hpp"

namespace evmarker::fuzz {

namespace detail {

struct CallbackFault {};

inline void check_sum(const live::Status& s) {
  require_that(s.events == s.processed + s.filtered + s.off_sensor + s.hot + s.time_faults + s.dropped + s.queue_depth,
               "the counters of a pipeline add up");
}

/// A pipeline and what calls it.
class PipelineCalls {
 public:
  PipelineCalls(Numbers& numbers, const live::PipelineSettings<>& settings)
      : throw_every_(numbers.byte() % 8),
        pipeline_(
            kCamera, HostileDetector{Random(numbers.bits(2))}, [this](const PoseEstimate& pose) { take(pose); },
            with_callbacks(settings)) {}

  void call(std::uint8_t which, std::size_t argument) {
    switch (which % 10) {
      case 0: flush(); break;
      case 1: stop(); break;
      case 2: pipeline_.start(); break;
      case 3: pipeline_.set_detection(argument % 2 == 0); break;
      case 4: pipeline_.push(TriggerEvent{static_cast<int>(argument % 16), true, t_}); break;
      case 5:
        for (const PoseEstimate& pose : pipeline_.poses_at(t_ + static_cast<Timestamp>(argument) * 100))
          check_pose(pose);
        break;
      case 6: check_sum(pipeline_.status()); break;
      default: push(argument); break;
    }
  }

  /// Stops, and checks that what callbacks were given is right.
  void finish() {
    flush();
    stop();
    const live::Status status = pipeline_.status();
    check_sum(status);
    require_that(!status.running && status.queue_depth == 0, "a pipeline that is stopped keeps no events");
    require_that(!bad_pose_, "callbacks are given right poses");
  }

 private:
  static const std::vector<Event>& seed_events() {
    static const std::vector<Event> events = [] {
      const std::string bytes = moving_marker(1, 1000);
      Numbers numbers(bytes);
      return read_events(numbers).events;
    }();
    return events;
  }

  live::PipelineSettings<> with_callbacks(live::PipelineSettings<> settings) {
    if (throw_every_ % 2 == 0)
      settings.on_tick = [this](Timestamp, std::span<const PoseEstimate> poses) {
        for (const PoseEstimate& pose : poses) take(pose);
      };
    settings.on_trigger = [this](const TriggerEvent&) { throw_sometimes(); };
    return settings;
  }

  // On the tracking thread: a broken promise must not be taken for a fault of the callback.
  void take(const PoseEstimate& pose) {
    try {
      check_pose(pose);
    } catch (const BrokenPromise&) {
      bad_pose_ = true;
    }
    throw_sometimes();
  }
  void throw_sometimes() {
    if (throw_every_ > 0 && ++calls_ % throw_every_ == 0) throw CallbackFault();
  }

  void flush() {
    try {
      pipeline_.flush();
    } catch (const HostileDetector::Fault&) {
    }
    const live::Status status = pipeline_.status();
    check_sum(status);
    require_that(status.queue_depth == 0, "after a flush nothing is left in the queue");
  }

  void stop() {
    try {
      pipeline_.stop();
    } catch (const CallbackFault&) {
    } catch (const HostileDetector::Fault&) {
    }
  }

  void push(std::size_t count) {
    std::vector<Event> range;
    for (; range.size() < 4 * count + 1; ++next_) {
      Event event = events_[next_ % events_.size()];
      event.t += static_cast<Timestamp>(next_ / events_.size()) * 20000;
      range.push_back(event);
    }
    t_ = range.back().t;
    pipeline_.push(range);
  }

  std::size_t throw_every_;
  const std::vector<Event>& events_ = seed_events();
  std::size_t next_ = 0;
  Timestamp t_ = 0;
  std::atomic<std::size_t> calls_ = 0;
  std::atomic<bool> bad_pose_ = false;
  live::Pipeline<HostileDetector> pipeline_;
};

inline std::string make_call(Random& random) {
  return {static_cast<char>(random.bits()), static_cast<char>(random.bits())};
}

inline std::vector<std::string> pipeline_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Random random(seed);
    std::string input;
    for (int byte = 0; byte < 10; ++byte) input += static_cast<char>(random.bits());
    for (int calls = 0; calls < 16; ++calls) input += make_call(random);
    seeds.push_back(input);
  }
  return seeds;
}

}  // namespace detail

inline void fuzz_pipeline(std::string_view input) {
  Numbers numbers(input);
  live::PipelineSettings<> settings;
  settings.overload = std::array{live::OverloadPolicy::block, live::OverloadPolicy::drop_oldest,
                                 live::OverloadPolicy::thin}[numbers.index(3)];
  settings.queue_events = 1024U << numbers.index(5);
  settings.wait_for_detector = numbers.flag();
  settings.priority = live::TrackingPriority::normal;
  settings.tracker.detection_latency = std::chrono::microseconds(100 * numbers.byte());
  settings.tracker.min_events_per_detection = numbers.byte();
  settings.tick_interval = std::chrono::microseconds(100 + 10 * numbers.byte());
  detail::PipelineCalls calls(numbers, settings);
  while (!numbers.empty()) {
    const std::uint8_t which = numbers.byte();
    calls.call(which, numbers.byte());
  }
  calls.finish();
}

inline std::vector<Target> pipeline_targets() {
  return {{"pipeline", fuzz_pipeline, detail::pipeline_seeds, {10, 2, detail::make_call}, 96, 200, 2}};
}

}  // namespace evmarker::fuzz
