#include <benchmark/benchmark.h>

#include <vector>

#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "recording.hpp"

using namespace evmarker;

// One detection in the polarity frame, averaged over ten frames of the recording.
static void detect_aruco(benchmark::State& state) {
  constexpr Timestamp kBetweenFrames_us = 90000;
  const auto& recording = bench::recording();
  opencv::ArucoDetector detector(bench::camera(), {.dictionary = "DICT_4X4_50", .marker_length = 0.10});
  if (detector.bits(bench::kDictionaryId) != bench::code_bits())
    return state.SkipWithError("the recording's marker is not of the dictionary");

  PolarityFrame frame(bench::camera().sensor_size());
  std::vector<PolarityFrame> frames;
  for (const Event& event : recording.filtered) {
    frame.update(event);
    if (event.t >= kBetweenFrames_us * static_cast<Timestamp>(frames.size() + 1)) frames.push_back(frame);
  }
  AccuracyMeter accuracy;
  for (const PolarityFrame& seen : frames)
    for (const MarkerDetection& detection : detector.detect(seen)) {
      PoseEstimate pose;
      pose.t = detection.t;
      pose.T_camera_marker = detection.T_camera_marker;
      pose.quality.state = TrackingState::tracking;
      accuracy.add(pose, recording.truth(detection.t));
    }

  for (auto _ : state)
    for (const PolarityFrame& seen : frames) {
      auto detections = detector.detect(seen);
      benchmark::DoNotOptimize(detections);
    }
  bench::report_rates(state, 0, accuracy.poses());
  state.counters["frames_per_second"] = benchmark::Counter(
      static_cast<double>(state.iterations()) * static_cast<double>(frames.size()), benchmark::Counter::kIsRate);
  state.counters["found"] = static_cast<double>(accuracy.poses()) / static_cast<double>(frames.size());
  state.counters["translation_mm"] = accuracy.translation_mm().mean;
  state.counters["rotation_deg"] = accuracy.rotation_deg().mean;
}
BENCHMARK(detect_aruco)->Name("detect/aruco")->Unit(benchmark::kMillisecond);
