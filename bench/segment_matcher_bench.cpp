#include <benchmark/benchmark.h>

#include <vector>

#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "recording.hpp"

using namespace evmarker;

// Search over all segments at the true pose, a pose for each 10 ms of filtered events; only the matching is timed.
template <typename Matcher>
static void match(benchmark::State& state) {
  constexpr Timestamp kPose_us = 10000, kSpan_us = 1000;  // events of the 1 ms about each pose: its edges are there
  const auto& recording = bench::recording();
  const UndistortionTable lines(bench::camera());
  struct Moment {
    Matcher matcher;
    std::vector<Eigen::Vector2d> m;
  };
  std::vector<Moment> moments;
  std::size_t events = 0;
  for (Timestamp t = kPose_us; t < recording.end(); t += kPose_us) {
    moments.push_back({Matcher(recording.model(), bench::camera().focal_length()), {}});
    moments.back().matcher.project(recording.truth(t));
    for (const Event& event : recording.filtered)
      if (event.t >= t - kSpan_us / 2 && event.t < t + kSpan_us / 2) moments.back().m.push_back(lines(event));
    events += moments.back().m.size();
  }
  std::size_t matched = 0;
  for (auto _ : state) {
    matched = 0;
    for (const Moment& moment : moments)
      for (const Eigen::Vector2d& m : moment.m) {
        Correspondence correspondence;
        matched += moment.matcher.match(m, correspondence) == MatchResult::matched;
        benchmark::DoNotOptimize(correspondence);
      }
    benchmark::DoNotOptimize(matched);
  }
  bench::report_rates(state, events);
  state.counters["matched"] = static_cast<double>(matched) / static_cast<double>(events);
}
BENCHMARK(match<SegmentMatcher>)->Name("match/segments:18")->Unit(benchmark::kMillisecond);
BENCHMARK(match<GridMatcher>)->Name("match/grid")->Unit(benchmark::kMillisecond);
