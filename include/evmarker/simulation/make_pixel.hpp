#pragma once
// Floor 2. How pixels differ from each other as they come from the factory.
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

}  // namespace evmarker
