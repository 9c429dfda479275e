#include "evmarker/search/start_pose_search.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "evmarker/io/csv_reader.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "real_data.hpp"
#include "search/sketch.hpp"

using namespace evmarker;
using namespace evmarker::test;
using simulated::Sketch;

namespace {

// Pushes events until it is over.
// @return the time that it took; -1 if it goes on
double run(StartPoseSearch& search, const std::vector<Event>& events, const Sketch& sketch) {
  for (const Event& event : events)
    if (search.push(event, sketch.pixel(event))) return static_cast<double>(event.t) * 1e-6;
  return -1;
}

void check_found(const std::string& what, const Sketch& sketch, double longest_s, double worst_px) {
  double slowest_s = 0, farthest_px = 0;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    CAPTURE(what);
    CAPTURE(seed);
    StartPoseSearch search = sketch.search_from(sketch.rough(seed));
    const double t = run(search, sketch.draw(seed), sketch);
    REQUIRE(search.state() == StartPoseSearch::State::found);
    CHECK(search.evidence() > search.needed_evidence());
    slowest_s = std::max(slowest_s, t - sketch.rest_s);
    farthest_px = std::max(farthest_px, sketch.error_px(search.T_found(), search.replay().t));
  }
  MESSAGE(what << ": found after " << 1e3 * slowest_s << " ms at most, " << farthest_px << " px off at most");
  CHECK(slowest_s < longest_s);
  CHECK(farthest_px < worst_px);
}

}  // namespace

TEST_CASE("a wireframe is found whatever its size, speed, sensor and noise") {
  const MarkerModel square = make_square_marker(simulated::kMarkerLength);
  check_found("90 px", {}, 0.003, 2.5);
  check_found("10000 px/s", {.speed_px_per_s = 10000, .duration_s = 0.003}, 0.0001, 2.5);
  check_found("2 px/s", {.speed_px_per_s = 2, .duration_s = 1, .per_px = 5, .noise_hz = 0.1}, 0.15, 2.5);
  check_found("half of the edges silent", {.direction_rad = 0.2}, 0.004, 2.5);
  const Eigen::Isometry3d far = facing_pose({0.1, 0, 1.78}, {0.2, 0.1, 0.2});
  check_found("30 px", {.model = square, .T = far}, 0.01, 2.5);
  check_found("30 px with a code", {.T = far}, 0.02, 2.5);
  // Smaller, it would gain evidence by shrinking into the events of its own cells.
  check_found("24 px with a code", {.T = facing_pose({0.1, 0, 2.2}, {0.1, 0.05, 0.2}), .speed_px_per_s = 30}, 0.02,
              2.5);
  check_found("half of it outside of the image", {.T = facing_pose({0.36, 0, 0.6}, {0.2, 0.1, 0.2})}, 0.006, 4);
  const PinholeCamera wide({1280, 720}, 1066, 1066, 639.5, 359.5);
  check_found("530 px", {.camera = wide, .T = facing_pose({0, 0, 0.2}, {0.2, 0.1, 0.2}), .duration_s = 0.01}, 0.002, 9);
}

TEST_CASE("a wireframe that moves by 2 px/s is found among 20 Hz of noise in every pixel") {
  for (const double noise_hz : {10.0, 20.0}) {
    const PinholeCamera small({240, 240}, 533, 533, 119.5, 119.5);
    check_found("2 px/s and noise", {.camera = small, .speed_px_per_s = 2, .duration_s = 1, .noise_hz = noise_hz}, 0.5,
                2.5);
  }
}

TEST_CASE("noise neither looks like the wireframe nor spends the chance to find it") {
  for (const double noise_hz : {1.0, 20.0}) {
    CAPTURE(noise_hz);
    const PinholeCamera small({240, 240}, 533, 533, 119.5, 119.5);
    const Sketch sketch{.camera = small, .duration_s = 0.2, .noise_hz = noise_hz, .rest_s = noise_hz > 10 ? 1.0 : 5.0};
    StartPoseSearch search = sketch.search_from(sketch.rough(1));
    double best = -1e9;
    for (const Event& event : sketch.draw(1)) {
      const int before = search.attempts();
      const bool over = search.push(event, sketch.pixel(event));
      const double t = static_cast<double>(event.t) * 1e-6;
      if (t < sketch.rest_s) {
        REQUIRE(!over);
        if (search.attempts() > before) best = std::max(best, search.evidence());
      }
      if (!over) continue;
      MESSAGE("best of noise " << best << " nats in " << before << " searches, found " << 1e3 * (t - sketch.rest_s)
                               << " ms after it moved");
      CHECK(before > 20);
      CHECK(best < 0);  // far from the 22 nats of a false alarm in a million
      CHECK(t < sketch.rest_s + 0.02);
      CHECK(sketch.error_px(search.T_found(), search.replay().t) < 2.5);
      break;
    }
    CHECK(search.state() == StartPoseSearch::State::found);
  }
}

