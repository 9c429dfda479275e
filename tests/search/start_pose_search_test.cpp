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

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/io/csv_reader.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "simulated.hpp"

using namespace evmarker;

namespace {

const MarkerModel kModel = make_code_marker(simulated::kMarkerLength, simulated::code());

// Off by so much to one side, in depth and about some axis.
Eigen::Isometry3d off(Eigen::Isometry3d T, std::mt19937& random, double sideways_m, double depth_m, double angle_deg) {
  std::normal_distribution<double> normal;
  const double direction = std::uniform_real_distribution<double>(0, 2 * std::numbers::pi)(random);
  T.translation() += Eigen::Vector3d(sideways_m * std::cos(direction), sideways_m * std::sin(direction), depth_m);
  const Eigen::Vector3d axis = Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
  T.linear() = so3_exp(angle_deg / 180 * std::numbers::pi * axis) * T.linear();
  return T;
}

// Events of edges that move and of noise, drawn without the simulator: `per_px` for every pixel that an edge sweeps,
// spread by 0.6 px.
struct Sketch {
  PinholeCamera camera = simulated::camera;
  MarkerModel model = kModel;
  Eigen::Isometry3d T = facing_pose({0, 0, 0.6}, {0.2, 0.1, 0.2});
  double speed_px_per_s = 100, direction_rad = 0.7, duration_s = 0.1, per_px = 9, noise_hz = 1;
  double rest_s = 0;  // before it moves

  double focal_length() const { return camera.focal_length(); }
  Eigen::Isometry3d pose(double t) const {
    Eigen::Isometry3d moved = T;
    const double way = speed_px_per_s * T.translation().z() / focal_length() * std::max(0.0, t - rest_s);
    moved.translation() += way * Eigen::Vector3d(std::cos(direction_rad), std::sin(direction_rad), 0);
    return moved;
  }
  Eigen::Vector2d centre() const {
    return {(camera.sensor_size().width - 1) / 2.0, (camera.sensor_size().height - 1) / 2.0};
  }
  Eigen::Vector2d pixel(const Event& event) const { return Eigen::Vector2d(event.x, event.y) - centre(); }

  std::vector<Event> draw(unsigned seed) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> share;
    std::vector<Event> events;
    const SensorSize size = camera.sensor_size();
    const double step_s = std::min(1e-3, 0.1 / speed_px_per_s);
    const auto add = [&](const Eigen::Vector2d& u, double t) {
      const int x = static_cast<int>(std::lround(u.x())), y = static_cast<int>(std::lround(u.y()));
      if (size.contains(x, y))
        events.push_back({static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1,
                          static_cast<Timestamp>((t + step_s * share(random)) * 1e6)});
    };
    const auto count = [&](double mean) { return mean > 0 ? std::poisson_distribution<int>(mean)(random) : 0; };
    for (double t = 0; t < rest_s + duration_s; t += step_s) {
      const Eigen::Isometry3d from = pose(t), to = pose(t + step_s);
      for (const MarkerSegment& edge : model.segments) {
        const auto image = [&](const Eigen::Isometry3d& at, int vertex) -> Eigen::Vector2d {
          const Eigen::Vector3d P = at * model.vertices[static_cast<std::size_t>(vertex)];
          return focal_length() / P.z() * P.head<2>() + centre();
        };
        const Eigen::Vector2d a = image(from, edge.from), along = image(from, edge.to) - a;
        const Eigen::Vector2d normal_of_edge = Eigen::Vector2d(-along.y(), along.x()).normalized();
        const double swept = along.norm() * std::abs(normal_of_edge.dot(image(to, edge.from) - a));
        for (int i = count(per_px * swept); i > 0; --i)
          add(a + share(random) * along + 0.6 * normal(random) * normal_of_edge, t);
      }
      for (int i = count(noise_hz * step_s * size.width * size.height); i > 0; --i)
        add({share(random) * size.width - 0.5, share(random) * size.height - 0.5}, t);
    }
    std::ranges::sort(events, {}, &Event::t);
    return events;
  }

  StartPoseSearch search_from(const Eigen::Isometry3d& T_rough, const StartPoseSearchSettings& settings = {}) const {
    return {model, focal_length(), Box{-centre(), centre()}, T_rough, settings};
  }

  // Off by two thirds of what is within reach, this way or that; in depth along its line of sight.
  Eigen::Isometry3d rough(unsigned seed) const {
    std::mt19937 random(seed);
    const double length = (model.vertices[0] - model.vertices[1]).norm();
    Eigen::Isometry3d rough = T;
    rough.translation() *= seed % 2 == 0 ? 1.065 : 0.935;
    return off(rough, random, 0.12 * length, 0, 4);
  }

