#include "evmarker/simulation/simulator.hpp"

#include <doctest/doctest.h>

#include <map>
#include <set>

#include "message_of.hpp"
#include "simulation/moving_square.hpp"

using namespace evmarker;
using namespace evmarker::test;

static_assert(EventSource<Simulator>);

namespace {

CodeBits code() {
  CodeBits bits(4, 4);
  bits << 1, 0, 1, 1, 0, 1, 0, 0, 0, 0, 1, 1, 1, 0, 0, 1;
  return bits;
}

bool sorted_and_on_sensor(const std::vector<Event>& events, const SimulatorSettings& settings = {}) {
  Timestamp last = 0;
  for (const Event& e : events) {
    if (e.t < last || static_cast<double>(e.t) >= settings.duration_s * 1e6 ||
        !kCamera.sensor_size().contains(e.x, e.y))
      return false;
    last = e.t;
  }
  return true;
}

/// Mean distance of the events from the leading (right) and the trailing edge of `moving_right`, into the dark [px].
struct Offsets {
  double leading = 0, trailing = 0;
  int leading_count = 0, trailing_count = 0;
};

Offsets dark_side_offsets(double px_per_s, const SimulatorSettings& settings) {
  Offsets offsets;
  for (const Event& e : events_of({kCamera, moving_right(px_per_s), settings})) {
    if (e.y < 100 || e.y > 139 || e.t < 10000 || e.t > 90000) continue;  // away from the corners and the start
    const double from_centre = e.x - centre_u(px_per_s, e.t);
    if (from_centre > 0) {
      offsets.leading += 40 - from_centre;
      ++offsets.leading_count;
    } else {
      offsets.trailing += 40 + from_centre;
      ++offsets.trailing_count;
    }
  }
  offsets.leading /= offsets.leading_count;
  offsets.trailing /= offsets.trailing_count;
  return offsets;
}

/// Where a pixel fires as it gets darker (or brighter): the places at which the logarithm of a blurred edge has gone
/// through 1, 2, ... thresholds. Positive into the dark.
double expected_offset(bool gets_darker, double threshold, double sigma) {
  const auto log_intensity = [&](double into_dark) {
    return std::log(kBlack + (kWhite - kBlack) * 0.5 * std::erfc(into_dark / sigma / std::sqrt(2.0)));
  };
  double sum = 0;
  int count = 0;
  for (int k = 1; k * threshold < std::log(kWhite / kBlack); ++k, ++count) {
    const double level = gets_darker ? std::log(kWhite) - k * threshold : std::log(kBlack) + k * threshold;
    double bright = -10, dark = 10;
    for (int i = 0; i < 60; ++i) (log_intensity((bright + dark) / 2) > level ? bright : dark) = (bright + dark) / 2;
    sum += bright;
  }
  return sum / count;
}

}  // namespace

TEST_CASE("a moving edge makes contrast over threshold events at each pixel that it sweeps, of the right polarity") {
  const double speed = 500;
  const auto events = events_of({kCamera, moving_right(speed), ideal()});
  REQUIRE(events.size() > 1000);
  CHECK(sorted_and_on_sensor(events));
  std::size_t off = 0, on = 0, wrong = 0;
  for (const Event& e : events) {
    if (e.y < 90 || e.y >= 150) continue;
    const bool in_front = e.x > centre_u(speed, e.t);
    (e.p > 0 ? on : off) += 1;
    wrong += in_front != (e.p == 0);
  }
  // 50 px are swept in 60 rows, 9 thresholds of 0.25 in a contrast of ln(0.85 / 0.08) = 2.36; the first and the last
  // two pixels are swept in part.
  CHECK(off > 46 * 60 * 9);
  CHECK(off < 52 * 60 * 9);
  CHECK(on > 46 * 60 * 9);
  CHECK(on < 52 * 60 * 9);
  CHECK(wrong == 0);
}

