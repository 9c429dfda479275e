#pragma once
// Floor 2. The pixels of a simulated sensor: how they differ from each other and with their light.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "evmarker/simulation/event_pixel.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/simulator_settings.hpp"

namespace evmarker {

/// A pixel with thresholds and a leak of its own, settled at a log intensity.
/// @param key what tells the pixel from others, however they are stored: it alone and the seed decide what is drawn
inline EventPixel make_pixel(const SimulatorSettings& settings, std::uint64_t key, double log_intensity) {
  constexpr std::uint64_t kThresholdStream = 1, kLeakStream = 4;
  Random random(settings.seed, kThresholdStream, key);
  const auto threshold = [&](double nominal) {  // a real comparator has no threshold near 0 or below
    return std::max(nominal / 4, nominal + settings.threshold_mismatch * random.gaussian());
  };
  const double on = threshold(settings.contrast_threshold_on);
  const double off = threshold(settings.contrast_threshold_off);
  if (settings.leak_hz_per_px == 0) return {log_intensity, on, off};

  // Leakage currents have a log-normal spread. Each pixel starts somewhere on its way to the next event.
  Random leak_random(settings.seed, kLeakStream, key);
  const double spread = settings.leak_spread;
  const double hz = settings.leak_hz_per_px * std::exp(spread * leak_random.gaussian() - 0.5 * spread * spread);
  return {log_intensity, on, off, hz * 1e-6 * settings.contrast_threshold_on, on * leak_random.uniform()};
}

/// What drives a pixel while its log intensity goes from one value to another. The delays of stages in a row add up;
/// where the light changes, its geometric mean counts.
inline EventPixelDynamics pixel_dynamics(const SimulatorSettings& settings, double from, double to) {
  EventPixelDynamics dynamics{settings.pixel_time_constant_us, settings.refractory_us};
  if (settings.light_time_constant_us > 0)
    dynamics.time_constant_us += settings.light_time_constant_us * std::exp(-0.5 * (from + to));
  return dynamics;
}

}  // namespace evmarker
