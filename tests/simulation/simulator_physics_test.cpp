// The simulated sensor against what physics says: edges, steps of light, leaks and lenses computed here by hand.
#include <doctest/doctest.h>

#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "simulation/moving_square.hpp"

using namespace evmarker;
using namespace evmarker::test;

namespace {

constexpr double kSigma = 0.6;

/// What an edge leaves at a pixel: events and their mean distance from it into the dark [px].
struct Passage {
  double events = 0, offset_px = 0;
};

/// Of the leading (right) and the trailing edge of `moving_right` over columns that they pass.
std::pair<Passage, Passage> passages(const std::vector<Event>& events, double px_per_s, int first, int last) {
  Passage leading, trailing;
  for (const Event& e : events) {
    if (e.y < 100 || e.y > 139 || e.x < first || e.x > last) continue;
    const double from_centre = e.x - centre_u(px_per_s, e.t);
    Passage& passage = from_centre > 0 ? leading : trailing;
    passage.events += 1;
    passage.offset_px += 40 - std::abs(from_centre);
  }
  for (Passage* passage : {&leading, &trailing}) {
    passage->offset_px /= passage->events;
    passage->events /= 40 * (last - first + 1);
  }
  return {leading, trailing};
}

/// Log intensity at a distance into the dark from a blurred edge.
double log_edge(double into_dark, double black, double white, double sigma) {
  return std::log(black + (white - black) * 0.5 * std::erfc(into_dark / sigma / std::sqrt(2.0)));
}

/// The distance into the dark at which that is `level`.
double place_of(double level, double black, double white, double sigma) {
  double bright = -20, dark = 20;
  for (int i = 0; i < 60; ++i)
    (log_edge((bright + dark) / 2, black, white, sigma) > level ? bright : dark) = (bright + dark) / 2;
  return bright;
}

}  // namespace

TEST_CASE("a pixel turns round from where it fired last: with few events ON and OFF lie apart") {
  // ln 3 in OFF steps of 0.26: four, down to -1.04. From there ON steps of 0.42 lead to -0.62 and -0.20 and no further.
  const double black = 0.2, white = 0.6, speed = 1600;
  const auto events = events_of({kCamera, moving_right(speed, black, white), ideal(0.42, 0.26)});
  const auto [off, on] = passages(events, speed, 130, 190);
  const auto place = [&](double below_white) { return place_of(std::log(white) + below_white, black, white, kSigma); };
  const double off_place = (place(-0.26) + place(-0.52) + place(-0.78) + place(-1.04)) / 4;
  const double on_place = (place(-0.62) + place(-0.20)) / 2;
  MESSAGE("OFF " << off.events << " at " << off.offset_px << " px, expected " << off_place << "; ON " << on.events
                 << " at " << on.offset_px << " px, expected " << on_place);
  CHECK(off.events == doctest::Approx(4).epsilon(0.001).scale(0));
  CHECK(on.events == doctest::Approx(2).epsilon(0.001).scale(0));
  CHECK(std::abs(off.offset_px - off_place) < 0.01);
  CHECK(std::abs(on.offset_px - on_place) < 0.01);
  CHECK(off_place - on_place > 0.3);  // else this test would say nothing about hysteresis
}

TEST_CASE("each edge makes events by its own contrast") {
  // Paper of 0.5 to the right of the ink and of 0.3 to its left: ln(0.5 / 0.08) / 0.25 = 7.3 steps down, from there
  // 4.96 up to 0.3.
  const double speed = 1600;
  Scene scene = moving_right(speed, 0.08, 0.5);
  CellShades shades = CellShades::Constant(5, 5, 0.5);
  shades.block(1, 1, 3, 3).setConstant(0.08);
  shades.col(0).setConstant(0.3);
  scene.markers.front().shades = shades;
  double off = 0, on = 0;
  for (const Event& e : events_of({kCamera, scene, ideal()})) {
    if (e.y < 100 || e.y > 139 || e.x < 130 || e.x > 190) continue;
    const double from_centre = e.x - centre_u(speed, e.t);
    off += std::abs(from_centre - 40) < 6;
    on += std::abs(from_centre + 40) < 6;
  }
  CHECK(off / (40 * 61) == doctest::Approx(7).epsilon(0.001).scale(0));
  CHECK(on / (40 * 61) == doctest::Approx(4).epsilon(0.001).scale(0));
}

