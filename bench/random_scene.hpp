#pragma once
// A scene of one marker in which everything is drawn at random: what no scenario was made for.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/sensor_preset.hpp"
#include "scenarios.hpp"

namespace evmarker::bench {

namespace detail {

// Evenly distributed in its logarithm, as what differs by factors.
inline double factor_between(Random& random, double least, double most) {
  return std::exp(random.uniform(std::log(least), std::log(most)));
}

inline std::pair<PinholeCamera, SimulatorSettings> random_sensor(Random& random) {
  const SensorPreset& preset = kSensorPresets[random.bits() % kSensorPresets.size()];
  const double focal_px = preset.focal_px * random.uniform(0.7, 1.5);
  SimulatorSettings s = preset.settings;
  s.contrast_threshold_on *= random.uniform(0.6, 1.6);
  s.contrast_threshold_off *= random.uniform(0.6, 1.6);
  s.refractory_us = factor_between(random, 20, 600);
  s.light_time_constant_us = factor_between(random, 10, 300);
  s.noise_hz_per_px = factor_between(random, 0.02, 8);
  s.leak_hz_per_px = factor_between(random, 0.01, 1);
  s.latency_jitter_us = factor_between(random, 10, 200);
  s.point_spread_px = random.uniform(0.4, 1.1);
  s.seed = random.bits();
  const SensorSize size = preset.size;
  return {{size, focal_px, focal_px, (size.width - 1) / 2.0, (size.height - 1) / 2.0}, s};
}

// A hand's sway about a tilted pose at which the marker has about `side_px`; it stays in the image.
inline Trajectory random_sway(Random& random, const PinholeCamera& camera, double length, double side_px) {
  const double z = camera.focal_length() * length / side_px;
  Eigen::Isometry3d T = facing_pose({0, 0, z});
  const double tilt = random.uniform(0, 0.9), towards = random.uniform(0, kTurn), roll = random.uniform(0, kTurn);
  const Eigen::AngleAxisd tilted(tilt, Eigen::Vector3d(std::cos(towards), std::sin(towards), 0));
  T.linear() = (tilted * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ())).toRotationMatrix() * T.linear();
  const SensorSize size = camera.sensor_size();
  const double reach = random.uniform(0.1, 0.6);  // of the way to the image's border
  const auto amplitude_m = [&](int side) {
    return reach * z * std::max(0.04 * side, side / 2.0 - side_px) / camera.focal_length();
  };
  return trajectory::handheld(
      {.T_centre = T,
       .amplitude_m = {amplitude_m(size.width), amplitude_m(size.height), random.uniform(0.02, 0.2) * z},
       .amplitude_rad = {random.uniform(0.02, 0.35), random.uniform(0.02, 0.35), random.uniform(0.02, 0.6)},
       .frequency_hz = factor_between(random, 0.3, 5),
       .seed = random.bits()});
}

inline Background random_background(Random& random) {
  if (random.bits() % 2 == 0) return {.mean = random.uniform(0.1, 0.8)};
  const double direction = random.uniform(0, kTurn), px_per_s = random.uniform(0, 200);
  return {.mean = random.uniform(0.1, 0.7),
          .contrast = random.uniform(0.1, 1),
          .texture_size_px = random.uniform(8, 40),
          .velocity_px_per_s = px_per_s * Eigen::Vector2d(std::cos(direction), std::sin(direction)),
          .seed = random.bits()};
}

}  // namespace detail

/// Draws sensor, lens, marker, motion, light and background: 1.2 s of a marker of 26 to 200 px, within reach of the
/// detector. The same seed draws the same scene.
inline Situation random_scene(std::uint64_t seed) {
  static constexpr std::array kDictionaries{"DICT_4X4_50", "DICT_APRILTAG_36h11", "DICT_5X5_100", "DICT_6X6_250"};
  constexpr double kLeastCell_px = 4.4;  // smaller cells are not read
  Random random(seed, 0x5CE);
  auto [camera, settings] = detail::random_sensor(random);
  settings.duration_s = 1.2;
  Situation situation{camera, {}, settings, kDictionaries[random.bits() % kDictionaries.size()]};
  const auto dictionary = opencv::make_dictionary(situation.dictionary);
  SimulatedMarker marker;
  marker.id = static_cast<MarkerId>(random.bits() % 50);
  marker.bits = opencv::marker_bits(dictionary, marker.id);
  marker.length = detail::factor_between(random, 0.03, 0.3);
  marker.black = random.uniform(0.03, 0.15);
  marker.white = random.uniform(0.4, 0.9);
  const double least_px = kLeastCell_px * static_cast<double>(marker.bits.rows() + 2);
  const double most_px = std::min(200.0, 0.45 * camera.sensor_size().height);
  marker.T_camera_marker =
      detail::random_sway(random, camera, marker.length, detail::factor_between(random, least_px, most_px));
  situation.scene.markers.push_back(std::move(marker));
  situation.scene.background = detail::random_background(random);
  return situation;
}

}  // namespace evmarker::bench
