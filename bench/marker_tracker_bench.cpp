#include <benchmark/benchmark.h>

#include <limits>

#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

using bench::Pushed;

// Filtered events in, poses out. Timed: the look-up of the line of sight, matching, averages, updates, the bookkeeping
// of the quality. The pose error comes from a pass over the same events before.
template <PoseUpdateRule Rule>
void run(benchmark::State& state, MarkerTrackerSettings<Rule> settings, Pushed pushed) {
  settings.start_search.reset();  // the start is that of a detection
  using Tracker = MarkerTracker<Rule>;
  const auto& recording = bench::recording();
  const Tracker start(bench::camera(), recording.model(), recording.detected_start(), settings);
  AccuracyMeter accuracy;
  Tracker measured = start;
  measured.push(recording.filtered, [&](const PoseEstimate& pose) { accuracy.add(pose, recording.truth(pose.t)); });

  for (auto _ : state) {
    state.PauseTiming();
    Tracker tracker = start;
    state.ResumeTiming();
    bench::push_all(tracker, recording.filtered, pushed);
  }
  bench::report_rates(state, recording.filtered.size(), accuracy.poses());
  bench::report_accuracy(state, accuracy, recording.end());
}

// Tracking alone: of all windows, only the first is verified. Like for like with `reference/decoupled`.
template <PoseUpdateRule Rule, Pushed pushed = Pushed::together>
void tracking(benchmark::State& state) {
  run<Rule>(state,
            {.events_per_update = static_cast<int>(state.range(0)),
             .verification = {.every = std::numeric_limits<int>::max()}},
            pushed);
}

// Default settings: every other window of 100 updates is verified.
template <PoseUpdateRule Rule>
void verified(benchmark::State& state) {
  run<Rule>(state, {.events_per_update = static_cast<int>(state.range(0))}, Pushed::together);
}

void decoupled(benchmark::internal::Benchmark* b) {
  b->ArgName("n")->Arg(1)->Arg(5)->Arg(20)->Arg(100)->Unit(benchmark::kMillisecond);
}
void kalman(benchmark::internal::Benchmark* b) {
  b->ArgName("n")->Arg(1)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
}
BENCHMARK(tracking<DecoupledUpdate>)->Name("marker_tracker/decoupled")->Apply(decoupled);
BENCHMARK(verified<DecoupledUpdate>)->Name("marker_tracker/decoupled/verified")->Apply(decoupled);
BENCHMARK(tracking<DecoupledUpdate, Pushed::one_by_one>)->Name("marker_tracker/decoupled/one_by_one")->Apply(decoupled);
BENCHMARK(tracking<KalmanUpdate>)->Name("marker_tracker/kalman")->Apply(kalman);
BENCHMARK(tracking<KalmanUpdate, Pushed::one_by_one>)->Name("marker_tracker/kalman/one_by_one")->Apply(kalman);
BENCHMARK(verified<KalmanUpdate>)->Name("marker_tracker/kalman/verified")->Apply(kalman);

}  // namespace