TEST_CASE("out of focus the events of an edge lie further in the dark, as the wider edge says") {
  const double speed = 1600, black = 0.08, white = 0.85;
  for (const double sigma : {0.6, 1.3, 2.5}) {
    auto settings = ideal();
    settings.point_spread_px = sigma;
    const auto events = events_of({kCamera, moving_right(speed, black, white), settings});
    const auto [off, on] = passages(events, speed, 140, 180);
    double place = 0;  // 2.36 / 0.25: nine steps
    for (int k = 1; k <= 9; ++k) place += place_of(std::log(white) - 0.25 * k, black, white, sigma) / 9;
    MESSAGE("blur " << sigma << " px: OFF " << off.events << " at " << off.offset_px << " px, expected " << place);
    CHECK(off.events == doctest::Approx(9).epsilon(0.001).scale(0));
    CHECK(std::abs(off.offset_px - place) < 0.01);
  }
}

TEST_CASE("after its dead time a pixel starts from the brightness that it sees then") {
  const double speed = 1600, black = 0.08, white = 0.85, threshold = 0.25;
  auto settings = ideal();
  for (const double dead_us : {200.0, 500.0}) {
    settings.refractory_us = dead_us;
    const auto events = events_of({kCamera, moving_right(speed, black, white), settings});
    const auto [off, on] = passages(events, speed, 130, 190);
    // By hand: fire a threshold below what is memorised; a dead time deeper in the dark memorise anew.
    double count = 0, places = 0;
    for (double memory = std::log(white); memory - threshold > std::log(black); count += 1) {
      const double fires = place_of(memory - threshold, black, white, kSigma);
      places += fires;
      memory = log_edge(fires + dead_us * 1e-6 * speed, black, white, kSigma);
    }
    MESSAGE("dead for " << dead_us << " us: " << off.events << " events at " << off.offset_px << " px, expected "
                        << count << " at " << places / count);
    REQUIRE(count < 7);  // of nine
    CHECK(off.events == doctest::Approx(count).epsilon(0.001).scale(0));
    CHECK(std::abs(off.offset_px - places / count) < 0.02);
  }
}

TEST_CASE("a pixel follows a step of light as slowly as it is dark after it") {
  // A board of 0.1 before a background of 0.4, from 30 ms to 60 ms.
  const Scene scene{{},
                    {{.centre_px = [](double) { return Eigen::Vector2d(160, 120); },
                      .half_size_px = {30, 30},
                      .shade = 0.1,
                      .from_s = 0.03,
                      .until_s = 0.06}},
                    {.mean = 0.4}};
  for (const double fixed_us : {0.0, 150.0}) {
    auto settings = ideal();
    settings.light_time_constant_us = 100;
    settings.pixel_time_constant_us = fixed_us;
    settings.max_step_us = 2;  // so long the board takes to come and to go
    settings.duration_s = 0.07;
    std::map<std::pair<int, int>, std::vector<double>> darker, brighter;
    for (const Event& e : events_of({kCamera, scene, settings}))
      if (std::abs(e.x - 160) < 10 && std::abs(e.y - 120) < 10)
        (e.p > 0 ? brighter : darker)[{e.x, e.y}].push_back(static_cast<double>(e.t) - (e.p > 0 ? 60000 : 30000));
    // Down ln 4 in five steps of 0.25; up in four, as they begin at the last one of the way down, 0.136 from the dark.
    const auto largest_error = [&](const auto& pixels, double light, double first_step, std::size_t steps) {
      const double time_constant = fixed_us + 100 / light;
      double largest = 0;
      REQUIRE(pixels.size() == 19 * 19);
      for (const auto& [place, times] : pixels) {
        REQUIRE(times.size() == steps);
        for (std::size_t k = 0; k < steps; ++k) {
          const double share = (first_step + 0.25 * static_cast<double>(k)) / std::log(4.0);
          const double expected = -time_constant * std::log(1 - share);
          largest = std::max(largest, std::abs(times[k] - expected));
        }
      }
      return largest;
    };
    const double up = largest_error(brighter, 0.4, std::log(4.0) - 1.25 + 0.25, 4);
    const double down = largest_error(darker, 0.1, 0.25, 5);
    MESSAGE("errors of up to " << down << " us in " << fixed_us + 1000 << " us, " << up << " us in " << fixed_us + 250);
    CHECK(down < 4);
    CHECK(up < 4);
  }
}

