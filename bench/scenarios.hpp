#pragma once
// The recordings on which accuracy is compared: motions, scenes, cameras, and the errors that count as good.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene.hpp"
#include "evmarker/simulation/sensor_preset.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "evmarker/simulation/trajectory.hpp"

namespace evmarker::bench {

/// One recording to be made: its truth is in the scene.
struct Situation {
  PinholeCamera camera;
  Scene scene;
  SimulatorSettings simulator;
  std::string dictionary = "DICT_4X4_50";

  double marker_length() const { return scene.markers.front().length; }
  Eigen::Isometry3d truth(std::size_t marker, Timestamp t) const {
    return scene.markers[marker].T_camera_marker(static_cast<double>(t) * 1e-6);
  }
};

/// A kind of recording, drawn anew for each seed, and the mean errors that the best tracker should stay within.
struct Scenario {
  std::string name, title;
  double translation_goal_mm, rotation_goal_deg, coverage_goal;
  std::function<Situation(std::uint64_t seed)> make;
};

/// Share of a marker's black square that is in the image and not behind an occluder.
inline double visible_share(const Situation& situation, std::size_t index, double seconds) {
  constexpr int kPoints = 9;
  const SimulatedMarker& marker = situation.scene.markers[index];
  const Eigen::Isometry3d T = marker.T_camera_marker(seconds);
  const SensorSize size = situation.camera.sensor_size();
  int seen = 0;
  for (int i = 0; i < kPoints * kPoints; ++i) {
    const Eigen::Vector3d point = T * Eigen::Vector3d((i % kPoints / (kPoints - 1.0) - 0.5) * marker.length,
                                                      (i / kPoints / (kPoints - 1.0) - 0.5) * marker.length, 0);
    if (!(point.z() > 0)) continue;
    const Eigen::Vector2d pixel = situation.camera.project(point);
    const bool in_image = (pixel.array() >= 0).all() && pixel.x() <= size.width - 1 && pixel.y() <= size.height - 1;
    const bool hidden = std::ranges::any_of(situation.scene.occluders, [&](const Occluder& occluder) {
      return seconds >= occluder.from_s && seconds < occluder.until_s &&
             ((pixel - occluder.centre_px(seconds)).array().abs() < occluder.half_size_px.array()).all();
    });
    seen += in_image && !hidden;
  }
  return seen / static_cast<double>(kPoints * kPoints);
}

/// The same motion and camera with AprilTags of the family 36h11 in the place of the markers.
inline Situation with_april_tags(Situation situation) {
  situation.dictionary = "DICT_APRILTAG_36h11";
  const auto dictionary = opencv::make_dictionary(situation.dictionary);
  for (SimulatedMarker& marker : situation.scene.markers) {
    marker.bits = opencv::marker_bits(dictionary, marker.id);
    marker.shades.resize(0, 0);  // another code has other cells
  }
  return situation;
}

namespace detail {

inline constexpr double kTurn = 2 * std::numbers::pi;

/// 640x480 pixels behind a lens of 533 px, like the paper's.
inline PinholeCamera paper_camera(Distortion lens = {}) { return {{640, 480}, 533, 533, 319.5, 239.5, lens}; }

/// A 10 cm marker whose id the seed draws, at 0.6 m; about 1100 px/s at the most.
inline trajectory::Handheld near_sway(Random& random) {
  return {.T_centre = facing_pose({0, 0, 0.6}),
          .amplitude_m = {0.10, 0.08, 0.10},
          .amplitude_rad = {0.25, 0.25, 0.35},
          .frequency_hz = 1.3,
          .seed = random.bits()};
}

inline SimulatedMarker marker(int id, double length, Trajectory motion) {
  static const auto dictionary = opencv::make_dictionary("DICT_4X4_50");
  return {
      .id = id, .length = length, .bits = opencv::marker_bits(dictionary, id), .T_camera_marker = std::move(motion)};
}

inline Situation one_marker(Random& random, Trajectory motion, double duration_s,
                            const PinholeCamera& camera = paper_camera()) {
  Situation situation{camera, {}, {.duration_s = duration_s, .seed = random.bits()}};
  situation.scene.markers.push_back(marker(static_cast<int>(random.bits() % 50), 0.10, std::move(motion)));
  return situation;
}

inline Situation swaying(Random& random, const trajectory::Handheld& sway, double duration_s,
                         const PinholeCamera& camera = paper_camera()) {
  return one_marker(random, trajectory::handheld(sway), duration_s, camera);
}

inline Situation near(Random random) { return swaying(random, near_sway(random), 2); }

inline Situation fast(Random random) {
  auto sway = near_sway(random);
  sway.frequency_hz = 4.5;
  return swaying(random, sway, 1.5);
}

inline Situation far(Random random) {
  auto sway = near_sway(random);
  sway.T_centre = facing_pose({0, 0, 1.5});
  sway.amplitude_m = {0.25, 0.18, 0.25};
  return swaying(random, sway, 2);
}

inline Situation dim(Random random) {
  auto situation = near(random);
  situation.simulator.pixel_time_constant_us = 300;
  situation.simulator.latency_jitter_us = 100;
  situation.simulator.noise_hz_per_px = 10;
  return situation;
}

inline Situation tilt(Random random) {
  auto sway = near_sway(random);
  sway.amplitude_m = {0.06, 0.05, 0.06};
  sway.amplitude_rad = {0, 0, 0.2};
  const double direction = random.uniform(0, kTurn);
  const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0);
  const auto tilted = [base = trajectory::handheld(sway), axis](double s) {
    Eigen::Isometry3d T = base(s);
    T.linear() = so3_exp(55 / 180.0 * std::numbers::pi * std::sin(kTurn * 0.6 * s) * axis) * T.linear();
    return T;
  };
  return one_marker(random, tilted, 2);
}

/// A board passes between camera and marker as fast as a hand moves it: 2500 px/s; all is hidden for about 200 ms.
inline Situation occluded(Random random) {
  auto sway = near_sway(random);
  auto situation = swaying(random, sway, 1.8);
  const double speed = random.uniform() < 0.5 ? 2500 : -2500, middle_s = random.uniform(0.85, 0.95);
  situation.scene.occluders.push_back({.centre_px = [=](double s) -> Eigen::Vector2d {
                                         return {320 + speed * (s - middle_s), 240};
                                       },
                                       .half_size_px = {320, 300}});
  return situation;
}

inline Situation clutter(Random random) {
  auto situation = swaying(random, near_sway(random), 1.5);
  const double direction = random.uniform(0, kTurn);
  situation.scene.background = {.mean = 0.4,
                                .contrast = 0.6,
                                .texture_size_px = 24,
                                .velocity_px_per_s = 120 * Eigen::Vector2d(std::cos(direction), std::sin(direction)),
                                .seed = random.bits()};
  return situation;
}

inline Situation several(Random random) {
  Situation situation{paper_camera(), {}, {.duration_s = 1.5, .seed = random.bits()}};
  const double places[5][2] = {{-0.2, -0.13}, {0.2, -0.13}, {0, 0}, {-0.2, 0.13}, {0.2, 0.13}};
  for (int i = 0; i < 5; ++i) {
    const trajectory::Handheld sway{.T_centre = facing_pose({places[i][0], places[i][1], 0.6}),
                                    .amplitude_m = {0.035, 0.03, 0.04},
                                    .amplitude_rad = {0.25, 0.25, 0.35},
                                    .frequency_hz = 1.4,
                                    .seed = random.bits()};
    const int id = 10 * i + static_cast<int>(random.bits() % 10);
    situation.scene.markers.push_back(marker(id, 0.06, trajectory::handheld(sway)));
  }
  return situation;
}

/// Out to where the lens bends straight edges: 250 px from the centre.
inline Situation distorted(Random random) {
  auto sway = near_sway(random);
  sway.amplitude_m = {0.2, 0.12, 0.08};
  sway.frequency_hz = 0.9;
  return swaying(random, sway, 2, paper_camera(BrownConradyDistortion{.k1 = -0.35, .k2 = 0.12}));
}

inline Situation hd(Random random) {
  return swaying(random, near_sway(random), 1.5, {{1280, 720}, 900, 900, 639.5, 359.5});
}

inline Situation slow(Random random) {
  auto sway = near_sway(random);
  sway.frequency_hz = 0.15;
  return swaying(random, sway, 3);
}

/// All of the marker leaves the image on one side, and comes back 0.4 s later.
inline Situation leaving(Random random) {
  auto sway = near_sway(random);
  sway.amplitude_m = {0.05, 0.04, 0.06};
  const double begin_s = random.uniform(0.5, 0.6), away_s = 0.9;
  const bool sideways = random.uniform() < 0.5;
  const double way_m = (random.uniform() < 0.5 ? 1 : -1) * (sideways ? 0.62 : 0.52);
  const Eigen::Vector3d way = way_m * (sideways ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY());
  const auto motion = [base = trajectory::handheld(sway), begin_s, away_s, way](double s) {
    const double share = std::clamp((s - begin_s) / away_s, 0.0, 1.0);
    Eigen::Isometry3d T = base(s);
    T.translation() += (0.5 - 0.5 * std::cos(kTurn * share)) * way;
    return T;
  };
  return one_marker(random, motion, 2.2);
}

inline Situation shaking(Random random) {
  auto sway = near_sway(random);
  sway.amplitude_m = {0.05, 0.04, 0.05};
  auto tremble = sway;
  tremble.T_centre = Eigen::Isometry3d::Identity();
  tremble.amplitude_m = {0.010, 0.010, 0.010};
  tremble.amplitude_rad = {0.05, 0.05, 0.07};
  tremble.frequency_hz = 12;
  tremble.seed = random.bits();
  const auto motion = [base = trajectory::handheld(sway), shake = trajectory::handheld(tremble)](double s) {
    const Eigen::Isometry3d quick = shake(s);
    Eigen::Isometry3d T = base(s);
    T.translation() += quick.translation();
    T.linear() = quick.linear() * T.linear();
    return T;
  };
  return one_marker(random, motion, 1.5);
}

// --- Like real sensors -----------------------------------------------------------------------------------------------

/// Dark grey on light grey. A pixel that an edge passes spends half a threshold of each polarity on turning round, as
/// it remembers where it fired last; the rest of a contrast of ln 3 makes 3.7 OFF or 2.3 ON events.
inline Situation low_contrast(Random random) {
  auto situation = near(random);
  situation.scene.markers.front().black = 0.2;
  situation.scene.markers.front().white = 0.6;
  situation.simulator.contrast_threshold_on = 0.35;
  situation.simulator.contrast_threshold_off = 0.22;
  return situation;
}

/// Every edge has another contrast: the outer edges make 9, 7, 5 and 2 events a passage, those of the code 5
/// to 9.
inline Situation uneven(Random random) {
  auto situation = near(random);
  SimulatedMarker& marker = situation.scene.markers.front();
  const Eigen::Index cells = marker.bits.rows() + 4;
  marker.shades.setConstant(cells, cells, marker.black);
  const auto turn = static_cast<Eigen::Index>(random.bits() % 4);
  const double rims[] = {0.85, 0.5, 0.3, 0.15};
  marker.shades.row(0).setConstant(rims[turn]);
  marker.shades.col(cells - 1).setConstant(rims[(turn + 1) % 4]);
  marker.shades.row(cells - 1).setConstant(rims[(turn + 2) % 4]);
  marker.shades.col(0).setConstant(rims[(turn + 3) % 4]);
  for (Eigen::Index row = 0; row < marker.bits.rows(); ++row)
    for (Eigen::Index column = 0; column < marker.bits.cols(); ++column)
      if (marker.bits(row, column) != 0) marker.shades(row + 2, column + 2) = random.uniform(0.3, 0.85);
  return situation;
}

/// Pixels that are as slow as they are dark: 0.35 ms on the paper, 3.75 ms on the ink.
inline Situation dim_sensor(Random random) {
  auto situation = near(random);
  situation.simulator.light_time_constant_us = 300;
  situation.simulator.latency_jitter_us = 100;
  situation.simulator.noise_hz_per_px = 5;
  return situation;
}

/// 2000 px/s: an edge is a pixel further after the dead time.
inline Situation refractory(Random random) {
  auto sway = near_sway(random);
  sway.frequency_hz = 2.3;
  auto situation = swaying(random, sway, 1.5);
  situation.simulator.refractory_us = 500;
  return situation;
}

inline Situation defocus(Random random) {
  auto situation = near(random);
  situation.simulator.point_spread_px = 1.3;
  return situation;
}

/// The sensor of a preset behind its usual lens.
inline Situation with_sensor(Random& random, const char* name, const trajectory::Handheld& sway, double duration_s) {
  const SensorPreset& sensor = sensor_preset(name);
  const double cx = 0.5 * (sensor.size.width - 1), cy = 0.5 * (sensor.size.height - 1);
  auto situation =
      swaying(random, sway, duration_s, PinholeCamera(sensor.size, sensor.focal_px, sensor.focal_px, cx, cy));
  const auto [seconds, seed] = std::pair(situation.simulator.duration_s, situation.simulator.seed);
  situation.simulator = sensor.settings;
  situation.simulator.duration_s = seconds;
  situation.simulator.seed = seed;
  return situation;
}

/// 54 px wide at 0.6 m, up to about 600 px/s.
inline Situation davis346(Random random) { return with_sensor(random, "davis346", near_sway(random), 2); }

/// 32 px wide at 0.35 m, up to about 300 px/s.
inline Situation dvs128(Random random) {
  auto sway = near_sway(random);
  sway.T_centre = facing_pose({0, 0, 0.35});
  sway.amplitude_m = {0.05, 0.05, 0.05};
  return with_sensor(random, "dvs128", sway, 2);
}

/// Out to 65 deg from the axis.
inline Situation fisheye(Random random) {
  auto sway = near_sway(random);
  sway.T_centre = facing_pose({0, 0, 0.4});
  sway.amplitude_m = {0.4, 0.2, 0.1};
  sway.frequency_hz = 0.9;
  const EquidistantDistortion lens{.k1 = -0.02, .k2 = 0.006, .k3 = -0.004, .k4 = 0.0006};
  return swaying(random, sway, 2, {{640, 480}, 270, 270, 319.5, 239.5, lens});
}

/// Moves of 0.4 s and rests of 0.05 to 2.5 s in random order, in noise.
inline Situation rests(Random random) {
  std::vector<double> rests{0.05, 0.25, 1, 2.5};
  for (std::size_t i = rests.size(); i > 1; --i) std::swap(rests[i - 1], rests[random.bits() % i]);
  std::vector<trajectory::MoveAndRest> legs;
  for (const double rest_s : rests) legs.push_back({0.4, rest_s});
  legs.push_back({0.4, 0});
  auto situation =
      one_marker(random, trajectory::stop_and_go(trajectory::handheld(near_sway(random)), std::move(legs)), 5.8);
  situation.simulator.noise_hz_per_px = 5;
  return situation;
}

/// Leaking pixels and noise, which are most of the events while the marker rests.
inline Situation leak(Random random) {
  auto situation = one_marker(random, trajectory::stop_and_go(trajectory::handheld(near_sway(random)), 0.4, 0.8), 2.8);
  situation.simulator.noise_hz_per_px = 2;
  situation.simulator.leak_hz_per_px = 3;
  return situation;
}

}  // namespace detail

