#pragma once
// Fuzzed: the event path, with any events, settings, start poses and models, and with hostile detectors.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/evmarker.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/pose_promises.hpp"
#include "fuzz/target.hpp"
#include "simulated.hpp"

namespace evmarker::fuzz {

namespace detail {

inline constexpr std::size_t kSettingsBytes = 48, kEventBytes = 4;
inline constexpr SensorSize kSensor{56, 42};
inline const PinholeCamera kCamera{kSensor, 50, 50, 27.5, 20.5};

/// Tables of lines of sight, made once: of lenses without and with distortion, the last one not invertible everywhere.
inline const UndistortionTable& table(std::size_t lens) {
  const auto with = [](const auto& distortion) {
    return UndistortionTable(PinholeCamera(kSensor, 50, 50, 27.5, 20.5, distortion));
  };
  static const std::array<UndistortionTable, 3> tables{with(NoDistortion{}),
                                                       with(BrownConradyDistortion{-0.3, 0.1, 0.001, -0.001, 0}),
                                                       with(BrownConradyDistortion{-3, 0, 0, 0, 0})};
  return tables[lens];
}

/// A camera of which the lines of sight are known.
struct TableCamera {
  const UndistortionTable& table;
  SensorSize sensor_size() const { return table.sensor_size(); }
  double focal_length() const { return table.focal_length(); }
  Eigen::Vector2d project(const Eigen::Vector3d& point) const { return kCamera.project(point); }
  Eigen::Vector3d line_of_sight(const Eigen::Vector2d& pixel) const {
    const Vec2 m = table(Event{static_cast<std::uint16_t>(pixel.x()), static_cast<std::uint16_t>(pixel.y()), 0, 0});
    return {m.x, m.y, 1};
  }
};

inline const Eigen::Isometry3d kNominal = facing_pose({0, 0, 0.2});

/// Near the pose of the seeds' marker; that pose for zeros.
inline Eigen::Isometry3d read_pose(Numbers& numbers) {
  const auto offset = [&](double scale) {
    return scale * static_cast<double>(static_cast<std::int8_t>(numbers.byte())) / 128;
  };
  Eigen::Isometry3d T = kNominal;
  T.translation() += Eigen::Vector3d{offset(0.05), offset(0.05), offset(0.15)};
  T.linear() = so3_exp(Eigen::Vector3d{offset(1), offset(1), offset(3)}) * T.linear();
  return T;
}

inline const MarkerModel& code_marker() {
  static const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  return model;
}

// Two markers side by side and one on a side that is turned away by 60 degrees.
inline const MarkerModel& board() {
  static const MarkerModel model = [] {
    Board board{.id = 5, .markers = {}};
    for (int i = 0; i < 3; ++i) {
      BoardMarker marker{.id = i, .length = 0.04, .bits = simulated::code(i % 2)};
      marker.T_board_marker.translation() = Eigen::Vector3d{0.05 * (i - 1), 0, 0};
      if (i == 2) marker.T_board_marker.linear() = so3_exp({0, 1.05, 0});
      board.markers.push_back(marker);
    }
    return make_board_model(board);
  }();
  return model;
}

inline MarkerModel read_model(Numbers& numbers) {
  switch (numbers.index(5)) {
    case 0: return code_marker();
    case 1: return make_square_marker(0.1 * numbers.around_one(20));
    case 2: {
      const double width = 0.1 * numbers.around_one(20), height = 0.1 * numbers.around_one(20);
      return make_rectangle_marker(width, height);
    }
    case 3: return board();
    default: {  // a wireframe of any shape
      MarkerModel model;
      for (std::size_t vertices = 3 + numbers.index(6); vertices > 0; --vertices)
        model.vertices.push_back(
            0.05 * Eigen::Vector3d{numbers.uniform(-1, 1), numbers.uniform(-1, 1), numbers.uniform(-1, 1)});
      const auto count = static_cast<int>(model.vertices.size());
      for (int i = 0; i < count; ++i) model.segments.push_back({i, (i + 1) % count});
      return model;
    }
  }
}

/// Any settings of the documented ranges; the defaults for zeros, but windows of verification that fit short inputs.
template <typename Rule>
MarkerTrackerSettings<Rule> read_settings(Numbers& numbers) {
  MarkerTrackerSettings<Rule> settings;
  settings.events_per_update = std::array{kAutomatic, 1, 2, 7, 10, 100, 100000}[numbers.index(7)];
  settings.matching.max_distance_px *= numbers.around_one(30);
  settings.matching.end_margin_px *= numbers.around_one(30);
  settings.matching.ambiguity_px *= numbers.around_one(30);
  settings.verification.updates = 1 + numbers.byte() % 40;
  settings.verification.min_events = numbers.byte();
  settings.verification.max_events = 1 + 4 * std::size_t{numbers.byte()};
  settings.verification.every = 1 + numbers.byte() % 3;
  if (numbers.byte() % 64 != 1) settings.start_search.reset();
  const double factor = numbers.around_one(1000);
  if constexpr (std::is_same_v<Rule, KalmanUpdate>) {
    const std::size_t field = numbers.index(16);
    std::array<double*, 15> fields{&settings.update.inflation,
                                   &settings.update.robust_px,
                                   &settings.update.acceleration_noise,
                                   &settings.update.turning_distance_m,
                                   &settings.update.rotation_share,
                                   &settings.update.velocity_memory_s,
                                   &settings.update.confirmed_velocity_memory_s,
                                   &settings.update.offset_drift_px,
                                   &settings.update.latency_sigma_s,
                                   &settings.update.initial_sigma_t_m,
                                   &settings.update.initial_sigma_r_rad,
                                   &settings.update.initial_sigma_v_m_s,
                                   &settings.update.initial_sigma_w_rad_s,
                                   &settings.update.initial_sigma_offset_px,
                                   &settings.update.initial_sigma_trail_px};
    if (field > 0) *fields[field - 1] *= factor;
  } else {
    if (numbers.flag()) settings.update = DecoupledSettings::paper();
    settings.update.translation_gain *= std::sqrt(std::sqrt(factor));
  }
  return settings;
}

struct Stream {
  std::vector<Event> events;
  bool monotonic = true;
};

/// Events of 4 bytes behind the settings: x, y, kind of time step and polarity, time step.
inline Stream read_events(Numbers& numbers) {
  constexpr std::array<Timestamp, 16> jumps{1000,
                                            -1000,
                                            100000,
                                            -100000,
                                            10000000,
                                            -10000000,
                                            Timestamp{1} << 31,
                                            -(Timestamp{1} << 31),
                                            Timestamp{1} << 32,
                                            -(Timestamp{1} << 32),
                                            Timestamp{1} << 45,
                                            -(Timestamp{1} << 45),
                                            Timestamp{1} << 53,
                                            -(Timestamp{1} << 53),
                                            std::numeric_limits<Timestamp>::max() / 2,
                                            std::numeric_limits<Timestamp>::min() / 2};
  Stream stream;
  Timestamp t = 0;
  numbers.go_to(kSettingsBytes);
  while (!numbers.empty()) {
    const auto x = static_cast<std::uint16_t>(numbers.byte()), y = static_cast<std::uint16_t>(numbers.byte());
    const std::uint8_t kind = numbers.byte(), step = numbers.byte();
    Timestamp by = step;
    if (kind >> 1U & 1U) by *= 100;
    if (kind >> 2U & 1U) by = jumps[step % jumps.size()];
    if ((kind >> 3U & 1U) && !(kind >> 2U & 1U)) by = -by;
    if (by > 0 && t > std::numeric_limits<Timestamp>::max() - by) by = 0;
    if (by < 0 && t < std::numeric_limits<Timestamp>::min() - by) by = 0;
    stream.monotonic &= by >= 0;
    t += by;
    stream.events.push_back({x, y, static_cast<std::int16_t>(kind & 1U), t});
  }
  return stream;
}

template <typename Tracker>
struct Tracked {
  Tracker tracker;
  std::vector<PoseEstimate> poses;
};

/// Tracks events one by one and in pieces: the poses must be the same.
template <typename Tracker, typename Push>
Tracked<Tracker> track_both_ways(const Tracker& start, std::span<const Event> events, std::size_t piece,
                                 const Push& push) {
  Tracker one = start, many = start;
  std::vector<PoseEstimate> singly, together;
  for (const Event& event : events) push(one, std::span(&event, 1), singly);
  for (std::size_t i = 0; i < events.size(); i += piece)
    push(many, events.subspan(i, std::min(piece, events.size() - i)), together);
  require_that(std::ranges::equal(singly, together, same_bits), "single events and ranges give the same poses");
  return {std::move(one), std::move(singly)};
}

inline constexpr auto kPush = [](auto& tracker, std::span<const Event> events, std::vector<PoseEstimate>& out) {
  tracker.push(events, [&](const PoseEstimate& pose) { out.push_back(pose); });
};

inline std::size_t read_piece(Numbers& numbers) { return 1 + std::size_t{numbers.byte()} * numbers.byte() % 300; }

template <typename Rule>
void fuzz_marker_tracker(Numbers numbers) {
  const UndistortionTable& camera = table(numbers.index(3));
  const std::size_t piece = read_piece(numbers);
  const MarkerId id = numbers.byte();
  const Eigen::Isometry3d T = read_pose(numbers);
  const MarkerModel model = read_model(numbers);
  const auto settings = read_settings<Rule>(numbers);
  const auto gap = std::chrono::microseconds(numbers.bits(2) << (numbers.byte() % 48));
  const auto [events, monotonic] = read_events(numbers);
  std::optional<MarkerTracker<Rule>> start;
  try {
    start.emplace(camera, model, T, settings, id, events.empty() ? 0 : events.front().t);
  } catch (const std::invalid_argument&) {
    return;
  }
  auto [tracker, poses] = track_both_ways(*start, events, piece, kPush);
  check_poses(poses, monotonic);
  require_that(
      std::ranges::count(poses, TrackingState::lost, [](const auto& p) { return p.quality.state; }) <= 1 &&
          (poses.empty() || std::ranges::none_of(std::span(poses).first(poses.size() - 1),
                                                 [](const auto& p) { return p.quality.state == TrackingState::lost; })),
      "the pose that is lost is the last one");

  const Timestamp now = tracker.estimate().t;
  for (const Timestamp ahead : {Timestamp{0}, Timestamp{1000}, Timestamp{100000000}}) {
    if (now > std::numeric_limits<Timestamp>::max() - ahead) continue;
    const PoseEstimate predicted = tracker.pose_at(now + ahead);
    check_poses({&predicted, 1}, true);
    const PoseEstimate known = tracker.pose_at(now + ahead, now + ahead);
    check_poses({&known, 1}, true);
  }
  tracker.skip(gap);
  const PoseEstimate after = tracker.estimate();
  check_poses({&after, 1}, true);
}

/// Finds what its seed says: the marker, or anything else.
struct HostileDetector {
  Random random{0};
  struct Fault {};

