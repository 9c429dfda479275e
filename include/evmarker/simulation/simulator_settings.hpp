#pragma once
// Settings of the simulator.
#include <cmath>
#include <cstdint>

#include "evmarker/base/require.hpp"

namespace evmarker {

/// Settings of the simulated sensor, and the length of the time steps.
struct SimulatorSettings {
  double duration_s = 1;
  std::uint64_t seed = 1;                ///< of the pixels' thresholds and leaks, the noise and the latencies
  double contrast_threshold_on = 0.25;   ///< rise of log intensity that causes an ON event
  double contrast_threshold_off = 0.25;  ///< fall of log intensity that causes an OFF event
  double threshold_mismatch = 0.03;      ///< standard deviation of the thresholds from pixel to pixel
  double refractory_us = 50;             ///< dead time of a pixel after its event
  double pixel_time_constant_us = 0;     ///< of the pixel's first-order low-pass of log intensity; 0: no low-pass
  /// Time constant of the photoreceptor at a light of 1 (perfect white), added to the one above. It is inversely
  /// proportional to the pixel's light.
  double light_time_constant_us = 0;
  double point_spread_px = 0.6;  ///< sigma of the blur by lens and pixel area together
  double noise_hz_per_px = 1;    ///< rate of noise events, of random polarity
  double leak_hz_per_px = 0;     ///< rate of ON events by the leak of the memorised level, without mismatch
  double leak_spread = 0.25;     ///< standard deviation of the logarithm of the leak from pixel to pixel
  double latency_jitter_us = 0;  ///< mean of the exponentially distributed delay of an event
  double max_step_px = 0.25;     ///< largest motion in the image within a time step
  double max_step_us = 1000;     ///< longest time between two samples of a trajectory
};

/// Returns the settings if they make sense.
/// @throws std::invalid_argument naming the first field that makes none
inline const SimulatorSettings& validated(const SimulatorSettings& s) {
  const Require require("simulator");
  require.not_negative(s.duration_s, "duration_s");
  require.positive(s.contrast_threshold_on, "contrast_threshold_on");
  require.positive(s.contrast_threshold_off, "contrast_threshold_off");
  require.not_negative(s.threshold_mismatch, "threshold_mismatch");
  require.not_negative(s.refractory_us, "refractory_us");
  require.not_negative(s.pixel_time_constant_us, "pixel_time_constant_us");
  require.not_negative(s.light_time_constant_us, "light_time_constant_us");
  require.positive(s.point_spread_px, "point_spread_px");
  require.not_negative(s.noise_hz_per_px, "noise_hz_per_px");
  require.not_negative(s.leak_hz_per_px, "leak_hz_per_px");
  require.not_negative(s.leak_spread, "leak_spread");
  require.not_negative(s.latency_jitter_us, "latency_jitter_us");
  require.positive(s.max_step_px, "max_step_px");
  require.positive(s.max_step_us, "max_step_us");
  return s;
}

}  // namespace evmarker