/// All scenarios. The simulated sensor is the default one but for `dim` and those from `low_contrast` on; every marker
/// is 10 cm wide but for `several`.
inline std::vector<Scenario> scenarios() {
  std::vector<Scenario> all;
  const auto add = [&](const char* name, const char* title, double mm, double deg, double coverage,
                       Situation (*make)(Random)) {
    const auto stream = static_cast<std::uint64_t>(all.size());
    all.push_back({name, title, mm, deg, coverage,
                   [make, stream](std::uint64_t seed) { return make(Random(seed, 0xACC, stream)); }});
  };
  add("near", "hand-held, 0.5-0.7 m, 1100 px/s", 0.4, 0.3, 0.99, detail::near);
  add("fast", "near, 4000 px/s", 0.5, 0.25, 0.99, detail::fast);
  add("far", "1.25-1.75 m", 4, 1.2, 0.95, detail::far);
  add("dim", "near, 300 us pixels, 100 us jitter, 10 Hz/px noise", 0.8, 0.4, 0.99, detail::dim);
  add("tilt", "tilted up to 55 deg to both sides", 0.6, 0.5, 0.97, detail::tilt);
  add("occluded", "near, hidden for 200 ms by a passing board", 0.6, 0.5, 0.97, detail::occluded);
  add("clutter", "near, before a moving texture", 1, 0.5, 0.97, detail::clutter);
  add("several", "five markers of 6 cm", 1.5, 1, 0.95, detail::several);
  add("distorted", "Brown-Conrady k1 = -0.35, k2 = 0.12", 0.5, 0.3, 0.99, detail::distorted);
  add("hd", "near, 1280x720, f = 900 px", 0.4, 0.25, 0.99, detail::hd);
  add("slow", "0.15 Hz sway", 1, 1, 0.9, detail::slow);
  add("leaving", "out of the image and back", 0.6, 0.5, 0.97, detail::leaving);
  add("shaking", "12 Hz tremble on a slow sway", 0.6, 0.5, 0.97, detail::shaking);
  add("low_contrast", "near, grey on grey: 3 events a passage", 0.6, 0.4, 0.99, detail::low_contrast);
  add("uneven", "near, edges of different contrast: 2 to 9 events a passage", 0.5, 0.4, 0.99, detail::uneven);
  add("dim_sensor", "near, pixels as slow as they are dark: 0.35-3.75 ms", 1, 0.5, 0.97, detail::dim_sensor);
  add("refractory", "2000 px/s, pixels dead for 0.5 ms after an event", 1, 0.5, 0.97, detail::refractory);
  add("defocus", "near, out of focus: blur of 1.3 px", 0.4, 0.3, 0.99, detail::defocus);
  add("davis346", "346x260, f = 324 px, sensor like DAVIS346", 1, 0.6, 0.97, detail::davis346);
  add("dvs128", "128x128, f = 112 px, 0.3-0.4 m, sensor like DVS128", 2, 2, 0.95, detail::dvs128);
  add("fisheye", "fisheye lens, f = 270 px, out to 65 deg", 0.6, 0.5, 0.95, detail::fisheye);
  add("rests", "moves of 0.4 s, rests of 0.05-2.5 s, 5 Hz/px noise", 0.6, 0.5, 0.97, detail::rests);
  add("leak", "moves of 0.4 s, rests of 0.8 s, 3 Hz/px leak and 2 Hz/px noise", 0.6, 0.5, 0.97, detail::leak);
  return all;
}

}  // namespace evmarker::bench