  std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
    std::vector<MarkerDetection> found;
    for (std::size_t count = below(random, 4); count > 0; --count) {
      const std::uint64_t t = static_cast<std::uint64_t>(frame.t()) - below(random, 1000);  // the earliest ones wrap
      MarkerDetection detection{.id = any_id(), .t = static_cast<Timestamp>(t), .T_camera_marker = any_pose()};
      if (below(random, 3) == 0) detection.T_camera_marker_alternative = any_pose();
      found.push_back(detection);
    }
    if (below(random, 8) == 0) throw Fault();
    return found;
  }
  MarkerModel model(MarkerId id) {
    if (below(random, 32) == 0) throw Fault();
    if (below(random, 16) == 0) return {};
    return id == 3 ? make_square_marker(0.05) : id == 4 ? board() : code_marker();
  }
  bool shows(MarkerId, const Eigen::Isometry3d&) { return below(random, 4) != 0; }
  std::optional<MarkerDetection> search(MarkerId id, const Eigen::Isometry3d& T) {
    if (below(random, 2) == 0) return std::nullopt;
    return MarkerDetection{.id = below(random, 8) == 0 ? any_id() : id,
                           .T_camera_marker = below(random, 2) == 0 ? T : any_pose()};
  }

 private:
  MarkerId any_id() {
    constexpr std::array<MarkerId, 8> ids{0, 0, 0, 1, 2, 3, -1, std::numeric_limits<MarkerId>::max()};
    return ids[below(random, ids.size())];
  }
  Eigen::Isometry3d any_pose() {
    Eigen::Isometry3d T = kNominal;
    const auto any = [this](double scale) { return random.uniform(-scale, scale); };
    switch (below(random, 8)) {
      case 0: T.translation() *= -1; break;
      case 1: T.linear() *= 1.5; break;
      case 2:
        T.matrix()(static_cast<Eigen::Index>(below(random, 3)), 3) = std::numeric_limits<double>::quiet_NaN();
        break;
      case 3: T.translation() += Eigen::Vector3d{any(0.1), any(0.1), any(0.1)}; break;
      case 4: T.linear() = so3_exp(Eigen::Vector3d{any(3), any(3), any(3)}); break;
      default: break;
    }
    return T;
  }
};
static_assert(VerifyingDetector<HostileDetector> && SearchingDetector<HostileDetector>);

template <typename Rule>
void fuzz_tracker(Numbers numbers) {
  const TableCamera camera{table(numbers.index(3))};
  const std::size_t piece = read_piece(numbers);
  const HostileDetector detector{Random(numbers.bits(2))};
  TrackerSettings<Rule> settings;
  settings.filter_window = std::chrono::microseconds(std::array{0, 2000, 100, 1000000}[numbers.index(4)]);
  settings.detection_interval = std::chrono::microseconds(1 + 100 * numbers.byte());
  settings.search_interval = std::chrono::microseconds(1 + 100 * numbers.byte());
  settings.detection_latency = std::chrono::microseconds(30 * numbers.byte());
  settings.min_events_per_detection = numbers.byte() % 50;
  settings.detections_to_confirm = 1 + numbers.byte() % 3;
  settings.max_markers = 1 + numbers.byte() % 5;
  settings.history_events = std::size_t{1} << (numbers.byte() % 10);
  settings.marker = read_settings<Rule>(numbers);
  const auto [events, monotonic] = read_events(numbers);
  std::optional<Tracker<HostileDetector, Rule>> start;
  try {
    start.emplace(camera, detector, settings);
  } catch (const std::invalid_argument&) {
    return;
  }
  // What the detector throws leaves `push`, after some of the events.
  const auto push = [](auto& tracker, std::span<const Event> range, auto& out) {
    const std::uint64_t before = tracker.statistics().events;
    while (tracker.statistics().events - before < range.size()) {
      try {
        tracker.push(range.subspan(tracker.statistics().events - before),
                     [&](const PoseEstimate& pose) { out.push_back(pose); });
      } catch (const HostileDetector::Fault&) {
      }
    }
  };
  const auto [tracker, poses] = track_both_ways(*start, events, piece, push);
  check_poses(poses, monotonic);
  const TrackerStatistics& statistics = tracker.statistics();
  require_that(statistics.events == events.size(), "every event is counted");
  require_that(statistics.off_sensor + statistics.hot + statistics.filtered + statistics.time_faults <= events.size(),
               "no event is counted twice");
  require_that(statistics.lost <= statistics.registered, "what is lost was registered");
}

template <typename Rule>
void fuzz_wireframe_tracker(Numbers numbers) {
  const TableCamera camera{table(numbers.index(3))};
  const std::size_t piece = read_piece(numbers);
  Wireframe body{.id = numbers.byte(), .model = {}, .start = read_pose(numbers)};
  body.model = read_model(numbers);
  WireframeTrackerSettings<Rule> settings;
  settings.filter_window = std::chrono::microseconds(std::array{0, 2000, 100, 1000000}[numbers.index(4)]);
  settings.marker = read_settings<Rule>(numbers);
  settings.marker.start_search = StartPoseSearchSettings{};
  const auto [events, monotonic] = read_events(numbers);
  std::optional<WireframeTracker<Rule>> start;
  try {
    start.emplace(camera, body, settings);
  } catch (const std::invalid_argument&) {
    return;
  }
  auto [tracker, poses] = track_both_ways(*start, events, piece, kPush);
  check_poses(poses, monotonic);
  require_that(tracker.statistics().events == events.size(), "every event is counted");
}

/// Events of the seeds' marker as it moves for 20 ms, with noise, as `read_events` reads them.
inline std::string moving_marker(std::uint64_t seed, std::size_t most_events) {
  const Trajectory motion =
      trajectory::linear(kNominal, Eigen::Vector3d(0.5, 0.2 * static_cast<double>(seed % 5), 0.3), {0, 0, 3});
  std::string bytes;
  Timestamp t = 0;
  for (const Event& event : simulated::record(
           kCamera,
           {{.id = 0, .length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = motion}},
           {.duration_s = 0.02, .seed = seed, .noise_hz_per_px = 2})) {
    if (bytes.size() == kEventBytes * most_events) break;
    const bool fine = event.t - t < 256;
    const Timestamp step = fine ? event.t - t : std::min<Timestamp>((event.t - t) / 100, 255);
    t += fine ? step : 100 * step;
    for (const int byte : {int{event.x}, int{event.y}, event.p | (fine ? 0 : 2), static_cast<int>(step)})
      bytes += static_cast<char>(byte);
  }
  return bytes;
}

/// The settings of a seed: `kind` as the first byte, the length of the ranges, and defaults.
inline std::string seed_settings(std::uint64_t seed) {
  std::string input(kSettingsBytes, '\0');
  input[0] = static_cast<char>(seed);
  input[2] = input[3] = static_cast<char>(5 + seed);
  return input;
}

/// With default settings or others, and a few hundred events.
inline std::vector<std::string> tracking_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    Random random(seed);
    std::string input = seed_settings(seed);
    if (seed >= 6)
      for (char& byte : std::span(input).subspan(4))
        if (below(random, 4) == 0) byte = static_cast<char>(random.bits());
    seeds.push_back(input + moving_marker(seed, std::size_t{60} << (seed % 3)));
  }
  return seeds;
}

