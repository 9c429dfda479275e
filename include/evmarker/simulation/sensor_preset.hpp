#pragma once
// Simulator settings for real event sensors, from public sources.
#include <array>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "evmarker/events/event.hpp"
#include "evmarker/simulation/simulator_settings.hpp"

namespace evmarker {

/// A sensor to be simulated.
struct SensorPreset {
  const char* name;
  SensorSize size;
  double focal_px;  ///< focal length of a usual lens [px]
  SimulatorSettings settings;
};

// Sources:
//
// [1] Gallego et al., "Event-based Vision: A Survey", 2022, table 1: resolution, pixel pitch, latency, least contrast
// that fires (DVS128 17 %, DAVIS240 11 %, DAVIS346 14.3-22.5 %, Gen3 12 %, Gen4 11 %), stationary noise at 25 C (DVS128
// 0.05, all others 0.1 events per pixel and second).
//
// [2] Lichtsteiner, Posch, Delbruck, "A 128x128 120 dB 15 us latency asynchronous temporal contrast vision sensor",
// 2008: mismatch of the thresholds 2.1 % contrast; pixel bandwidth up to 3 kHz, proportional to the light.
//
// [3] Brandli et al., "A 240x180 130 dB 3 us latency global shutter spatiotemporal vision sensor", 2014: mismatch of
// the thresholds 3.5 %.
//
// [4] Hu, Liu, Delbruck, "v2e: From Video Frames to Realistic DVS Events", 2021, default options: thresholds 0.2 +-
// 0.03, low-pass of 300 Hz, leak of 0.01 to 0.1 Hz, spread of the leak rates 0.1 decades.
//
// [5] Nozaki and Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision sensors", 2017: at rest
// and in good light nearly all noise is leak events. The leak rates here are therefore the noise rates of [1].
//
// [6] Rebecq, Gehrig, Scaramuzza, "ESIM: an open event camera simulator", 2018: refractory period 100 us by default.
//
// [7] Finateu et al., "A 1280x720 back-illuminated stacked temporal contrast event-based vision sensor with 4.86 um
// pixels", 2020: Gen4, sold as IMX636.
//
// Choices: Sensors are not run at their least threshold; 0.2 to 0.3 is usual [4]. The low-pass is that of indoor light:
// 800 Hz, between the 300 Hz of [4] and the 3 kHz of [2], which is 200 us where the light is 1. The two newest sensors
// have 50 us, at the low end of their latencies of 40-200 us and 20-150 us [1]; the spread of these latencies is also
// taken for the jitter of the others. The usual lens has 4.5 mm with pixels of 40 um, 6 mm with 18.5 um, 8 mm with 15
// um and 4.86 um.
inline constexpr std::array<SensorPreset, 6> kSensorPresets{{
    {"default", {640, 480}, 533, {}},
    {"dvs128",
     {128, 128},
     112.5,
     {.contrast_threshold_on = 0.25,   // above 0.16, the least [1]
      .contrast_threshold_off = 0.25,  //
      .threshold_mismatch = 0.021,     // [2]
      .refractory_us = 100,            // [6]
      .light_time_constant_us = 200,   // [2], [4]
      .noise_hz_per_px = 0.02,
      .leak_hz_per_px = 0.05,  // [1], [5]
      .leak_spread = 0.23,     // [4]
      .latency_jitter_us = 100}},
    {"davis240",
     {240, 180},
     324,
     {.contrast_threshold_on = 0.2,  // [4]; the least is 0.11 [1]
      .contrast_threshold_off = 0.2,
      .threshold_mismatch = 0.035,  // [3]
      .refractory_us = 100,
      .light_time_constant_us = 200,
      .noise_hz_per_px = 0.02,
      .leak_hz_per_px = 0.1,  // [1], [5]
      .leak_spread = 0.23,
      .latency_jitter_us = 100}},
    {"davis346",
     {346, 260},
     324,
     {.contrast_threshold_on = 0.25,  // twice the least of 0.14 and 0.22 [1] would be 0.28 and 0.44
      .contrast_threshold_off = 0.35,
      .threshold_mismatch = 0.035,  // [3]: the same pixel
      .refractory_us = 100,
      .light_time_constant_us = 200,
      .noise_hz_per_px = 0.02,
      .leak_hz_per_px = 0.1,  // [1], [5]
      .leak_spread = 0.23,
      .latency_jitter_us = 100}},
    {"gen3",
     {640, 480},
     533,
     {.contrast_threshold_on = 0.25,  // twice the least [1]
      .contrast_threshold_off = 0.25,
      .threshold_mismatch = 0.03,  // [4]
      .refractory_us = 100,
      .light_time_constant_us = 50,
      .noise_hz_per_px = 0.02,
      .leak_hz_per_px = 0.1,  // [1], [5]
      .leak_spread = 0.23,
      .latency_jitter_us = 100}},  // 40-200 us [1]
    {"imx636",
     {1280, 720},
     1646,
     {.contrast_threshold_on = 0.25,  // twice the least [1], [7]
      .contrast_threshold_off = 0.25,
      .threshold_mismatch = 0.03,  // [4]
      .refractory_us = 100,
      .light_time_constant_us = 50,
      .noise_hz_per_px = 0.02,
      .leak_hz_per_px = 0.1,  // [1], [5]
      .leak_spread = 0.23,
      .latency_jitter_us = 60}},  // 20-150 us [1]
}};

/// The preset with a name.
/// @throws std::invalid_argument naming the unknown name and all known ones
inline const SensorPreset& sensor_preset(std::string_view name) {
  std::string known;
  for (const SensorPreset& preset : kSensorPresets) {
    if (name == preset.name) return preset;
    known += (known.empty() ? "" : ", ") + std::string(preset.name);
  }
  throw std::invalid_argument("sensor is \"" + std::string(name) + "\", not one of " + known);
}

}  // namespace evmarker
