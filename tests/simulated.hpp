#pragma once
// What the trackers' tests share: recordings of a 10 cm marker at 0.5 to 0.7 m, up to about 1100 px/s, and a detector.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/simulation/scene.hpp"
#include "evmarker/simulation/simulator_settings.hpp"
#include "evmarker/simulation/trajectory.hpp"

namespace evmarker::simulated {

inline const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
constexpr double kMarkerLength = 0.10;

constexpr double seconds(Timestamp t) { return static_cast<double>(t) * 1e-6; }

/// The cells of DICT_4X4_50's markers 0 and 1, so that tests of the core need no OpenCV.
inline CodeBits code(int id = 0) {
  CodeBits bits(4, 4);
  if (id == 0)
    bits << 1, 0, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0;
  else
    bits << 0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 1, 1, 0, 1, 0;
  return bits;
}

/// Hand-held sway, its fastest moments at about 1100 px/s.
inline Trajectory near_motion(std::uint64_t seed) {
  return trajectory::handheld(
      {.T_centre = facing_pose({0, 0, 0.6}), .amplitude_m = {0.10, 0.08, 0.10}, .frequency_hz = 1.3, .seed = seed});
}

/// Every event of a simulation. Compiled once for all tests, and optimised also where they are not, see CMakeLists.txt.
std::vector<Event> record(const PinholeCamera& camera, Scene scene, const SimulatorSettings& settings = {});
std::vector<Event> record(const PinholeCamera& camera, std::vector<SimulatedMarker> markers,
                          const SimulatorSettings& settings = {});

/// Marker `id` on `motion`, 1 Hz/px noise.
inline std::vector<Event> near_events(const Trajectory& motion, double duration_s, std::uint64_t seed, int id = 0) {
  return record(camera, {{.id = id, .length = kMarkerLength, .bits = code(id), .T_camera_marker = motion}},
                {.duration_s = duration_s, .seed = seed});
}

/// Those that pass the noise filter.
inline std::vector<Event> filtered(const std::vector<Event>& events) {
  SpatiotemporalFilter filter(camera.sensor_size(), kPaperWindow);
  std::vector<Event> kept;
  for (const Event& event : events)
    if (filter.accept(event)) kept.push_back(event);
  return kept;
}

/// Finds marker 0 where it truly is, in every frame, so that the tests of the bookkeeping rest on nothing else.
struct TrueDetector {
  Trajectory motion;
  std::function<void()> before = [] {};  ///< called in every detection
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
    before();
    const Eigen::Isometry3d T = motion(static_cast<double>(frame.t()) * 1e-6);
    MarkerDetection detection{.id = 0, .t = frame.t(), .T_camera_marker = T};
    const auto& corners = make_square_marker(kMarkerLength).vertices;
    for (std::size_t i = 0; i < 4; ++i) detection.corners_px[i] = camera.project(T * corners[i]);
    return {detection};
  }
  MarkerModel model(MarkerId) const { return make_code_marker(kMarkerLength, code()); }
};
static_assert(MarkerDetector<TrueDetector>);

}  // namespace evmarker::simulated