/// With default settings, and enough events for the search of the start.
inline std::vector<std::string> wireframe_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 4; ++seed) seeds.push_back(seed_settings(seed) + moving_marker(seed, 3500));
  return seeds;
}

inline std::string make_event(Random& random) {
  const bool odd = below(random, 16) == 0;
  std::string bytes;
  bytes += static_cast<char>(below(random, odd ? 256 : 56));
  bytes += static_cast<char>(below(random, odd ? 256 : 42));
  bytes += static_cast<char>(odd ? random.bits() : below(random, 2));
  bytes += static_cast<char>(below(random, odd ? 256 : 40));
  return bytes;
}

}  // namespace detail

inline void fuzz_tracking(std::string_view input) {
  Numbers numbers(input);
  switch (numbers.index(4)) {
    case 0: return detail::fuzz_marker_tracker<KalmanUpdate>(numbers);
    case 1: return detail::fuzz_marker_tracker<DecoupledUpdate>(numbers);
    case 2: return detail::fuzz_tracker<KalmanUpdate>(numbers);
    default: return detail::fuzz_tracker<DecoupledUpdate>(numbers);
  }
}

inline void fuzz_wireframe_tracking(std::string_view input) {
  Numbers numbers(input);
  if (numbers.index(2) == 0) return detail::fuzz_wireframe_tracker<KalmanUpdate>(numbers);
  detail::fuzz_wireframe_tracker<DecoupledUpdate>(numbers);
}

inline std::vector<Target> tracking_targets() {
  using namespace detail;
  return {{"tracking", fuzz_tracking, tracking_seeds, {kSettingsBytes, kEventBytes, make_event}, 1024, 30'000, 6},
          {"wireframe_tracking",
           fuzz_wireframe_tracking,
           wireframe_seeds,
           {kSettingsBytes, kEventBytes, make_event},
           16384,
           200,
           30}};
}

}  // namespace evmarker::fuzz