TEST_CASE("the thresholds set the number of events of each polarity") {
  auto settings = ideal();
  settings.contrast_threshold_on = 0.5;   // 4 in a contrast of 2.36
  settings.contrast_threshold_off = 0.2;  // 11
  std::size_t on = 0, off = 0;
  for (const Event& e : events_of({kCamera, moving_right(500), settings}))
    if (e.y >= 90 && e.y < 150) (e.p > 0 ? on : off) += 1;
  CHECK(static_cast<double>(on) == doctest::Approx(50 * 60 * 4).epsilon(0.05).scale(0));
  CHECK(static_cast<double>(off) == doctest::Approx(50 * 60 * 11).epsilon(0.05).scale(0));
}

TEST_CASE("events lie on the dark side of their edge, as far as the logarithm of a blurred edge says") {
  const auto offsets = dark_side_offsets(500, ideal());
  REQUIRE(offsets.leading_count > 10000);
  REQUIRE(offsets.trailing_count > 10000);
  MESSAGE("ideal pixels: leading " << offsets.leading << " px, trailing " << offsets.trailing << " px; expected "
                                   << expected_offset(true, 0.25, 0.6) << " and " << expected_offset(false, 0.25, 0.6));
  CHECK(offsets.leading == doctest::Approx(expected_offset(true, 0.25, 0.6)).epsilon(0.03).scale(0));
  CHECK(offsets.trailing == doctest::Approx(expected_offset(false, 0.25, 0.6)).epsilon(0.03).scale(0));
}

TEST_CASE("with the default pixels the mean event is within a pixel of its edge, on the dark side") {
  SimulatorSettings settings{.duration_s = 0.1, .noise_hz_per_px = 0};
  const auto offsets = dark_side_offsets(500, settings);
  REQUIRE(offsets.leading_count > 10000);
  const double mean = (offsets.leading + offsets.trailing) / 2;
  MESSAGE("default pixels: leading " << offsets.leading << " px, trailing " << offsets.trailing << " px, mean "
                                     << mean);
  // Mismatch averages out and 50 us are 0.025 px: the ideal pixel's offset, nearly.
  const double expected = (expected_offset(true, 0.25, 0.6) + expected_offset(false, 0.25, 0.6)) / 2;
  CHECK(std::abs(mean - expected) < 0.03);
  CHECK(mean > 0.3);
  CHECK(mean < 1);
}

TEST_CASE("a low-pass makes events late by about its time constant") {
  auto settings = ideal();
  const auto fast = dark_side_offsets(500, settings);
  settings.pixel_time_constant_us = 300;
  const auto slow = dark_side_offsets(500, settings);
  REQUIRE(slow.leading_count > 10000);
  MESSAGE("300 us: leading " << slow.leading << " px, trailing " << slow.trailing << " px");
  // A response is late by exactly its time constant on a ramp; 500 px/s and 300 us are 0.15 px. A late event is deeper
  // in the dark behind the leading edge, and less deep behind the trailing one.
  CHECK(slow.leading - fast.leading == doctest::Approx(0.15).epsilon(0.35).scale(0));
  CHECK(slow.trailing - fast.trailing == doctest::Approx(-0.15).epsilon(0.35).scale(0));
}

TEST_CASE("time steps are fine enough") {
  auto settings = ideal();
  const auto normal = dark_side_offsets(1000, settings);
  settings.max_step_px /= 2;
  const auto half = dark_side_offsets(1000, settings);
  REQUIRE(half.leading_count > 10000);
  CHECK(std::abs(normal.leading - half.leading) < 0.02);
  CHECK(std::abs(normal.trailing - half.trailing) < 0.02);
  CHECK(std::abs(normal.leading_count - half.leading_count) < half.leading_count / 100);
}

