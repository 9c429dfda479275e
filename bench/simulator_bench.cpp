#include <benchmark/benchmark.h>

#include "evmarker/simulation/simulator.hpp"
#include "recording.hpp"

using namespace evmarker;

// The first 100 ms of the recording made anew, set-up included; the time of an iteration is against those 100 ms.
static void simulate(benchmark::State& state) {
  auto settings = bench::simulator_settings();
  settings.duration_s = 0.1;
  std::size_t events = 0;
  for (auto _ : state) {
    Simulator simulator(bench::camera(), bench::one_marker(), settings);
    events = 0;
    for (auto batch = simulator.next_batch(); !batch.empty(); batch = simulator.next_batch()) events += batch.size();
    benchmark::DoNotOptimize(events);
  }
  bench::report_rates(state, events);
}
BENCHMARK(simulate)->Name("simulate")->Unit(benchmark::kMillisecond);
