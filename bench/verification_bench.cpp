#include <benchmark/benchmark.h>

#include <vector>

#include "evmarker/tracking/verification.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

using Follower = EdgeFollower<DecoupledUpdate>;

/// The events between two verifications and the forward tracker after them.
struct Window {
  struct Step {
    Event event;
    bool updated;
  };
  std::vector<Step> steps;
  Follower end;
};

}  // namespace

// What verification adds to tracking at n = 100: the window is kept and every k updates gone through backwards.
static void verification(benchmark::State& state) {
  const VerificationSettings settings{.updates = static_cast<int>(state.range(0)), .every = 1};
  const auto& recording = bench::recording();
  const UndistortionTable lines(bench::camera());
  const Follower start(recording.model(), lines.focal_length(), recording.truth(0), {});
  Follower forward = start;
  std::vector<Window> windows;
  Verification<DecoupledUpdate> measured(start, settings);
  std::vector<double> errors_px, errors_rad;
  std::vector<Window::Step> steps;
  std::size_t events = 0;
  for (const Event& event : recording.filtered) {
    const auto [match, updated, segment] = forward.push(lines(event), event.t);
    if (match == MatchResult::far) continue;
    steps.push_back({event, updated});
    const auto error = measured.push(event, updated, forward, lines);
    if (!error) continue;
    errors_px.push_back(error->translation_px);
    errors_rad.push_back(error->rotation_rad);
    events += steps.size();
    windows.push_back({std::move(steps), forward});
    steps.clear();
  }

  for (auto _ : state) {
    state.PauseTiming();
    Verification<DecoupledUpdate> verification(start, settings);
    state.ResumeTiming();
    for (const Window& window : windows)
      for (const auto& [event, updated] : window.steps) {
        auto error = verification.push(event, updated, window.end, lines);
        benchmark::DoNotOptimize(error);
      }
  }
  bench::report_rates(state, events, windows.size() * static_cast<std::size_t>(state.range(0)));
  state.counters["backtrack_px"] = Spread::of(errors_px).mean;
  state.counters["backtrack_rad"] = Spread::of(errors_rad).mean;
  state.counters["verifications"] = static_cast<double>(windows.size());
}
BENCHMARK(verification)->Name("verification")->ArgName("k")->Arg(100)->Unit(benchmark::kMillisecond);