TEST_CASE("a scene at rest makes noise only, at the set rate and of both polarities alike") {
  Scene scene{{dark_square(trajectory::still(facing_pose({0, 0, kDepth})))}, {}, {.contrast = 0.5}};
  SimulatorSettings settings{.duration_s = 0.5, .noise_hz_per_px = 0};
  CHECK(events_of({kCamera, scene, settings}).empty());

  settings.noise_hz_per_px = 5;
  const auto events = events_of({kCamera, scene, settings});
  CHECK(sorted_and_on_sensor(events, settings));
  const double expected = 320 * 240 * 5 * 0.5, deviation = std::sqrt(expected);
  CHECK(std::abs(static_cast<double>(events.size()) - expected) < 4 * deviation);
  double on = 0;
  std::set<std::pair<int, int>> places;
  for (const Event& e : events) {
    on += e.p;
    places.insert({e.x, e.y});
  }
  CHECK(std::abs(on - expected / 2) < 4 * deviation);
  CHECK(static_cast<double>(places.size()) ==
        doctest::Approx(320 * 240 * (1 - std::exp(-2.5))).epsilon(0.01).scale(0));  // Poisson: share of pixels with any
}

TEST_CASE("a pixel is dead for the refractory time, whatever makes it fire") {
  SimulatorSettings settings{.duration_s = 0.05,
                             .contrast_threshold_on = 0.1,
                             .contrast_threshold_off = 0.1,
                             .refractory_us = 200,
                             .noise_hz_per_px = 200};
  for (const double jitter : {0.0, 100.0}) {
    settings.latency_jitter_us = jitter;
    std::map<std::pair<int, int>, Timestamp> last;
    Timestamp shortest = 1000000;
    const auto events = events_of({kCamera, moving_right(1500), settings});
    REQUIRE(events.size() > 10000);
    CHECK(sorted_and_on_sensor(events, settings));
    for (const Event& e : events) {
      const auto [place, first] = last.try_emplace({e.x, e.y}, e.t);
      if (!first) shortest = std::min(shortest, e.t - place->second);
      place->second = e.t;
    }
    CHECK(shortest >= 200);
    CHECK(shortest < 210);  // and not much longer
  }
}

TEST_CASE("latency makes events late by its mean, and the stream stays sorted") {
  auto settings = ideal();
  const double speed = 500;
  const auto prompt = dark_side_offsets(speed, settings);
  settings.latency_jitter_us = 400;
  settings.contrast_threshold_on = settings.contrast_threshold_off = 2;  // one event an edge: none waits for another
  CHECK(sorted_and_on_sensor(events_of({kCamera, moving_right(speed), settings}), settings));
  const auto late = dark_side_offsets(speed, settings);
  settings.latency_jitter_us = 0;
  const auto early = dark_side_offsets(speed, settings);
  REQUIRE(late.leading_count > 1000);
  CHECK(prompt.leading_count > late.leading_count);
  CHECK(late.leading - early.leading == doctest::Approx(400e-6 * speed).epsilon(0.1).scale(0));
  CHECK(late.trailing - early.trailing == doctest::Approx(-400e-6 * speed).epsilon(0.1).scale(0));
}

TEST_CASE("the same seed gives the same events, another one others") {
  const Scene scene{{{.id = 3, .bits = code(), .T_camera_marker = trajectory::handheld({.frequency_hz = 2})}},
                    {},
                    {.contrast = 0.4, .velocity_px_per_s = {30, 10}}};
  SimulatorSettings settings{.duration_s = 0.05, .pixel_time_constant_us = 100, .latency_jitter_us = 30};
  const auto once = events_of({kCamera, scene, settings});
  REQUIRE(once.size() > 1000);
  CHECK(sorted_and_on_sensor(once, settings));
  CHECK(once == events_of({kCamera, scene, settings}));
  settings.seed = 2;
  CHECK(once != events_of({kCamera, scene, settings}));
}

TEST_CASE("a copy goes on where the original is") {
  Simulator original{kCamera, moving_right(500), {.duration_s = 0.05}};
  original.next_batch();
  const Timestamp now = original.now();
  CHECK(now > 0);
  CHECK(now < 50000);
  Simulator copy = original;
  const auto rest = events_of(original);
  REQUIRE(rest.size() > 100);
  CHECK(rest == events_of(copy));
}

