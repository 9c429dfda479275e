#include "evmarker/simulation/sensor_preset.hpp"

#include <doctest/doctest.h>

#include <set>

using namespace evmarker;

TEST_CASE("the default sensor is the one of the settings") {
  const SensorPreset& sensor = sensor_preset("default");
  const SimulatorSettings settings;
  CHECK(sensor.size.width == 640);
  CHECK(sensor.size.height == 480);
  CHECK(sensor.settings.contrast_threshold_on == settings.contrast_threshold_on);
  CHECK(sensor.settings.contrast_threshold_off == settings.contrast_threshold_off);
  CHECK(sensor.settings.threshold_mismatch == settings.threshold_mismatch);
  CHECK(sensor.settings.refractory_us == settings.refractory_us);
  CHECK(sensor.settings.noise_hz_per_px == settings.noise_hz_per_px);
  CHECK(sensor.settings.leak_hz_per_px == 0);
  CHECK(sensor.settings.light_time_constant_us == 0);
}

TEST_CASE("every preset has a name of its own and can be simulated") {
  std::set<std::string> names;
  for (const SensorPreset& sensor : kSensorPresets) {
    CAPTURE(sensor.name);
    CHECK(names.insert(sensor.name).second);
    CHECK(&sensor_preset(sensor.name) == &sensor);
    CHECK(sensor.size.width > 0);
    CHECK(sensor.size.height > 0);
    CHECK(sensor.focal_px > 50);
    CHECK_NOTHROW(validated(sensor.settings));
  }
  for (const char* name : {"dvs128", "davis346", "gen3", "imx636"}) CHECK(names.contains(name));
  CHECK(sensor_preset("dvs128").size.width == 128);
  CHECK(sensor_preset("davis346").size.height == 260);
  CHECK(sensor_preset("imx636").size.width == 1280);
}

TEST_CASE("an unknown sensor is named in the error, with the known ones") {
  CHECK_THROWS_WITH_AS(sensor_preset("dvs1"),
                       "sensor is \"dvs1\", not one of default, dvs128, davis240, davis346, gen3, imx636",
                       std::invalid_argument);
}
