#include <benchmark/benchmark.h>

#include <limits>

#include "evmarker/decoupled_update.hpp"
#include "evmarker/kalman_update.hpp"
#include "evmarker/marker_tracker.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

// Filtered events in, poses out. Timed: the look-up of the line of sight, matching, averages, updates, the bookkeeping
// of the quality. The pose error comes from a pass over the same events before.
template <PoseUpdateRule Rule>
void run(benchmark::State& state, MarkerTrackerSettings<Rule> settings) {
  settings.capture.reset();  // the start is that of a detection
  using Tracker = MarkerTracker<Rule>;
  const auto& recording = bench::recording();
  const Tracker start(bench::camera(), recording.model(), recording.detected_start(), settings);
  AccuracyMeter accuracy;
  Tracker measured = start;
  for (const Event& event : recording.filtered)
    if (const auto pose = measured.push(event)) accuracy.add(*pose, recording.truth(pose->t));

  for (auto _ : state) {
    state.PauseTiming();
    Tracker tracker = start;
    state.ResumeTiming();
    for (const Event& event : recording.filtered) {
      auto pose = tracker.push(event);
      benchmark::DoNotOptimize(pose);
    }
  }
  bench::report_rates(state, recording.filtered.size(), accuracy.poses());
  bench::report_accuracy(state, accuracy, recording.end());
}

// Tracking alone: no verification, its window longer than the recording. Like for like with `reference/decoupled`.
template <PoseUpdateRule Rule>
void tracking(benchmark::State& state) {
  MarkerTrackerSettings<Rule> settings{.events_per_update = static_cast<int>(state.range(0))};
  settings.verification = {.updates = std::numeric_limits<int>::max(),
                           .max_events = 2 * bench::recording().filtered.size()};
  run<Rule>(state, settings);
}

// As a user gets it: verified every 100 updates, so that all events are gone through twice.
template <PoseUpdateRule Rule>
void verified(benchmark::State& state) {
  run<Rule>(state, {.events_per_update = static_cast<int>(state.range(0))});
}

void decoupled(benchmark::internal::Benchmark* b) {
  b->ArgName("n")->Arg(1)->Arg(5)->Arg(20)->Arg(100)->Unit(benchmark::kMillisecond);
}
void kalman(benchmark::internal::Benchmark* b) {
  b->ArgName("n")->Arg(1)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
}
BENCHMARK(tracking<DecoupledUpdate>)->Name("marker_tracker/decoupled")->Apply(decoupled);
BENCHMARK(verified<DecoupledUpdate>)->Name("marker_tracker/decoupled/verified")->Apply(decoupled);
BENCHMARK(tracking<KalmanUpdate>)->Name("marker_tracker/kalman")->Apply(kalman);
BENCHMARK(verified<KalmanUpdate>)->Name("marker_tracker/kalman/verified")->Apply(kalman);

}  // namespace