TEST_CASE("with a distorting lens events lie on the distorted edges") {
  const Distortion lens = BrownConradyDistortion{-0.35, 0.1, 0.001, -0.001, 0};
  const PinholeCamera camera{{320, 240}, 250, 250, 159.5, 119.5, lens}, straight{{320, 240}, 250, 250, 159.5, 119.5};
  const auto start = facing_pose({0.17, 0.11, 0.5}, {0.3, -0.2, 0.1});  // towards the corner of the image
  auto settings = ideal();
  settings.duration_s = 0.2;
  Simulator simulator(camera,
                      {{{.length = 0.1,
                         .bits = code(),
                         .T_camera_marker = trajectory::linear(start, {-0.1, 0.02, 0}, {0, 0, 0.6}),
                         .white = kWhite}},
                       {},
                       {.mean = kWhite}},
                      settings);
  const auto model = make_code_marker(0.1, code());
  const auto distance = [&](const PinholeCamera& lens_model, const Event& e, const Eigen::Isometry3d& T) {
    double nearest = 1e9;
    for (const auto& segment : model.segments)
      for (int i = 0; i <= 40; ++i) {  // points less than 1 px apart
        const auto index = [](int v) { return static_cast<std::size_t>(v); };
        const Eigen::Vector3d from = model.vertices[index(segment.from)], to = model.vertices[index(segment.to)];
        nearest = std::min(
            nearest, (lens_model.project(T * (from + (to - from) * (i / 40.0))) - Eigen::Vector2d(e.x, e.y)).norm());
      }
    return nearest;
  };
  double with_lens = 0, without = 0, within_2 = 0;
  int count = 0, index = 0;
  for_each_event(simulator, [&](const Event& e) {
    if (index++ % 20 != 0) return;
    const auto T = simulator.T_camera_marker(0, e.t);
    with_lens += distance(camera, e, T);
    without += distance(straight, e, T);
    within_2 += distance(camera, e, T) < 2.1;
    ++count;
  });
  REQUIRE(count > 300);
  MESSAGE("mean distance from the distorted edges " << with_lens / count << " px, from straight ones "
                                                    << without / count);
  CHECK(with_lens / count < 1);
  CHECK(within_2 / count > 0.98);
  CHECK(without / count > 2 * with_lens / count);  // else this test would say nothing about the lens
}

TEST_CASE("an occluder hides what is behind it and makes events where it moves itself") {
  auto scene = moving_right(500);
  scene.occluders.push_back({.centre_px = [](double) { return Eigen::Vector2d(200, 120); }, .half_size_px = {30, 60}});
  const auto inside = [](const Event& e) { return std::abs(e.x - 200) < 27 && std::abs(e.y - 120) < 57; };
  const auto count = [&](const Scene& s, bool within) {
    const auto events = events_of({kCamera, s, ideal()});
    return std::count_if(events.begin(), events.end(), [&](const Event& e) { return inside(e) == within; });
  };
  CHECK(count(moving_right(500), true) > 1000);
  CHECK(count(scene, true) == 0);
  CHECK(count(scene, false) > 1000);

  Scene only{{}, {{.centre_px = [](double s) { return Eigen::Vector2d(100 + 500 * s, 120); }}}, {}};
  const auto events = events_of({kCamera, only, ideal()});
  CHECK(events.size() > 1000);
}

TEST_CASE("an occluder is there only between its times") {
  const auto centre = [](double) { return Eigen::Vector2d(160, 120); };
  const Scene scene{
      {}, {{.centre_px = centre, .half_size_px = {20, 20}, .shade = 0.1, .from_s = 0.03, .until_s = 0.06}}, {}};
  const auto events = events_of({kCamera, scene, ideal()});
  REQUIRE(events.size() > 1000);
  for (const Event& e : events) {
    const Timestamp change = e.p > 0 ? 60000 : 30000;  // dark comes, dark goes
    CHECK(std::abs(e.t - change) <= 1000);
  }
}

