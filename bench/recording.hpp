#pragma once
// The recordings of every benchmark, simulated once per process, with their truth.
#include <benchmark/benchmark.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "evmarker/simulation/trajectory.hpp"

namespace evmarker::bench {

/// The cells of marker 7 of DICT_4X4_50: with its outline 18 segments.
inline CodeBits code_bits() {
  CodeBits bits(4, 4);
  bits << 1, 1, 0, 0, 0, 1, 0, 0, 1, 1, 1, 1, 0, 0, 1, 0;
  return bits;
}

inline constexpr MarkerId kDictionaryId = 7;

/// A sensor and lens like the paper's.
inline PinholeCamera camera() { return {{640, 480}, 533, 533, 319.5, 239.5}; }

/// Marker 7 in a hand: 10 cm at 0.54 to 0.69 m, up to about 1100 px/s.
inline Scene one_marker() {
  const trajectory::Handheld sway{.T_centre = facing_pose({0, 0, 0.6}),
                                  .amplitude_m = {0.08, 0.06, 0.09},
                                  .amplitude_rad = {0.3, 0.3, 0.4},
                                  .frequency_hz = 1.4,
                                  .seed = 5};
  SimulatedMarker marker;
  marker.id = kDictionaryId;
  marker.bits = code_bits();
  marker.T_camera_marker = trajectory::handheld(sway);
  return {{marker}, {}, {}};
}

/// Markers in a grid that fills the image, each moving by itself: up to 20 of 7 cm, up to 50 of 4 cm. All have the
/// code of marker 7, so that the work for one marker is the same for all.
inline Scene many_markers(int count) {
  const bool small = count > 20;
  const int columns = small ? 10 : 5, rows = small ? 5 : 4;
  const double length = small ? 0.04 : 0.07, pitch_x = small ? 0.068 : 0.135, pitch_y = small ? 0.1 : 0.13;
  Scene scene;
  for (int i = 0; i < count; ++i) {
    const double column = i % columns - (columns - 1) / 2.0, row = i / columns - (rows - 1) / 2.0;
    const double amplitude = small ? 0.009 : 0.02;  // they do not hide each other
    trajectory::Handheld sway{.T_centre = facing_pose({pitch_x * column, pitch_y * row, 0.6}),
                              .amplitude_m = {amplitude, amplitude, 0.03},
                              .amplitude_rad = {0.25, 0.25, 0.25},
                              .frequency_hz = 1.0};
    sway.seed = static_cast<std::uint64_t>(i) + 1;
    SimulatedMarker marker;
    marker.id = i;
    marker.length = length;
    marker.bits = code_bits();
    marker.T_camera_marker = trajectory::handheld(sway);
    scene.markers.push_back(marker);
  }
  return scene;
}

/// Code markers in a grid on a plate that moves in a hand and fills the image: 2, 12 (4 x 3) or 48 (8 x 6). All have
/// the code of marker 7.
inline Board board(int markers) {
  const int columns = markers > 12 ? 8 : markers > 2 ? 4 : 2, rows = markers / columns;
  const double pitch = std::min(0.13, 0.5 / columns);
  Board board{.id = 0, .markers = {}};
  for (int i = 0; i < markers; ++i) {
    BoardMarker marker{.id = i, .length = 0.7 * pitch, .bits = code_bits()};
    marker.T_board_marker.translation() =
        pitch * Eigen::Vector3d(i % columns - (columns - 1) / 2.0, i / columns - (rows - 1) / 2.0, 0);
    board.markers.push_back(marker);
  }
  return board;
}

inline Trajectory board_motion() {
  return trajectory::handheld({.T_centre = facing_pose({0, 0, 0.65}),
                               .amplitude_m = {0.04, 0.03, 0.05},
                               .amplitude_rad = {0.25, 0.25, 0.3},
                               .frequency_hz = 1.2,
                               .seed = 6});
}

inline SimulatorSettings simulator_settings() { return {.duration_s = 1, .seed = 20, .noise_hz_per_px = 1}; }

/// What is tracked as one.
struct Body {
  MarkerId id = 0;
  MarkerModel model;
  Trajectory T_camera_body;
};

struct Recording {
  std::vector<Body> bodies;
  std::vector<Event> events;
  std::vector<Event> filtered;  ///< what the spatiotemporal filter lets through
  double peak_px_per_s = 0;

