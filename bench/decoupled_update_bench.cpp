#include <benchmark/benchmark.h>

#include <vector>

#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "recording.hpp"

using namespace evmarker;

// The averages and an update every 100 events, fed with correspondences that were matched before.
static void update_decoupled(benchmark::State& state) {
  constexpr int kEventsPerUpdate = 100, kUpdates = 200;  // few enough to stay in the cache
  const auto& recording = bench::recording();
  const UndistortionTable lines(bench::camera());
  SegmentMatcher matcher(recording.model(), lines.focal_length());
  Eigen::Isometry3d T = recording.detected_start();
  matcher.project(T);
  DecoupledUpdate rule({}, kEventsPerUpdate);
  std::vector<Correspondence> matched;
  AccuracyMeter accuracy;
  for (const Event& event : recording.filtered) {
    Correspondence correspondence;
    if (matcher.match(lines(event), correspondence) != MatchResult::matched) continue;
    matched.push_back(correspondence);
    rule.add(correspondence, T);
    if (matched.size() % kEventsPerUpdate != 0) continue;
    PoseEstimate pose;
    pose.quality.state = TrackingState::tracking;
    if (rule.update(T, event.t)) pose.T_camera_marker = T;
    accuracy.add(pose, recording.truth(event.t));
    matcher.project(T);
    if (matched.size() == kEventsPerUpdate * kUpdates) break;
  }
  if (matched.size() != kEventsPerUpdate * kUpdates) return state.SkipWithError("too few events match");

  for (auto _ : state) {
    DecoupledUpdate update({}, kEventsPerUpdate);
    Eigen::Isometry3d pose = recording.detected_start();
    int collected = 0;
    for (const Correspondence& correspondence : matched) {
      update.add(correspondence, pose);
      if (++collected % kEventsPerUpdate == 0) benchmark::DoNotOptimize(update.update(pose, 0));
    }
    benchmark::DoNotOptimize(pose);
  }
  bench::report_rates(state, matched.size(), kUpdates);
  state.counters["translation_mm"] = accuracy.translation_mm().mean;  // from the detection on
}
BENCHMARK(update_decoupled)->Name("update/decoupled")->Unit(benchmark::kMillisecond);