TEST_CASE("a texture makes events when it moves, and only then") {
  Scene scene{{}, {}, {.contrast = 0.8, .texture_size_px = 8}};
  CHECK(events_of({kCamera, scene, ideal()}).empty());
  scene.background.velocity_px_per_s = {200, 0};
  const auto events = events_of({kCamera, scene, ideal()});
  CHECK(events.size() > 10000);
  CHECK(sorted_and_on_sensor(events));
}

TEST_CASE("a marker that flies through the camera is survived") {
  const auto start = facing_pose({0.01, 0.02, 0.1}, {0.7, 0.2, 0});
  Simulator simulator(
      kCamera, {{.length = 0.1, .bits = code(), .T_camera_marker = trajectory::linear(start, {0, 0, -4}, {8, 0, 0})}},
      {.duration_s = 0.05, .noise_hz_per_px = 10});
  const auto events = events_of(simulator);
  CHECK(events.size() > 10000);  // it is seen at first
  Timestamp last = 0;
  for (const Event& e : events) last = e.t;
  CHECK(last > 45000);  // and noise goes on after it
}

TEST_CASE("a pose that is not finite hides the marker") {
  const auto vanishing = [](double s) { return facing_pose({0.1 * s, 0, s < 0.02 ? kDepth : std::nan("")}); };
  const auto events = events_of({kCamera, {dark_square(vanishing)}, ideal()});
  CHECK(events.size() > 100);
  for (const Event& e : events) CHECK(e.t < 22000);
}

TEST_CASE("truth, speed and picture come with the events") {
  const double speed = 500;
  Simulator simulator(kCamera, moving_right(speed), ideal());
  while (!simulator.next_batch().empty()) {
  }
  CHECK(simulator.now() == 100000);
  CHECK(simulator.peak_speed_px_per_s() == doctest::Approx(speed).epsilon(0.01).scale(0));
  const auto T = simulator.T_camera_marker(0, 70000);
  CHECK(kCamera.project(T.translation()).x() == doctest::Approx(centre_u(speed, 70000)));
  CHECK_THROWS_AS(simulator.T_camera_marker(1, 0), std::out_of_range);
  const auto image = simulator.render(70000);
  REQUIRE(image.size() == 320 * 240);
  const auto at = [&](double u) { return image[119 * 320 + static_cast<std::size_t>(u)]; };
  CHECK(at(centre_u(speed, 70000)) == doctest::Approx(kBlack));
  CHECK(at(centre_u(speed, 70000) + 50) == doctest::Approx(kWhite));
}

TEST_CASE("settings that make no sense are named") {
  const auto message = [](const SimulatorSettings& settings) {
    return message_of([&] { Simulator(kCamera, Scene{}, settings); });
  };
  CHECK(message({.duration_s = -1}) == "simulator: duration_s is -1");
  CHECK(message({.contrast_threshold_on = 0}) == "simulator: contrast_threshold_on is 0");
  CHECK(message({.contrast_threshold_off = std::nan("")}) == "simulator: contrast_threshold_off is nan");
  CHECK(message({.noise_hz_per_px = -2}).find("noise_hz_per_px is -2") != std::string::npos);
  CHECK(message({.light_time_constant_us = -1}) == "simulator: light_time_constant_us is -1");
  CHECK(message({.leak_hz_per_px = std::nan("")}) == "simulator: leak_hz_per_px is nan");
  CHECK(message({.leak_spread = -0.1}) == "simulator: leak_spread is -0.1");
  CHECK(message({.max_step_px = 0}).find("max_step_px is 0") != std::string::npos);
  CHECK(message({.point_spread_px = 0}).find("point_spread_px is 0") != std::string::npos);
  CHECK(message_of([] {
          auto marker = dark_square(trajectory::still(facing_pose({0, 0, 1})));
          marker.length = -0.1;
          Simulator(kCamera, {marker});
        }).find("length is -0.1") != std::string::npos);
  CHECK(message({}) == "nothing thrown");
}