  Eigen::Isometry3d truth(Timestamp t, std::size_t body = 0) const {
    return bodies[body].T_camera_body(static_cast<double>(t) * 1e-6);
  }
  const MarkerModel& model(std::size_t body = 0) const { return bodies[body].model; }
  Timestamp end() const { return events.back().t; }

  /// A start pose as a detection may give it: 5 mm beside, 15 mm behind and 1.7 deg off the true pose.
  Eigen::Isometry3d detected_start() const {
    Eigen::Isometry3d T = truth(0);
    T.translation() += Eigen::Vector3d(0.004, -0.003, 0.015);
    T.linear() = so3_exp({0.02, -0.02, 0.01}) * T.linear();
    return T;
  }
};

/// A scene for one second at 1 Hz/px noise.
inline Recording record(const Scene& scene, std::vector<Body> bodies) {
  Recording recording;
  Simulator simulator(camera(), scene, simulator_settings());
  SpatiotemporalFilter filter(camera().sensor_size(), kPaperWindow);
  for_each_event(simulator, [&](const Event& event) {
    recording.events.push_back(event);
    if (filter.accept(event)) recording.filtered.push_back(event);
  });
  recording.bodies = std::move(bodies);
  recording.peak_px_per_s = simulator.peak_speed_px_per_s();
  return recording;
}

/// One marker (`one_marker`) or several (`many_markers`).
inline const Recording& recording(int markers = 1) {
  static std::map<int, Recording> simulated;
  if (const auto known = simulated.find(markers); known != simulated.end()) return known->second;
  const Scene scene = markers == 1 ? one_marker() : many_markers(markers);
  std::vector<Body> bodies;
  for (const SimulatedMarker& marker : scene.markers)
    bodies.push_back({marker.id, make_code_marker(marker.length, marker.bits), marker.T_camera_marker});
  return simulated.emplace(markers, record(scene, std::move(bodies))).first->second;
}

/// A `board`.
inline const Recording& board_recording(int markers) {
  static std::map<int, Recording> simulated;
  if (const auto known = simulated.find(markers); known != simulated.end()) return known->second;
  const Board plate = board(markers);
  const Scene scene{simulated_markers(plate, board_motion()), {}, {}};
  return simulated.emplace(markers, record(scene, {{plate.id, make_board_model(plate), board_motion()}})).first->second;
}

/// How events come to a tracker: as many at a time as a camera's driver may deliver, or each by itself.
enum class Pushed { together, one_by_one };

/// Pushes all of them and has every pose count as used.
template <typename Tracker>
void push_all(Tracker& tracker, std::span<const Event> events, Pushed pushed) {
  if (pushed == Pushed::one_by_one) {
    for (const Event& event : events) {
      auto poses = tracker.push(event);
      benchmark::DoNotOptimize(poses);
    }
    return;
  }
  constexpr std::size_t kBatch = 1000;
  for (; !events.empty(); events = events.subspan(std::min(kBatch, events.size())))
    tracker.push(events.first(std::min(kBatch, events.size())),
                 [](const auto& pose) { benchmark::DoNotOptimize(&pose); });
}

/// Events and poses per second from what one iteration does.
inline void report_rates(benchmark::State& state, std::size_t events, std::size_t poses = 0) {
  const auto iterations = static_cast<double>(state.iterations());
  using benchmark::Counter;
  if (events > 0)
    state.counters["events_per_second"] = Counter(iterations * static_cast<double>(events), Counter::kIsRate);
  if (poses > 0)
    state.counters["poses_per_second"] = Counter(iterations * static_cast<double>(poses), Counter::kIsRate);
}

/// Error of the `tracking` poses and the share of the recording that they cover: speed that loses the marker is none.
inline void report_accuracy(benchmark::State& state, const AccuracyMeter& accuracy, Timestamp end) {
  state.counters["translation_mm"] = accuracy.translation_mm().mean;
  state.counters["rotation_deg"] = accuracy.rotation_deg().mean;
  state.counters["coverage"] = accuracy.coverage(end);
}

}  // namespace evmarker::bench