TEST_CASE("at a passing edge the bandwidth goes with the light all the way") {
  // Eight steps each way; were ON and OFF alike, the last one up would be endlessly slow.
  const double speed = 1600, black = 0.08, white = 0.85, light_us = 200;
  auto settings = ideal(0.25, 0.27);
  settings.light_time_constant_us = light_us;
  const auto events = events_of({kCamera, moving_right(speed, black, white), settings});
  const auto [off, on] = passages(events, speed, 140, 180);
  // The low-pass by hand, in steps of 0.1 us: the leading edge brings the dark from -6 px on, the trailing one the
  // light.
  double level = std::log(white), memory = level, off_place = 0, on_place = 0;
  for (double d = -6; d < 80 + 6; d += 0.1e-6 * speed) {
    const double into_dark = d < 40 ? d : 80 - d, light = log_edge(into_dark, black, white, kSigma);
    level += (light - level) * 0.1 / (light_us * std::exp(-light));
    if (level < memory - 0.27) {
      memory -= 0.27;
      off_place += into_dark / 8;
    } else if (level > memory + 0.25) {
      memory += 0.25;
      on_place += into_dark / 8;
    }
  }
  MESSAGE("OFF at " << off.offset_px << " px, expected " << off_place << "; ON at " << on.offset_px << ", expected "
                    << on_place);
  CHECK(off.events == doctest::Approx(8).epsilon(0.001).scale(0));
  CHECK(on.events == doctest::Approx(8).epsilon(0.001).scale(0));
  CHECK(std::abs(off.offset_px - off_place) < 0.02);
  CHECK(std::abs(on.offset_px - on_place) < 0.02);
  CHECK(off_place > 2);  // else this test would say nothing about 2.5 ms on the ink
}

TEST_CASE("pixels at rest leak ON events, each at a rate of its own, all together at the rate that is set") {
  SimulatorSettings settings{
      .duration_s = 2, .noise_hz_per_px = 0, .leak_hz_per_px = 5, .leak_spread = 0.25};  // thresholds 0.25 +- 0.03
  const Scene scene{{}, {}, {.contrast = 0.5}};
  std::map<std::pair<int, int>, std::vector<Timestamp>> pixels;
  double count = 0;
  for (const Event& e : events_of({kCamera, scene, settings})) {
    REQUIRE(e.p == 1);
    pixels[{e.x, e.y}].push_back(e.t);
    count += 1;
  }
  // A pixel's rate goes with 1 / threshold: 1 + 0.12^2 + 3 * 0.12^4 on average.
  CHECK(count / (320 * 240 * 2) == doctest::Approx(5 * (1 + 0.0144 + 0.0006)).epsilon(0.01).scale(0));
  double sum = 0, squares = 0, measured = 0;
  Timestamp most_uneven = 0;
  for (const auto& [place, times] : pixels) {
    if (times.size() < 3) continue;
    const auto span = [&times = times](std::size_t i) { return times[i + 1] - times[i]; };
    for (std::size_t i = 1; i + 1 < times.size(); ++i) most_uneven = std::max(most_uneven, std::abs(span(i) - span(0)));
    const double log_period = std::log(static_cast<double>(span(0)));
    sum += log_period;
    squares += log_period * log_period;
    measured += 1;
  }
  REQUIRE(measured > 0.99 * 320 * 240);
  CHECK(most_uneven < 5);  // [us]
  const double mean = sum / measured;
  CHECK(std::sqrt(squares / measured - mean * mean) == doctest::Approx(std::hypot(0.25, 0.12)).epsilon(0.03).scale(0));
}

