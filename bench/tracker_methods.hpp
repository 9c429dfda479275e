#pragma once
// The event methods of the accuracy comparison: the whole of `Tracker` on raw events, with one update rule or another.
#include <ctime>
#include <memory>
#include <utility>
#include <vector>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "scenarios.hpp"
#include "verdict.hpp"

namespace evmarker::bench {

/// Every event of a situation.
inline std::vector<Event> simulate(const Situation& situation) {
  std::vector<Event> events;
  Simulator simulator(situation.camera, situation.scene, situation.simulator);
  for_each_event(simulator, [&](const Event& event) { events.push_back(event); });
  return events;
}

/// Processor time of this process [s]: what one thread takes while no other runs.
inline double processor_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// A detector that measures its own time.
template <MarkerDetector D>
struct TimedDetector {
  D detector;
  std::shared_ptr<double> seconds = std::make_shared<double>(0);

  auto detect(const PolarityFrame& frame) {
    const double begin = processor_s();
    auto found = detector.detect(frame);
    *seconds += processor_s() - begin;
    return found;
  }
  MarkerModel model(MarkerId id) const { return detector.model(id); }
};

/// Detects, tracks, loses and finds again; nothing about the recording is given but camera, dictionary and size.
template <PoseUpdateRule Rule>
Run run_tracker(const Situation& situation, const std::vector<Event>& events, const TrackerSettings<Rule>& settings) {
  using Detector = TimedDetector<opencv::ArucoDetector<PinholeCamera>>;
  Detector detector{
      {situation.camera, {.dictionary = situation.dictionary, .marker_length = situation.marker_length()}}};
  Tracker<Detector, Rule> tracker(situation.camera, detector, settings);
  Run run(situation.scene.markers.size());
  run.events = events.size();
  std::vector<PoseEstimate> poses;
  const double begin = processor_s();
  tracker.push(events, [&](const PoseEstimate& pose) { poses.push_back(pose); });
  run.track_s = processor_s() - begin - *detector.seconds;
  run.detect_s = *detector.seconds;
  for (const PoseEstimate& pose : poses) run.add(situation, pose);
  return run;
}

/// The numbers that the paper gives: w0 = 0.1, lambda_T = 1.4, lambda_r = 0.003 in centimetres, n = 100.
inline Run paper_numbers(const Situation& situation, const std::vector<Event>& events) {
  TrackerSettings<DecoupledUpdate> settings;
  settings.marker.events_per_update = 100;
  settings.marker.update = DecoupledSettings::paper();
  return run_tracker(situation, events, settings);
}

/// The paper's rule with the library's default settings.
inline Run paper_rule_tuned(const Situation& situation, const std::vector<Event>& events) {
  return run_tracker(situation, events, TrackerSettings<DecoupledUpdate>{});
}

/// The coupled Kalman filter with its default settings.
inline Run kalman(const Situation& situation, const std::vector<Event>& events) {
  return run_tracker(situation, events, TrackerSettings<KalmanUpdate>{});
}

}  // namespace evmarker::bench
