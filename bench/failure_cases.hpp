#pragma once
// The paper's backtracking figure as four simulated recordings: what verification says, and beside it the truth.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "evmarker/simulation/trajectory.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"

namespace evmarker::bench {

/// A marker in motion and the pose that its tracker starts from.
struct FailureCase {
  std::string name, title;
  Trajectory motion;
  Eigen::Isometry3d T_start;
  double duration_s = 1.8;
};

/// One pose or one verification: what the tracker says and what is true at that time.
struct FailureSample {
  Timestamp t = 0;
  TrackingState state = TrackingState::converging;
  double backtrack_px = 0, backtrack_rad = 0;  ///< of the last verification
  PoseError error;
  double speed_px_per_s = 0;  ///< true, of the marker's fastest corner
};

struct FailureSignal {
  std::vector<FailureSample> poses;
  std::vector<FailureSample> verifications;
  std::optional<Timestamp> judged;  ///< first pose after the converging updates
  std::optional<Timestamp> lost;    ///< when the tracker gave up
  bool lost_by_backtracking = false;
};

inline PinholeCamera failure_camera() { return {{640, 480}, 533, 533, 319.5, 239.5}; }

inline constexpr double kFailureMarkerLength = 0.10;
inline constexpr double kQuickens_s = 1.0;  ///< when the motion of cases a, b, c begins to turn fast

inline CodeBits failure_code() {  // marker 7 of DICT_4X4_50
  CodeBits bits(4, 4);
  bits << 1, 1, 0, 0, 0, 1, 0, 0, 1, 1, 1, 1, 0, 0, 1, 0;
  return bits;
}

/// Runs a motion at `slow` times its speed, after `from_s` at `fast` times; the change takes 0.3 s.
inline Trajectory quicken(Trajectory base, double slow, double fast, double from_s) {
  constexpr double kChange_s = 0.3;
  return [=, base = std::move(base)](double seconds) {
    const double u = std::clamp((seconds - from_s) / kChange_s, 0.0, 1.0);
    const double fast_s = kChange_s * (u * u * u - u * u * u * u / 2) + std::max(0.0, seconds - from_s - kChange_s);
    return base(slow * seconds + (fast - slow) * fast_s);
  };
}

/// Sways slowly (about 40 px/s) for a second, then up to 1250 px/s.
inline Trajectory slow_then_fast() {
  return quicken(
      trajectory::handheld(
          {.amplitude_m = {0.08, 0.06, 0.09}, .amplitude_rad = {0.3, 0.3, 0.4}, .frequency_hz = 1, .seed = 2}),
      0.1, 1.8, kQuickens_s);
}

/// Turns away until it is seen at 80 degrees after a second, nearly edge on, and back.
inline Trajectory turn_away() {
  return [](double seconds) {
    const double s = std::sin(std::numbers::pi / 2 * seconds), away = 80 * std::numbers::pi / 180 * s * s;
    return facing_pose({0.05 * std::sin(4 * seconds), 0.04 * std::sin(5 * seconds + 1), 0.55},
                       {0.1 * std::sin(3 * seconds), away, 0.2 * std::sin(4 * seconds)});
  };
}

/// (a), (b) and (c) are the same recording, started from three poses.
inline std::vector<FailureCase> failure_cases() {
  const auto off = [](Eigen::Isometry3d T, const Eigen::Vector3d& metres, const Eigen::Vector3d& radians) {
    T.translation() += metres;
    T.linear() = so3_exp(radians) * T.linear();
    return T;
  };
  const Trajectory sway = slow_then_fast(), turn = turn_away();
  const double cell = kFailureMarkerLength / 6;
  return {
      {"a", "good start", sway, off(sway(0), {0.003, -0.002, 0.006}, {0.02, -0.02, 0.01})},
      {"b", "bad start, refined", sway, off(sway(0), {0, 0, 0.06}, {0, 0, 0.2})},
      {"c", "bad start, one cell aside, lost in the fast motion", sway, off(sway(0), {cell, 0, 0}, {0, 0, 0})},
      {"d", "extreme tilt (80 deg at 1 s)", turn, turn(0)},
  };
}

/// The filtered events of a case. The same motion and seed give the same events.
inline std::vector<Event> failure_events(const FailureCase& failure, std::uint64_t seed) {
  SimulatedMarker marker;
  marker.length = kFailureMarkerLength;
  marker.bits = failure_code();
  marker.T_camera_marker = failure.motion;
  Simulator simulator(failure_camera(), {marker}, {.duration_s = failure.duration_s, .seed = seed});
  SpatiotemporalFilter filter(failure_camera().sensor_size());
  std::vector<Event> events;
  for_each_event(simulator, [&](const Event& event) {
    if (filter.accept(event)) events.push_back(event);
  });
  return events;
}

/// Two trackers see the events: one with the paper's verification and the library's defaults for it says whether the
/// marker is lost; one like it that is never stopped shows how the signal and the pose go on after that.
inline FailureSignal run(const FailureCase& failure, const std::vector<Event>& events) {
  using Tracker = MarkerTracker<DecoupledUpdate>;
  const PinholeCamera camera = failure_camera();
  const MarkerModel model = make_code_marker(kFailureMarkerLength, failure_code());
  Tracker::Settings judging;
  judging.health.false_alarm_rate = 1e-300;  // the paper's verification alone judges
  judging.converging_events = 2000;          // the first updates, which the paper ignores
  judging.start_search.reset();              // a bad start is to stay bad
  judging.verification.every = 1;            // to see the signal all the time, as in the paper's figure
  Tracker::Settings never_stopped = judging;
  never_stopped.verification.max_translation_px = never_stopped.verification.max_rotation_rad = 1e9;
  Tracker judged(camera, model, failure.T_start, judging), shown(camera, model, failure.T_start, never_stopped);

  const auto truth = [&](Timestamp t) { return failure.motion(static_cast<double>(t) * 1e-6); };
  const auto speed = [&](Timestamp t) {
    constexpr Timestamp kStep_us = 500;
    double fastest = 0;
    for (const Eigen::Vector3d& corner : make_square_marker(kFailureMarkerLength).vertices)
      fastest = std::max(
          fastest,
          (camera.project(truth(t + kStep_us) * corner) - camera.project(truth(t - kStep_us) * corner)).norm());
    return fastest / (2e-6 * static_cast<double>(kStep_us));
  };

  FailureSignal signal;
  Timestamp verified = 0;
  for (const Event& event : events) {
    const auto verdict = judged.push(event);
    if (verdict && verdict->quality.state == TrackingState::tracking && !signal.judged) signal.judged = verdict->t;
    if (verdict && verdict->quality.state == TrackingState::lost) {
      const TrackingQuality& last = verdict->quality;
      signal.lost = verdict->t;
      signal.lost_by_backtracking =
          last.backtrack_t == verdict->t && (last.backtrack_px > judging.verification.max_translation_px ||
                                             last.backtrack_rad > judging.verification.max_rotation_rad);
    }
    const auto pose = shown.push(event);
    if (!pose) continue;
    const TrackingQuality& quality = pose->quality;
    signal.poses.push_back({pose->t, judged.state(), quality.backtrack_px, quality.backtrack_rad,
                            pose_error(pose->T_camera_marker, truth(pose->t)), speed(pose->t)});
    if (std::exchange(verified, quality.backtrack_t) != quality.backtrack_t)
      signal.verifications.push_back(signal.poses.back());
  }
  return signal;
}

}  // namespace evmarker::bench
