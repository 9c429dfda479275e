#pragma once
// The pixels of a simulated sensor: mismatch between pixels, and bandwidth that depends on the light.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "evmarker/simulation/event_pixel.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/simulator_settings.hpp"

namespace evmarker {

/// A pixel with random thresholds and a random leak, settled at a log intensity.
/// @param key identifies the pixel; it and the seed alone determine the random numbers
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

/// Simulates a pixel from t0 to t1 [us], while the log intensity changes linearly from its last value to
/// `log_intensity`. This is done in pieces short enough for the light, and with it the bandwidth, to be nearly
/// constant. Both stages of the low-pass are modelled as one, whose time constant is the sum of theirs.
/// @param emit as for `EventPixel::advance`
template <typename Emit>
void follow_light(EventPixel& pixel, const SimulatorSettings& settings, double t0, double t1, double log_intensity,
                  Emit&& emit) {
  EventPixelDynamics dynamics{settings.pixel_time_constant_us, settings.refractory_us};
  if (settings.light_time_constant_us == 0) return pixel.advance(t0, t1, log_intensity, dynamics, emit);
  const double start = pixel.log_intensity(), change = log_intensity - start;
  const double pieces = std::ceil(std::abs(change) / 0.2 + 1e-9);
  for (double i = 0; i < pieces; ++i) {
    const double middle = start + change * (i + 0.5) / pieces;
    dynamics.time_constant_us = settings.pixel_time_constant_us + settings.light_time_constant_us * std::exp(-middle);
    pixel.advance(t0 + (t1 - t0) * i / pieces, t0 + (t1 - t0) * (i + 1) / pieces, start + change * (i + 1) / pieces,
                  dynamics, emit);
  }
}

}  // namespace evmarker