TEST_CASE("no event takes more than a bounded number of look-ups, and noise not more than so many in a second") {
  const PinholeCamera wide({1280, 720}, 1066, 1066, 639.5, 359.5);
  for (const double z : {0.2, 0.6, 3.0}) {
    CAPTURE(z);
    const Sketch sketch{.camera = wide, .T = facing_pose({0, 0, z}), .duration_s = 0.05, .per_px = 0};
    StartPoseSearch search = sketch.search_from(sketch.T);
    std::uint64_t most = 0;
    for (const Event& event : sketch.draw(2)) {
      const std::uint64_t before = search.look_ups();
      search.push(event, sketch.pixel(event));
      most = std::max(most, search.look_ups() - before);
    }
    if (z < 1) CHECK(search.attempts() > 0);  // or nothing was bounded
    CHECK(most <= StartPoseSearch::kMostLookUps);
    CHECK(search.look_ups() < 2e7 + 0.05 * 500e6 + 8e6);  // what is saved up, in 50 ms, a last search
  }
}

TEST_CASE("a search goes on without end, or as long as it is told to") {
  const Sketch sketch{.duration_s = 0.3, .per_px = 0};
  const auto events = sketch.draw(3);
  StartPoseSearch endless = sketch.search_from(sketch.T);
  CHECK(run(endless, events, sketch) == -1);
  CHECK(endless.searching());
  StartPoseSearch ended = sketch.search_from(sketch.T, {.longest = std::chrono::milliseconds(200)});
  CHECK(run(ended, events, sketch) == doctest::Approx(0.2).epsilon(0.01).scale(0));
  CHECK(ended.state() == StartPoseSearch::State::given_up);
  CHECK_FALSE(ended.replaying());  // there is no pose from which to replay

  auto set_back = events;  // by an hour, after 0.1 s
  for (Event& event : set_back)
    if (event.t >= 100'000) event.t -= 3'600'000'000;
  StartPoseSearch of_new_clock = sketch.search_from(sketch.T, {.longest = std::chrono::milliseconds(200)});
  CHECK(run(of_new_clock, set_back, sketch) == doctest::Approx(0.2 - 3600).epsilon(1e-5).scale(0));
}

TEST_CASE("a search starts again around another pose, as far as is said") {
  const Sketch sketch{.duration_s = 0.05};
  const auto events = sketch.draw(4);
  Eigen::Isometry3d away = sketch.T;
  away.translation() += Eigen::Vector3d(0.056, 0, 0);  // 50 px
  away.linear() = so3_exp({0, 0, 0.3}) * away.linear();
  StartPoseSearch search = sketch.search_from(away);
  run(search, events, sketch);
  const bool found = search.state() == StartPoseSearch::State::found;
  CHECK_FALSE((found && sketch.error_px(search.T_found(), search.replay().t) < 10));  // or it was not too far
  search.restart(away, {.sideways_px = 60, .depth_share = 0.1, .rotation_rad = 0.4});
  REQUIRE(search.searching());
  CHECK(run(search, events, sketch) > 0);
  CHECK(sketch.error_px(search.T_found(), search.replay().t) < 2.5);
}

TEST_CASE("a wireframe that is not to be seen is searched in vain, and in bounded steps") {
  Sketch sketch{.duration_s = 0.05};
  sketch.T.linear() = so3_exp({3, 0, 0}) * sketch.T.linear();  // its back
  StartPoseSearch search = sketch.search_from(sketch.T);
  CHECK(run(search, sketch.draw(5), sketch) == -1);
  CHECK(search.attempts() > 0);
  CHECK(search.evidence() == 0);
}

// --- Real recordings -------------------------------------------------------------------------------------------------

namespace {

std::vector<std::vector<double>> read_table(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(file, line);) {
    std::ranges::replace(line, ',', ' ');
    std::istringstream text(line);
    std::vector<double> row;
    for (double value = 0; text >> value;) row.push_back(value);
    if (row.size() > 4) rows.push_back(row);
  }
  return rows;
}

std::vector<Event> read_events(const std::filesystem::path& path) {
  io::CsvReader reader(path, {.sensor_size = SensorSize{128, 128}});
  std::vector<Event> events;
  for_each_event(reader, [&](const Event& event) { events.push_back(event); });
  return events;
}

struct Start {
  double t_us;
  Eigen::Isometry3d T;
};

// Starts a search at each of these poses, with the events as they come from the sensor.
// @return how many of them were found within a second, and after which time in the middle [s]
template <typename Camera>
std::pair<int, double> found_from(const Camera& camera, const MarkerModel& model, const std::vector<Start>& starts,
                                  const std::vector<Event>& events) {
  const UndistortionTable lines(camera);
  const double f = lines.focal_length();
  std::vector<double> times;
  for (const Start& start : starts) {
    StartPoseSearch search(model, f, Box{f * lines.image().low, f * lines.image().high}, start.T, {});
    for (auto event = std::ranges::lower_bound(events, static_cast<Timestamp>(start.t_us), {}, &Event::t);
         event != events.end() && search.searching() && static_cast<double>(event->t) < start.t_us + 1e6; ++event)
      if (search.push(*event, f * lines(*event))) times.push_back((static_cast<double>(event->t) - start.t_us) * 1e-6);
  }
  if (times.empty()) return {0, 1};
  std::ranges::sort(times);
  return {static_cast<int>(times.size()), times[times.size() / 2]};
}

}  // namespace

