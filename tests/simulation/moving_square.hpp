#pragma once
// A dark square that moves past ideal pixels, for tests of what the simulated sensor makes of it.
#include <vector>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/simulation/simulator.hpp"

namespace evmarker::test {

constexpr double kFocal = 400, kDepth = 0.5, kBlack = 0.08, kWhite = 0.85;
inline const PinholeCamera kCamera{{320, 240}, kFocal, kFocal, 159.5, 119.5};

/// Every threshold the same, no dead time, no noise.
inline SimulatorSettings ideal(double threshold_on = 0.25, double threshold_off = 0.25) {
  return {.duration_s = 0.1,
          .contrast_threshold_on = threshold_on,
          .contrast_threshold_off = threshold_off,
          .threshold_mismatch = 0,
          .refractory_us = 0,
          .noise_hz_per_px = 0};
}

inline SimulatedMarker dark_square(Trajectory motion, double black = kBlack, double white = kWhite) {
  return {.length = 0.1,
          .bits = CodeBits::Zero(1, 1),
          .T_camera_marker = std::move(motion),
          .black = black,
          .white = white};
}

/// A square of 80 px that moves right, its centre in the image's centre at 50 ms, on a background like its paper.
inline Scene moving_right(double px_per_s, double black = kBlack, double white = kWhite) {
  const double m_per_px = kDepth / kFocal;
  const auto start = facing_pose({-0.05 * px_per_s * m_per_px, 0, kDepth});
  return {{dark_square(trajectory::linear(start, {px_per_s * m_per_px, 0, 0}), black, white)}, {}, {.mean = white}};
}

inline double centre_u(double px_per_s, Timestamp t) {
  return 159.5 + px_per_s * (static_cast<double>(t) * 1e-6 - 0.05);
}

inline std::vector<Event> events_of(Simulator simulator) {
  std::vector<Event> events;
  for_each_event(simulator, [&](const Event& event) { events.push_back(event); });
  return events;
}

}  // namespace evmarker::test
