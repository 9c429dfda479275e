#include <benchmark/benchmark.h>

#include <algorithm>

#include "../examples/paper_tracker.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "recording.hpp"

using namespace evmarker;

// The same filtered events as `marker_tracker/decoupled`; the first updates do not count as tracking there either.
static void reference(benchmark::State& state) {
  const auto& recording = bench::recording();
  const int n = static_cast<int>(state.range(0));
  const DecoupledSettings tuned;
  const paper::Gains gains{.w0 = std::min(0.1, 1.0 / n),
                           .lambda_T = tuned.translation_gain,
                           .lambda_r = tuned.rotation_gain,
                           .unit_m = 0,
                           .n = n,
                           .k = 0};
  const paper::Tracker start(bench::camera(), recording.model(), recording.detected_start(), gains);
  AccuracyMeter accuracy;
  paper::Tracker measured = start;
  for (const Event& event : recording.filtered)
    if (const auto T = measured.push(event)) {
      PoseEstimate pose;
      pose.t = event.t;
      pose.T_camera_marker = *T;
      const auto matched = n * (static_cast<int>(accuracy.poses()) + 1);
      const bool converging = matched <= MarkerTrackerSettings<DecoupledUpdate>{}.converging_events;
      pose.quality.state = converging ? TrackingState::converging : TrackingState::tracking;
      accuracy.add(pose, recording.truth(event.t));
    }

  for (auto _ : state) {
    state.PauseTiming();
    paper::Tracker tracker = start;
    state.ResumeTiming();
    for (const Event& event : recording.filtered) {
      auto pose = tracker.push(event);
      benchmark::DoNotOptimize(pose);
    }
  }
  bench::report_rates(state, recording.filtered.size(), accuracy.poses());
  bench::report_accuracy(state, accuracy, recording.end());
}
BENCHMARK(reference)
    ->Name("reference/decoupled")
    ->ArgName("n")
    ->Arg(1)
    ->Arg(5)
    ->Arg(100)
    ->Unit(benchmark::kMillisecond);