TEST_CASE("the real pyramid and the real flip are found within some tens of milliseconds") {
  if (missing(kData / "pyramid") || missing(kData / "flip")) return;
  std::vector<Start> starts;
  for (const auto& row : read_table(kData / "pyramid/reference.csv")) {
    if (row.size() != 11 || !(row[8] > 0.6 && row[10] < 100)) continue;
    if (!starts.empty() && row[0] < starts.back().t_us + 5e5) continue;
    Start start{row[0], Eigen::Isometry3d::Identity()};
    start.T.translation() << row[1], row[2], row[3];
    start.T.linear() = Eigen::Quaterniond(row[7], row[4], row[5], row[6]).normalized().toRotationMatrix();
    starts.push_back(start);
  }
  REQUIRE(starts.size() > 20);
  const MarkerModel pyramid{
      {{0, 0, 0}, {0.114893, 0, -0.041032}, {-0.057447, 0.0995, -0.041032}, {-0.057447, -0.0995, -0.041032}},
      {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {2, 3}, {3, 1}}};
  const BrownConradyDistortion lens{-0.3692, 0.1812, 0.0022, 0.0003, 0.0116};
  const auto [pyramids, pyramid_s] = found_from(PinholeCamera({128, 128}, 151, 151, 64, 64, lens), pyramid, starts,
                                                read_events(kData / "pyramid/events.csv"));
  MESSAGE("pyramid: found from " << pyramids << " of " << starts.size() << ", median " << 1e3 * pyramid_s << " ms");
  CHECK(pyramids + 1 >= static_cast<int>(starts.size()));  // at one of them nothing moves for a second
  CHECK(pyramid_s < 0.05);

  starts.clear();
  for (const auto& row : read_table(kData / "flip/square_fit.csv")) {  // see flip_test.cpp
    if (row[0] < 1e5 || row[0] > 1.8e6 || (!starts.empty() && row[0] < starts.back().t_us + 1e5)) continue;
    const double depth = 100 * 0.3 / row[3];
    starts.push_back(
        {row[0], facing_pose({(row[1] - 63.5) / 100 * depth, (row[2] - 63.5) / 100 * depth, depth}, {0, 0, row[4]})});
  }
  REQUIRE(starts.size() > 10);
  const auto [flips, flip_s] = found_from(PinholeCamera({128, 128}, 100, 100, 63.5, 63.5), make_square_marker(0.3),
                                          starts, read_events(kData / "flip/events.csv"));
  MESSAGE("flip: found from " << flips << " of " << starts.size() << ", median " << 1e3 * flip_s << " ms");
  CHECK(flips == static_cast<int>(starts.size()));
  CHECK(flip_s < 0.03);
}