  // How far the vertices that are in the image are from where they were at that time.
  double error_px(const Eigen::Isometry3d& found, Timestamp t) const {
    const Eigen::Isometry3d truth = pose(static_cast<double>(t) * 1e-6);
    double squared = 0;
    int seen = 0;
    for (const Eigen::Vector3d& vertex : model.vertices) {
      const Eigen::Vector3d P = found * vertex, Q = truth * vertex;
      const Eigen::Vector2d at = focal_length() / Q.z() * Q.head<2>();
      if ((at.cwiseAbs() - centre()).maxCoeff() > 0) continue;
      ++seen;
      squared += (focal_length() * (P.head<2>() / P.z() - Q.head<2>() / Q.z())).squaredNorm();
    }
    return std::sqrt(squared / seen);
  }
};

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

TEST_CASE("starts 15 mm to a side, 45 mm in depth and 5 degrees off at 0.6 m are found, and tracked, within 50 ms") {
  int runs = 0, found = 0, found_without = 0;
  for (std::uint64_t seed = 900; seed < 920; ++seed) {
    const Trajectory motion = simulated::near_motion(seed);
    const auto events = simulated::filtered(simulated::near_events(motion, 0.05, seed));
    REQUIRE(events.size() > 5000);
    std::mt19937 random(static_cast<unsigned>(seed));
    for (int i = 0; i < 5; ++i) {
      const Eigen::Isometry3d start = off(motion(0), random, 0.015, i % 2 == 0 ? 0.045 : -0.045, 5);
      const auto locked = [&](const MarkerTrackerSettings<>& settings) {
        MarkerTracker tracker(simulated::camera, kModel, start, settings);
        CHECK(tracker.searching() == settings.start_search.has_value());
        for (const Event& event : events) tracker.push(event);
        CHECK(!tracker.searching());
        const PoseError error =
            pose_error(tracker.T_camera_marker(), motion(1e-6 * static_cast<double>(tracker.estimate().t)));
        return tracker.state() == TrackingState::tracking && error.translation_mm < 2 && error.rotation_deg < 2;
      };
      ++runs;
      found += locked({});
      found_without += locked({.start_search = std::nullopt});
    }
  }
  MESSAGE("found " << found << " of " << runs << ", without looking for the marker first " << found_without);
  CHECK(runs == 100);
  CHECK(found >= 99);
  CHECK(found_without < 50);  // or the starts were too easy
}

TEST_CASE("a wireframe is found whatever its size, speed, sensor and noise") {
  const MarkerModel square = make_square_marker(simulated::kMarkerLength);
  check_found("90 px", {}, 0.003, 2.5);
  check_found("10000 px/s", {.speed_px_per_s = 10000, .duration_s = 0.003}, 0.0001, 2.5);
  check_found("2 px/s", {.speed_px_per_s = 2, .duration_s = 1, .per_px = 5, .noise_hz = 0.1}, 0.15, 2.5);
  check_found("half of the edges silent", {.direction_rad = 0.2}, 0.004, 2.5);
  const Eigen::Isometry3d far = facing_pose({0.1, 0, 1.78}, {0.2, 0.1, 0.2});
  check_found("30 px", {.model = square, .T = far}, 0.01, 2.5);
  check_found("30 px with a code", {.T = far}, 0.02, 2.5);
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

  MarkerTracker tracker(sketch.camera, kModel, sketch.T,
                        {.start_search = StartPoseSearchSettings{.longest = std::chrono::milliseconds(200)}});
  const PoseEstimate* last = nullptr;
  for (const Event& event : events) {
    CHECK(tracker.searching() == (last == nullptr));
    if (const PoseEstimate* const pose = tracker.push(event)) last = pose;
  }
  REQUIRE(last);
  CHECK(last->quality.state == TrackingState::lost);
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

TEST_CASE("events that were missed begin the search anew instead of losing the marker") {
  const Sketch sketch{.duration_s = 0.05};
  MarkerTracker tracker(sketch.camera, kModel, sketch.rough(1));
  const auto events = sketch.draw(6);
  for (std::size_t i = 0; i < 50; ++i) tracker.push(events[i]);
  REQUIRE(tracker.searching());
  CHECK(tracker.skip(std::chrono::milliseconds(100)) == nullptr);
  CHECK(tracker.state() == TrackingState::converging);
  for (std::size_t i = 50; i < events.size(); ++i) tracker.push(events[i]);
  CHECK_FALSE(tracker.searching());
  REQUIRE(tracker.start_search());
  CHECK(tracker.start_search()->evidence() > tracker.start_search()->needed_evidence());
}

// --- Real recordings
// --------------------------------------------------------------------------------------------------

namespace {

const std::filesystem::path kData = EVMARKER_SHARED_DATA;

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
  if (!std::filesystem::exists(kData / "pyramid/events.csv") || !std::filesystem::exists(kData / "flip/events.csv")) {
    MESSAGE("skipped: no recordings in " << kData.string());
    return;
  }
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
