#pragma once
// The paper's backtracking figure as four simulated recordings: the results of verification beside the truth.
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

/// One pose or one verification of the tracker, with the truth at that time.
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

/// Of the marker's fastest corner in the image.
inline double corner_speed_px_per_s(const Trajectory& motion, Timestamp t) {
  constexpr double kStep_s = 5e-4;
  const PinholeCamera camera = failure_camera();
  const double seconds = static_cast<double>(t) * 1e-6;
  const Eigen::Isometry3d before = motion(seconds - kStep_s), after = motion(seconds + kStep_s);
  double fastest = 0;
  for (const Eigen::Vector3d& corner : make_square_marker(kFailureMarkerLength).vertices)
    fastest = std::max(fastest, (camera.project(after * corner) - camera.project(before * corner)).norm());
  return fastest / (2 * kStep_s);
}

/// The paper's verification with the library's thresholds, and nothing else that may lose the marker.
inline MarkerTrackerSettings<DecoupledUpdate> verification_alone() {
  MarkerTrackerSettings<DecoupledUpdate> settings;
  settings.health.false_alarm_rate = 1e-300;
  settings.converging_events = 2000;  // the first updates, which the paper ignores
  settings.start_search.reset();      // a bad start is to stay bad
  settings.verification.every = 1;    // to see the signal all the time, as in the paper's figure
  return settings;
}

/// Notes when a tracker begins to be verified, and when and why it loses the marker.
inline void note(const PoseEstimate& pose, const VerificationSettings& limits, FailureSignal& signal) {
  const TrackingQuality& quality = pose.quality;
  if (quality.state == TrackingState::tracking && !signal.judged) signal.judged = pose.t;
  if (quality.state != TrackingState::lost) return;
  signal.lost = pose.t;
  signal.lost_by_backtracking = quality.backtrack_t == pose.t && (quality.backtrack_px > limits.max_translation_px ||
                                                                  quality.backtrack_rad > limits.max_rotation_rad);
}

/// Two trackers follow the events: one is stopped when verification fails, the other goes on and shows how signal and
/// pose develop after that.
inline FailureSignal run(const FailureCase& failure, const std::vector<Event>& events) {
  MarkerModel model = make_code_marker(kFailureMarkerLength, failure_code());
  for (MarkerSegment& edge : model.segments) edge.face_normal.setZero();  // it is not to be lost for turning away
  const auto settings = verification_alone();
  auto never_stopped = settings;
  never_stopped.verification.max_translation_px = never_stopped.verification.max_rotation_rad = 1e9;
  MarkerTracker judged(failure_camera(), model, failure.T_start, settings);
  MarkerTracker shown(failure_camera(), model, failure.T_start, never_stopped);

  FailureSignal signal;
  Timestamp verified = 0;
  for (const Event& event : events) {
    if (const auto* const pose = judged.push(event)) note(*pose, settings.verification, signal);
    const auto* const pose = shown.push(event);
    if (!pose) continue;
    const TrackingQuality& quality = pose->quality;
    const Eigen::Isometry3d truth = failure.motion(static_cast<double>(pose->t) * 1e-6);
    signal.poses.push_back({pose->t, judged.state(), quality.backtrack_px, quality.backtrack_rad,
                            pose_error(pose->T_camera_marker, truth), corner_speed_px_per_s(failure.motion, pose->t)});
    if (std::exchange(verified, quality.backtrack_t) != quality.backtrack_t)
      signal.verifications.push_back(signal.poses.back());
  }
  return signal;
}

}  // namespace evmarker::bench
