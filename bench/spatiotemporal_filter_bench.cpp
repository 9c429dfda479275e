#include <benchmark/benchmark.h>

#include "evmarker/events/spatiotemporal_filter.hpp"
#include "recording.hpp"

using namespace evmarker;

// The raw recording, noise and all, through the paper's preprocessing.
static void filter(benchmark::State& state) {
  const auto& recording = bench::recording();
  for (auto _ : state) {
    state.PauseTiming();
    SpatiotemporalFilter filter(bench::camera().sensor_size());
    state.ResumeTiming();
    std::size_t accepted = 0;
    for (const Event& event : recording.events) accepted += filter.accept(event);
    benchmark::DoNotOptimize(accepted);
  }
  bench::report_rates(state, recording.events.size());
  state.counters["accepted"] =
      static_cast<double>(recording.filtered.size()) / static_cast<double>(recording.events.size());
}
BENCHMARK(filter)->Name("filter")->Unit(benchmark::kMillisecond);