TEST_CASE("leaks and noise go on side by side, and each event of noise makes a leak begin anew") {
  SimulatorSettings settings{.duration_s = 1.5,
                             .threshold_mismatch = 0,
                             .refractory_us = 0,
                             .noise_hz_per_px = 4,
                             .leak_hz_per_px = 2,
                             .leak_spread = 0};
  double on = 0, off = 0;
  for (const Event& e : events_of({kCamera, Scene{}, settings}))
    if (e.t >= 500000) (e.p > 0 ? on : off) += 1;
  // A pixel leaks when noise leaves it alone for 0.5 s: of its events, 4 / (1 - exp(-2)) a second, the share exp(-2).
  const double leaks = 4 * std::exp(-2.0) / (1 - std::exp(-2.0));
  CHECK(off / (320 * 240) == doctest::Approx(2).epsilon(0.02).scale(0));
  CHECK(std::abs((on - off) / (320 * 240) - leaks) < 0.03);  // four standard deviations
}

namespace {

/// Mean distance [px], into the dark, of OFF events from the leading edge of a square far off the axis; `project` is
/// the lens by hand.
template <typename Project>
double offset_behind(const PinholeCamera& camera, Project&& project) {
  const double depth = 0.4, half = 0.05, speed = 0.3;
  const auto start = facing_pose({0.3, 0.02, depth});
  const Scene scene{
      {{.length = 2 * half, .bits = CodeBits::Zero(1, 1), .T_camera_marker = trajectory::linear(start, {speed, 0, 0})}},
      {},
      {.mean = 0.85}};
  double sum = 0, count = 0;
  for (const Event& e : events_of({camera, scene, ideal()})) {
    if (e.p > 0) continue;
    const double X = 0.3 + half + speed * static_cast<double>(e.t) * 1e-6;
    double low = 0.02 - half, high = 0.02 + half;  // the point of the edge in the event's row
    for (int i = 0; i < 40; ++i) (project(X, (low + high) / 2, depth).second < e.y ? low : high) = (low + high) / 2;
    const double Y = (low + high) / 2;
    if (std::abs(Y - 0.02) > 0.8 * half) continue;  // off the corners
    const auto [u, v] = project(X, Y, depth);
    if (std::abs(u - e.x) > 6) continue;  // that was another edge
    const auto [u2, v2] = project(X, Y + 1e-4, depth);
    const double slope = (u2 - u) / (v2 - v);
    sum += (u - e.x) / std::hypot(1, slope);
    count += 1;
  }
  REQUIRE(count > 1000);
  return sum / count;
}

}  // namespace

TEST_CASE("events lie where a lens, computed by hand, projects the edge") {
  double expected = 0;  // nine steps on the dark side, as without a lens
  for (int k = 1; k <= 9; ++k) expected += place_of(std::log(0.85) - 0.25 * k, 0.08, 0.85, kSigma) / 9;
  const double f = 180, cx = 159.5, cy = 119.5;

  const EquidistantDistortion fisheye{0.03, -0.01, 0.004, -0.0005};
  const double bent =
      offset_behind(PinholeCamera{{320, 240}, f, f, cx, cy, fisheye}, [&](double X, double Y, double Z) {
        const double r = std::hypot(X, Y), a = std::atan2(r, Z);
        const double image =
            a + 0.03 * std::pow(a, 3) - 0.01 * std::pow(a, 5) + 0.004 * std::pow(a, 7) - 0.0005 * std::pow(a, 9);
        return std::pair(f * image * X / r + cx, f * image * Y / r + cy);
      });
  MESSAGE("fisheye: " << bent << " px, expected " << expected);
  CHECK(std::abs(bent - expected) < 0.05);

  const BrownConradyDistortion radial{-0.25, 0.05, 0.002, -0.003, -0.002};
  const double tangential =
      offset_behind(PinholeCamera{{320, 240}, f, f, cx, cy, radial}, [&](double X, double Y, double Z) {
        const double x = X / Z, y = Y / Z, q = x * x + y * y;
        const double grown = 1 - 0.25 * q + 0.05 * q * q - 0.002 * q * q * q;
        return std::pair(f * (x * grown + 2 * 0.002 * x * y - 0.003 * (q + 2 * x * x)) + cx,
                         f * (y * grown + 0.002 * (q + 2 * y * y) - 2 * 0.003 * x * y) + cy);
      });
  MESSAGE("radial-tangential: " << tangential << " px");
  CHECK(std::abs(tangential - expected) < 0.05);
}
