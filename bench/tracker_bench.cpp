#include <benchmark/benchmark.h>

#include <vector>

#include "evmarker/tracking/tracker.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

/// Returns the true poses in the first frame and nothing later: detection costs nothing, and a lost marker stays lost.
class TrueStart {
 public:
  explicit TrueStart(const bench::Recording& recording) : recording_(&recording) {}

  std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
    std::vector<MarkerDetection> detections;
    if (std::exchange(done_, true)) return detections;
    for (std::size_t i = 0; i < recording_->bodies.size(); ++i) {
      detections.emplace_back();
      detections.back().id = recording_->bodies[i].id;
      detections.back().t = frame.t();
      detections.back().T_camera_marker = recording_->truth(frame.t(), i);
    }
    return detections;
  }

  MarkerModel model(MarkerId id) const {
    for (const bench::Body& body : recording_->bodies)
      if (body.id == id) return body.model;
    throw std::invalid_argument("no marker " + std::to_string(id));
  }

 private:
  const bench::Recording* recording_;
  bool done_ = false;
};
static_assert(MarkerDetector<TrueStart>);

using bench::Pushed;

// The whole of `Tracker` on raw events: filter, polarity frame, history, every marker's tracking and verification;
// detections that find nothing.
template <Pushed pushed>
void track(benchmark::State& state, const bench::Recording& recording) {
  TrackerSettings<> settings;
  settings.detections_to_confirm = 1;
  const Tracker<TrueStart> start(bench::camera(), TrueStart(recording), settings);

  std::vector<AccuracyMeter> accuracy(recording.bodies.size());
  std::size_t poses = 0;
  auto measured = start;
  measured.push(recording.events, [&](const PoseEstimate& pose) {
    for (std::size_t i = 0; i < accuracy.size(); ++i)
      if (recording.bodies[i].id == pose.id) {
        accuracy[i].add(pose, recording.truth(pose.t, i));
        ++poses;
      }
  });

  for (auto _ : state) {
    state.PauseTiming();
    auto tracker = start;
    state.ResumeTiming();
    bench::push_all(tracker, recording.events, pushed);
  }
  bench::report_rates(state, recording.events.size(), poses);
  double translation_mm = 0, rotation_deg = 0, coverage = 0;
  for (const AccuracyMeter& marker : accuracy) {
    const double share = 1 / static_cast<double>(accuracy.size());
    translation_mm += share * marker.translation_mm().mean;
    rotation_deg += share * marker.rotation_deg().mean;
    coverage += share * marker.coverage(recording.end());
  }
  state.counters["translation_mm"] = translation_mm;
  state.counters["rotation_deg"] = rotation_deg;
  state.counters["coverage"] = coverage;
}
template <Pushed pushed>
void tracker(benchmark::State& state) {
  track<pushed>(state, bench::recording(static_cast<int>(state.range(0))));
}
void markers(benchmark::internal::Benchmark* b) {
  b->ArgName("markers")->Arg(1)->Arg(5)->Arg(20)->Arg(50)->Unit(benchmark::kMillisecond);
}
BENCHMARK(tracker<Pushed::together>)->Name("tracker")->Apply(markers);
BENCHMARK(tracker<Pushed::one_by_one>)->Name("tracker/one_by_one")->Apply(markers);

// The same for one board.
void board(benchmark::State& state) {
  track<Pushed::together>(state, bench::board_recording(static_cast<int>(state.range(0))));
}
BENCHMARK(board)->ArgName("markers")->Arg(2)->Arg(12)->Arg(48)->Unit(benchmark::kMillisecond);

}  // namespace
