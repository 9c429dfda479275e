#include "evmarker/tracking/tracker.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "sanitized.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::seconds;
using simulated::TrueDetector;
using namespace std::chrono_literals;

namespace {

opencv::ArucoDetector<PinholeCamera> aruco() {
  return {simulated::camera, {.dictionary = "DICT_4X4_50", .marker_length = simulated::kMarkerLength}};
}

// Has the true poses of all markers, in every frame.
struct AllKnowing {
  std::vector<Trajectory> motions;
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
    std::vector<MarkerDetection> detections;
    for (std::size_t i = 0; i < motions.size(); ++i) {
      auto detection = TrueDetector{motions[i]}.detect(frame).front();
      detection.id = static_cast<MarkerId>(i);
      detections.push_back(detection);
    }
    return detections;
  }
  MarkerModel model(MarkerId id) const {
    CodeBits bits = simulated::code();
    if (id == 1) bits(0, 0) ^= 1;
    return make_code_marker(simulated::kMarkerLength, bits);
  }
};

bool same_pose(const PoseEstimate& a, const PoseEstimate& b) {
  return a.id == b.id && a.t == b.t && a.T_camera_marker.matrix() == b.T_camera_marker.matrix();
}

template <typename T>
std::vector<PoseEstimate> track(T& tracker, const std::vector<Event>& events) {
  std::vector<PoseEstimate> poses;
  for (const Event& event : events)
    for (const PoseEstimate& pose : tracker.push(event)) poses.push_back(pose);
  return poses;
}

}  // namespace

TEST_CASE("a marker is found, tracked within the paper's error and nothing else is seen") {
  for (const std::uint64_t seed : {51u, 52u}) {
    CAPTURE(seed);
    const Trajectory motion = simulated::near_motion(seed);
    const auto events = simulated::near_events(motion, 1.2, seed, 1);
    Tracker tracker(simulated::camera, aruco());
    AccuracyMeter meter;
    for (const PoseEstimate& pose : track(tracker, events)) {
      CHECK(pose.id == 1);
      meter.add(pose, motion(seconds(pose.t)));
    }
    REQUIRE(meter.tracking() > 3000);
    CHECK(meter.first_t() < 600000);
    CHECK(meter.translation_mm().mean < 6);
    CHECK(meter.rotation_deg().mean < 2.5);
    CHECK(meter.coverage(1200000) > 0.95);
    const TrackerStatistics& statistics = tracker.statistics();
    CHECK(statistics.events == events.size());
    CHECK(statistics.filtered > 0);
    CHECK(statistics.filtered < statistics.events / 2);
    CHECK(statistics.matched > statistics.events / 4);
    CHECK(statistics.registered - statistics.lost == 1);
  }
}

TEST_CASE("a marker that is hidden for 200 ms is reported lost and found again") {
  const Trajectory motion = simulated::near_motion(53);
  // A board sweeps in from the left within 50 ms, stays, and goes on to the right.
  const auto board = [](double s) -> Eigen::Vector2d {
    if (s < 0.55) return {-400, 240};
    if (s < 0.60) return {-400 + (s - 0.55) / 0.05 * 720, 240};
    if (s < 0.80) return {320, 240};
    return {320 + (s - 0.80) / 0.05 * 720, 240};
  };
  const Scene scene{{{.id = 0, .length = 0.10, .bits = simulated::code(), .T_camera_marker = motion}},
                    {{.centre_px = board, .half_size_px = {300, 220}}},
                    {}};
  const auto events = simulated::record(simulated::camera, scene, {.duration_s = 1.4, .seed = 53});
  Tracker tracker(simulated::camera, aruco());
  const auto poses = track(tracker, events);
  const auto in_state = [&](TrackingState state, double from_s, double to_s) {
    return std::ranges::count_if(poses, [&](const PoseEstimate& pose) {
      return pose.quality.state == state && seconds(pose.t) >= from_s && seconds(pose.t) < to_s;
    });
  };
  REQUIRE(in_state(TrackingState::tracking, 0.4, 0.55) > 100);
  CHECK(in_state(TrackingState::lost, 0.55, 0.65) >= 1);
  CHECK(in_state(TrackingState::tracking, 0.65, 0.80) == 0);
  CHECK(in_state(TrackingState::tracking, 0.85, 1.4) > 500);
  CHECK(tracker.statistics().registered >= 2);
}

TEST_CASE("the same events give the same poses, bit for bit") {
  const Trajectory motion = simulated::near_motion(54);
  const auto events = simulated::near_events(motion, 0.3, 54);
  Tracker first(simulated::camera, TrueDetector{motion}), second(simulated::camera, TrueDetector{motion});
  const auto a = track(first, events), b = track(second, events);
  REQUIRE(a.size() > 500);
  REQUIRE(a.size() == b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    CHECK(a[i].t == b[i].t);
    CHECK(a[i].T_camera_marker.matrix() == b[i].T_camera_marker.matrix());
  }
}

TEST_CASE("however many events come together, the poses are the same, bit for bit, and in order") {
  // Three markers, one of them hidden for a while: found, followed, lost and found again.
  const Trajectory left = simulated::near_motion(56), middle = simulated::near_motion(57);
  const auto moved = [](const Trajectory& motion, double x) {
    return [motion, x](double s) {
      Eigen::Isometry3d T = motion(s);
      T.translation() += Eigen::Vector3d(x, 0, 0.5);
      return T;
    };
  };
  const auto board = [](double s) -> Eigen::Vector2d {
    return {s < 0.3 ? -400 : s < 0.5 ? -400 + (s - 0.3) / 0.05 * 300 : 2000, 240};
  };
  CodeBits other = simulated::code();
  other(0, 0) ^= 1;
  const Scene scene{{{.id = 0, .length = 0.10, .bits = simulated::code(), .T_camera_marker = moved(left, -0.12)},
                     {.id = 1, .length = 0.10, .bits = other, .T_camera_marker = moved(middle, 0.08)}},
                    {{.centre_px = board, .half_size_px = {150, 240}}},
                    {}};
  auto events = simulated::record(simulated::camera, scene, {.duration_s = 0.8, .seed = 56});
  for (std::size_t i = 0; i + 7 < events.size(); i += 50)
    events[i].t = events[i + 7].t;  // some step back, or are equal
  const auto run = [&](std::size_t together) {
    Tracker tracker(simulated::camera, AllKnowing{{moved(left, -0.12), moved(middle, 0.08)}});
    std::vector<PoseEstimate> poses;
    if (together == 0) return std::pair(track(tracker, events), tracker.statistics());
    for (std::size_t i = 0; i < events.size(); i += together)
      tracker.push(std::span(events).subspan(i, std::min(together, events.size() - i)),
                   [&](const PoseEstimate& pose) { poses.push_back(pose); });
    return std::pair(poses, tracker.statistics());
  };
  const auto [expected, statistics] = run(0);
  REQUIRE(expected.size() > 1000);
  REQUIRE(statistics.registered >= 2);
  REQUIRE(statistics.lost >= 1);
  for (const MarkerId id : {0, 1}) REQUIRE(std::ranges::count(expected, id, &PoseEstimate::id) > 100);
  for (const std::size_t together : {1u, 100u, 5000u, 100000000u}) {
    CAPTURE(together);
    const auto [poses, again] = run(together);
    CHECK(again.events == statistics.events);
    CHECK(again.filtered == statistics.filtered);
    CHECK(again.detections == statistics.detections);
    CHECK(again.registered == statistics.registered);
    CHECK(again.lost == statistics.lost);
    CHECK(again.replayed == statistics.replayed);
    CHECK(std::ranges::equal(poses, expected, same_pose));
  }
}

TEST_CASE("where markers meet, events that come together give the same poses, bit for bit") {
  const auto sway = [](const Eigen::Vector3d& centre, std::uint64_t seed) {
    return trajectory::handheld(
        {.T_centre = facing_pose(centre), .amplitude_m = {0.02, 0.02, 0.02}, .frequency_hz = 1.3, .seed = seed});
  };
  // One covers the other's edges in part and by the end wholly: lost there, or at least unreliable.
  const Trajectory behind = sway({-0.03, 0, 0.62}, 62);
  const Trajectory before = [sways = sway({0.10, 0, 0.55}, 162)](double s) {
    Eigen::Isometry3d T = sways(s);
    T.translation().x() -= s < 0.5 ? 0 : std::min((s - 0.5) / 2, 0.12);
    return T;
  };
  CodeBits other = simulated::code();
  other(0, 0) ^= 1;
  const auto events = simulated::record(
      simulated::camera,
      {{.id = 0, .length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = behind},
       {.id = 1, .length = simulated::kMarkerLength, .bits = other, .T_camera_marker = before}},
      SimulatorSettings{.duration_s = 0.9, .seed = 62});
  for (const int n : {20, 100}) {
    CAPTURE(n);
    TrackerSettings<> settings;
    settings.marker.events_per_update = n;
    const Tracker start(simulated::camera, AllKnowing{{behind, before}}, settings);
    Tracker one_by_one = start;
    const std::vector<PoseEstimate> expected = track(one_by_one, events);
    for (const MarkerId id : {0, 1}) REQUIRE(std::ranges::count(expected, id, &PoseEstimate::id) > 300);
    REQUIRE(one_by_one.statistics().lost >= 1);
    for (const std::size_t together : {100u, 1000u, 1024u, 5000u}) {
      CAPTURE(together);
      Tracker tracker = start;
      std::vector<PoseEstimate> poses;
      for (std::size_t i = 0; i < events.size(); i += together)
        tracker.push(std::span(events).subspan(i, std::min(together, events.size() - i)),
                     [&](const PoseEstimate& pose) { poses.push_back(pose); });
      CHECK(tracker.statistics().detections == one_by_one.statistics().detections);
      CHECK(tracker.statistics().lost == one_by_one.statistics().lost);
      CHECK(std::ranges::equal(poses, expected, same_pose));
    }
  }
}

TEST_CASE("markers are searched in the order of their losses, however many events come together") {
  struct SearchOrder : AllKnowing {
    std::vector<MarkerId>* searched;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
      return frame.t() < 300000 ? AllKnowing::detect(frame) : std::vector<MarkerDetection>();
    }
    std::optional<MarkerDetection> search(MarkerId id, const Eigen::Isometry3d&) {
      searched->push_back(id);
      return std::nullopt;
    }
  };
  const auto sway = [](double x, std::uint64_t seed) {
    return trajectory::handheld(
        {.T_centre = facing_pose({x, 0, 0.8}), .amplitude_m = {0.02, 0.02, 0.02}, .frequency_hz = 1.3, .seed = seed});
  };
  const std::vector<Trajectory> motions{sway(-0.12, 63), sway(0.12, 64)};
  CodeBits other = simulated::code();
  other(0, 0) ^= 1;
  const auto events =
      simulated::record(simulated::camera,
                        {{.id = 0, .length = 0.10, .bits = simulated::code(), .T_camera_marker = motions[0]},
                         {.id = 1, .length = 0.10, .bits = other, .T_camera_marker = motions[1]}},
                        SimulatorSettings{.duration_s = 0.5, .seed = 63});
  const auto begin = std::ranges::lower_bound(events, 400000, {}, &Event::t);
  const std::vector<Event> before(events.begin(), begin), after(begin, events.end());
  // Beside the upper edge of marker 1, then of marker 0: both are lost in one batch, marker 1 first.
  std::vector<Event> all_beside;
  for (const std::size_t marker : {1u, 0u})
    for (int i = 0; i < 64; ++i) {
      const Eigen::Vector3d on_edge(-0.05 + 0.1 * i / 64, 0.05, 0);
      const Eigen::Vector2d u = simulated::camera.project(motions[marker](0.4) * on_edge);
      all_beside.push_back({static_cast<std::uint16_t>(u.x()), static_cast<std::uint16_t>(u.y() - 4), 1,
                            400000 + static_cast<Timestamp>(all_beside.size())});
    }
  std::vector<MarkerId> searched[2];
  for (const bool together : {false, true}) {
    auto beside = all_beside;
    TrackerSettings<> settings;
    settings.marker.health.false_alarm_rate = 0.09;
    Tracker tracker(simulated::camera, SearchOrder{{motions}, &searched[together]}, settings);
    tracker.push(before, [](const PoseEstimate&) {});
    REQUIRE(std::ranges::distance(tracker.markers()) == 2);
    const std::size_t piece = together ? beside.size() : 1;
    for (int round = 0; round < 20 && tracker.statistics().lost == 0; ++round) {
      for (std::size_t i = 0; i < beside.size(); i += piece)
        tracker.push(std::span(beside).subspan(i, piece), [](const PoseEstimate&) {});
      for (Event& event : beside) event.t += 200;
    }
    REQUIRE(tracker.statistics().lost == 2);
    tracker.push(after, [](const PoseEstimate&) {});
  }
  REQUIRE(searched[0].size() >= 2);
  CHECK(searched[0].front() == 1);
  CHECK(searched[1] == searched[0]);
}

TEST_CASE("the events between a frame and its registration are replayed, and none is lost") {
  const Trajectory motion = simulated::near_motion(55);
  const auto events = simulated::near_events(motion, 0.3, 55);
  Tracker at_once(simulated::camera, TrueDetector{motion});
  Tracker late(simulated::camera, TrueDetector{motion}, {.detection_latency = std::chrono::milliseconds(7)});
  const auto a = track(at_once, events), b = track(late, events);
  REQUIRE(a.size() > 500);
  CHECK(at_once.statistics().replayed == 0);
  CHECK(late.statistics().replayed > 500);
  // A detection is due only when the last one has been registered, so that the second may be later; from there on, a
  // tracker started late has seen the same events as one started at once.
  const auto same_start = std::ranges::find(b.begin(), b.end(), a.front().t, &PoseEstimate::t);
  if (same_start == b.begin()) {
    REQUIRE(a.size() == b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      CHECK(a[i].t == b[i].t);
      CHECK(a[i].T_camera_marker.matrix() == b[i].T_camera_marker.matrix());
    }
  } else {
    CHECK(b.front().t <= a.front().t + 20000);
  }
}

TEST_CASE("a detection must be confirmed, an id is tracked once, and a full house takes no more") {
  const Trajectory motion = simulated::near_motion(56);
  const auto events = simulated::near_events(motion, 0.2, 56);
  Tracker eager(simulated::camera, TrueDetector{motion}, {.detections_to_confirm = 1});
  Tracker careful(simulated::camera, TrueDetector{motion}, {.detections_to_confirm = 5});
  const auto a = track(eager, events), b = track(careful, events);
  REQUIRE(!a.empty());
  REQUIRE(!b.empty());
  CHECK(b.front().t - a.front().t > 19000);  // four detections, 5 ms apart
  CHECK(eager.statistics().registered == 1);
  CHECK(eager.markers().size() == 1);
}

TEST_CASE("a detection that leaves no doubt refutes what was found at another tilt before") {
  const Eigen::Isometry3d T = facing_pose({0.05, 0, 0.6}, {0.2, 0.3, 0});
  const auto tilted = [&](double rad) {
    Eigen::Isometry3d other = T;
    other.linear() = so3_exp({0, rad, 0}) * T.linear();
    return other;
  };
  struct Detector {
    MarkerDetection detection;
    std::vector<MarkerDetection> detect(const PolarityFrame&) const { return {detection}; }
    bool shows(MarkerId, const Eigen::Isometry3d&) const { return true; }  // the code is to be seen at both
    MarkerModel model(MarkerId) const { return make_square_marker(simulated::kMarkerLength); }
  };
  MarkerDetection detection{.id = 3, .T_camera_marker = T};
  const auto sighting = [&](const MarkerDetection& seen, const PlacedMarker& tracked) {
    Detector detector{seen};
    const DetectionRequest request{0, 0, 500, {tracked}, {}};
    const DetectionResult result = answer_request(detector, PolarityFrame(simulated::camera.sensor_size()), request);
    REQUIRE(result.sightings.size() == 1);
    return result.sightings[0];
  };
  CHECK(sighting(detection, {3, tilted(0)}) == Sighting::there);
  CHECK(sighting(detection, {3, tilted(0.2)}) == Sighting::there);  // it may be the detection that errs
  CHECK(sighting(detection, {3, tilted(0.3)}) == Sighting::wrong_tilt);
  CHECK(sighting(detection, {4, tilted(0.3)}) == Sighting::there);
  detection.T_camera_marker_alternative = tilted(0.6);
  CHECK(sighting(detection, {3, tilted(0.3)}) == Sighting::there);
}

TEST_CASE("a marker that was moved while the camera was restarted is found where it is now") {
  const auto sway = [](double x_m) {  // on that side of the image
    return trajectory::handheld(
        {.T_centre = facing_pose({x_m, 0, 0.6}), .amplitude_m = {0.02, 0.02, 0.02}, .frequency_hz = 2, .seed = 61});
  };
  const Trajectory before = sway(-0.2), after = sway(0.2);
  constexpr double kStart_s = 1000;
  const auto motion = [=](double t) { return t < kStart_s ? after(t) : before(t - kStart_s); };
  const auto record = [](const Trajectory& of, double duration_s) {  // no noise: nothing where the marker was
    return simulated::record(simulated::camera,
                             {{.length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = of}},
                             SimulatorSettings{.duration_s = duration_s, .seed = 61, .noise_hz_per_px = 0});
  };
  auto events = record(before, 0.1);
  for (Event& event : events) event.t += static_cast<Timestamp>(1e6 * kStart_s);
  Tracker tracker(simulated::camera, TrueDetector{motion}, {.detections_to_confirm = 1});
  REQUIRE(track(tracker, events).size() > 50);
  AccuracyMeter meter;
  for (const PoseEstimate& pose : track(tracker, record(after, 0.2)))
    if (pose.t < 1000000) meter.add(pose, motion(seconds(pose.t)));
  REQUIRE(meter.tracking() > 50);
  CHECK(meter.first_t() < 50000);
  CHECK(meter.translation_mm().mean < 2);
}

TEST_CASE("after missing events, what was found before them is not followed") {
  const Trajectory motion = simulated::near_motion(57);
  const auto events = simulated::near_events(motion, 0.15, 57);
  constexpr Timestamp kFrom = 60000;
  for (const Timestamp missing : {500, 30000}) {
    CAPTURE(missing);
    TrackerSettings<> settings{.detection_latency = 15ms, .detections_to_confirm = 1};
    TrackerCore<> core(simulated::camera, settings, SpatiotemporalFilter(simulated::camera.sensor_size()));
    const TrueDetector detector{motion};
    std::optional<DetectionResult> result;  // of the first detection, 5 ms before events are missing
    bool skipped = false;
    const auto use = [](const PoseEstimate&) {};
    for (const Event& event : events) {
      if (event.t >= kFrom && event.t < kFrom + missing) continue;
      if (event.t >= kFrom && !std::exchange(skipped, true)) core.skip_to(event.t, use);
      bool supported = false;
      const auto stop = [&](const Event&) { return supported = true; };
      while (core.push(std::span(&event, 1), stop, use) == 0) {
      }
      if (!supported) continue;
      if (!result && event.t > kFrom - 5000)
        result = answer_request(detector, core.polarity_frame(), core.request_detection(event.t));
      if (result && core.result_pending() && core.result_due(event.t)) core.register_markers(*result, use);
    }
    REQUIRE(result);
    REQUIRE(result->markers.size() == 1);
    CHECK(!core.result_pending());
    CHECK(core.statistics().registered == (missing < 1000 ? 1 : 0));
  }
}

namespace {

// Gives a core events up to a time, in pieces that end where the core wants.
template <typename Use>
void push_until(TrackerCore<>& core, const std::vector<Event>& events, std::size_t& next, Timestamp t, const Use& use) {
  const auto stop = [](const Event&) { return false; };
  while (next < events.size() && events[next].t < t) next += core.push(std::span(&events[next], 1), stop, use);
}

}  // namespace

TEST_CASE("a marker that moves by its size while the detector works is confirmed, and not taken for another's") {
  // 15 mm at 0.6 m: 13 px, at 600 px/s on average.
  const Trajectory motion = simulated::near_motion(63);
  constexpr double kSide_m = 0.015;
  const MarkerModel model = make_code_marker(kSide_m, simulated::code());
  const auto events =
      simulated::record(simulated::camera, {{.length = kSide_m, .bits = simulated::code(), .T_camera_marker = motion}},
                        SimulatorSettings{.duration_s = 0.6, .seed = 63});
  TrackerCore<> core(simulated::camera, {.detections_to_confirm = 4},
                     SpatiotemporalFilter(simulated::camera.sensor_size()));
  const auto use = [](const PoseEstimate&) {};
  std::size_t next = 0;
  int moved = 0;
  for (Timestamp t = 20'000; t < 500'000 && core.statistics().registered == 0; t += 40'000) {
    push_until(core, events, next, t, use);
    const DetectionRequest request = core.request_detection(t);
    DetectionResult result{.events_in_frame = request.events_in_frame};
    MarkerDetection detection{.id = 0, .t = t, .T_camera_marker = motion(seconds(t))};
    result.add({detection, model}, request.focal_length);
    result.detected = result.markers.size();
    result.sightings.assign(request.unconfirmed.size(), Sighting::there);
    push_until(core, events, next, t + 35'000, use);
    moved += !same_place(result.markers.front(), motion(seconds(t + 35'000)));
    core.register_markers(result, use);
    core.catch_up(100'000, use);
  }
  REQUIRE(moved >= 2);
  CHECK(core.statistics().registered == 1);
  CHECK(core.statistics().detections == 4);
}

TEST_CASE("a marker that is detected elsewhere again and again is dropped, also where there are as many as may be") {
  const Trajectory motion = simulated::near_motion(64);
  const auto events = simulated::near_events(motion, 0.4, 64);
  // How many detections elsewhere it takes if the first is `wait` after the marker's own; its state before them.
  struct Dropped {
    int detections = 0;
    TrackingState before = TrackingState::lost;
    bool replaced = false;
  };
  const Eigen::Isometry3d corner = facing_pose({0.25, 0.2, 0.7});
  const auto dropped_after = [&](Timestamp wait, Timestamp interval, const Trajectory& elsewhere) {
    TrackerCore<> core(simulated::camera, {.detections_to_confirm = 1, .max_markers = 1},
                       SpatiotemporalFilter(simulated::camera.sensor_size()));
    std::vector<LossReason> losses;
    const auto use = [&](const PoseEstimate& pose) {
      if (pose.quality.state == TrackingState::lost) losses.push_back(pose.quality.loss_reason);
    };
    std::size_t next = 0;
    const auto detect = [&](Timestamp t, const std::vector<std::pair<MarkerId, Eigen::Isometry3d>>& places) {
      push_until(core, events, next, t, use);
      const DetectionRequest request = core.request_detection(t);
      DetectionResult result{.events_in_frame = request.events_in_frame};
      for (const auto& [id, T] : places)
        result.add({{.id = id, .t = t, .T_camera_marker = T}, TrueDetector{motion}.model(id)}, request.focal_length);
      result.detected = result.markers.size();
      core.register_markers(result, use);
    };
    detect(20'000, {{0, motion(0.02)}});
    push_until(core, events, next, 20'000 + wait, use);
    REQUIRE(core.statistics().registered == 1);
    Dropped dropped{.before = core.markers().begin()->state()};
    for (Timestamp t = 20'000 + wait; t < 300'000 && losses.empty(); t += interval, ++dropped.detections)
      detect(t, {{5, corner}, {0, elsewhere(seconds(t))}});
    dropped.replaced = losses == std::vector{LossReason::replaced};
    CHECK(losses.size() == dropped.replaced);
    return dropped;
  };
  const Dropped tracking = dropped_after(60'000, 20'000, trajectory::still(corner)),
                converging = dropped_after(400, 200, trajectory::still(corner));
  CHECK(tracking.replaced);
  CHECK(converging.replaced);
  CHECK(tracking.before == TrackingState::tracking);
  CHECK(tracking.detections == 5);
  // While it is not surely followed, fewer are enough.
  CHECK(converging.before == TrackingState::converging);
  CHECK(converging.detections == 2);

  // One cell of the code aside, it follows wrong edges; half a cell aside, the detector may be wrong.
  const auto aside = [&](double cells) {
    return [=](double t) {
      Eigen::Isometry3d T = motion(t);
      T.translation() += T.linear().col(0) * (cells * simulated::kMarkerLength / 6);
      return T;
    };
  };
  REQUIRE(TrueDetector{motion}.model(0).cells == 6);
  const Dropped by_a_cell = dropped_after(60'000, 20'000, aside(1)),
                by_half = dropped_after(60'000, 20'000, aside(0.5));
  CHECK(by_a_cell.replaced);
  CHECK(by_a_cell.detections == 5);
  CHECK_FALSE(by_half.replaced);
  CHECK(by_half.detections > 5);
}

TEST_CASE("a tracked marker is where it was detected if no vertex is a cell of its code aside") {
  const Eigen::Isometry3d T = facing_pose({0.1, 0.05, 0.8}, {0.3, 0.4, 0.5});
  const DetectionResult::Marker code{{.T_camera_marker = T}, TrueDetector{}.model(0)};
  const auto moved = [&](const Eigen::Vector3d& by_m) {
    Eigen::Isometry3d other = T;
    other.translation() += T.linear() * by_m;
    return other;
  };
  const double cell = simulated::kMarkerLength / 6;
  CHECK(same_place(code, T));
  CHECK(same_place(code, moved({0.6 * cell, 0, 0})));
  CHECK_FALSE(same_place(code, moved({cell, 0, 0})));
  CHECK_FALSE(same_place(code, moved({0, -cell, 0})));
  // Smaller by a sixth, as where one border is matched to the code: its corners at one side are off by a cell.
  Eigen::Isometry3d shrunk = moved({cell / 2, 0, 0});
  shrunk.translation() *= 6.0 / 5;
  CHECK_FALSE(same_place(code, shrunk));
  // At the other pose that the detection allows, it is there, too.
  DetectionResult::Marker two = code;
  two.detection.T_camera_marker_alternative = moved({cell, 0, 0});
  CHECK(same_place(two, moved({cell, 0, 0})));
  CHECK(same_place(two, T));
  // Of the detector of another wireframe, nothing is known.
  const DetectionResult::Marker plate{{.T_camera_marker = T}, make_rectangle_marker(0.1, 0.05)};
  CHECK(same_place(plate, moved({0.04, 0, 0})));
  CHECK_FALSE(same_place(plate, moved({0.07, 0, 0})));
}

TEST_CASE("a detector that throws leaves no result behind, and tracking goes on") {
  const Trajectory motion = simulated::near_motion(58);
  const auto events = simulated::near_events(motion, 0.2, 58);
  struct Ghost {  // seen once; then the detector fails; then there is nothing
    int* calls;
    std::vector<MarkerDetection> detect(const PolarityFrame&) const {
      if (++*calls == 2) throw std::runtime_error("out of order");
      if (*calls > 2) return {};
      return {{.id = 0, .T_camera_marker = facing_pose({0, 0, 0.6})}};
    }
    bool shows(MarkerId, const Eigen::Isometry3d&) const { return *calls == 1; }
    MarkerModel model(MarkerId) const { return make_code_marker(simulated::kMarkerLength, simulated::code()); }
  };
  int calls = 0, thrown = 0;
  std::size_t poses = 0;
  Tracker tracker(simulated::camera, Ghost{&calls});
  for (const Event& event : events) try {
      poses += tracker.push(event).size();
    } catch (const std::runtime_error&) {
      ++thrown;
    }
  CHECK(thrown == 1);
  CHECK(calls > 10);
  CHECK(poses == 0);
  CHECK(tracker.statistics().registered == 0);
  CHECK(tracker.statistics().events == events.size());
}

TEST_CASE("once all markers of the detector are tracked, detections are rare until one is lost") {
  struct Enumerating : TrueDetector {
    std::vector<MarkerId> all;
    std::vector<Timestamp>* asked;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame, std::span<const PlacedMarker> tracked) const {
      asked->push_back(frame.t());
      for (const PlacedMarker& marker : tracked) {
        CHECK(marker.id == 0);
        CHECK((marker.T_camera_marker.translation() - motion(seconds(frame.t())).translation()).norm() < 0.005);
      }
      return TrueDetector::detect(frame);
    }
    using TrueDetector::detect;
    std::vector<MarkerId> ids() const { return all; }
  };
  const Trajectory motion = simulated::near_motion(59);
  const auto events = simulated::near_events(motion, 0.8, 59);
  const auto asked_with = [&](std::vector<MarkerId> all) {
    std::vector<Timestamp> asked;
    Tracker tracker(simulated::camera, Enumerating{{motion}, std::move(all), &asked});
    std::vector<PoseEstimate> poses;
    tracker.push(events, [&](const PoseEstimate& pose) { poses.push_back(pose); });
    CHECK(poses.size() > 3000);
    CHECK(tracker.statistics().registered == 1);
    CHECK(tracker.statistics().lost == 0);
    return asked;
  };
  const auto with_others = asked_with({0, 1}), alone = asked_with({0});
  CHECK(with_others.size() > 30);  // every 25 ms at least
  REQUIRE(alone.size() > 4);
  CHECK(alone.size() < 10);
  CHECK(alone.back() - alone[alone.size() - 2] >= 250000);

  // Lost between two of them: an outage, that is told.
  std::vector<Timestamp> asked;
  Tracker tracker(simulated::camera, Enumerating{{motion}, {0}, &asked});
  Timestamp lost = 0;
  for (const Event& event : events) {
    if (event.t > 300000 && event.t < 340000) continue;
    for (const PoseEstimate& pose : tracker.push(event))
      if (pose.quality.state == TrackingState::lost) lost = pose.t;
  }
  REQUIRE(lost > 0);
  const auto next = std::ranges::upper_bound(asked, Timestamp(340000));
  REQUIRE(next != asked.end());
  CHECK(*next < 350000);
  CHECK(tracker.statistics().registered == 2);
}

TEST_CASE("a detector need not tell corners and times") {
  const Trajectory motion = simulated::near_motion(58);
  const auto events = simulated::near_events(motion, 0.2, 58);
  struct Terse {
    Trajectory motion;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
      return {{.id = 0, .T_camera_marker = motion(seconds(frame.t()))}};
    }
    MarkerModel model(MarkerId) const { return make_code_marker(simulated::kMarkerLength, simulated::code()); }
  };
  Tracker terse(simulated::camera, Terse{motion});
  Tracker talkative(simulated::camera, TrueDetector{motion});
  const auto a = track(terse, events), b = track(talkative, events);
  REQUIRE(a.size() > 500);
  REQUIRE(a.size() == b.size());
  CHECK(a.back().T_camera_marker.matrix() == b.back().T_camera_marker.matrix());
}

TEST_CASE("poses from which no tracker can start are counted and left out, the others are tracked") {
  const Trajectory motion = simulated::near_motion(58);
  const auto events = simulated::near_events(motion, 0.2, 58);
  struct Hostile {
    Trajectory motion;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
      const Eigen::Isometry3d T = motion(seconds(frame.t()));
      Eigen::Isometry3d none = T, behind = T, mirrored = T, away = T;
      none.translation().z() = NAN;
      behind.translation().z() *= -1;
      mirrored.linear().col(0) *= -1;
      away.linear() = T.linear() * so3_exp({0, 3, 0});
      return {{.id = 0, .T_camera_marker = none, .T_camera_marker_alternative = T},
              {.id = 1, .T_camera_marker = behind},
              {.id = 2, .T_camera_marker = mirrored, .T_camera_marker_alternative = none},
              {.id = 3, .T_camera_marker = away},
              {.id = 4, .T_camera_marker = T}};
    }
    MarkerModel model(MarkerId id) const {
      return id == 4 ? MarkerModel() : make_code_marker(simulated::kMarkerLength, simulated::code());
    }
  };
  Tracker tracker(simulated::camera, Hostile{motion});
  AccuracyMeter meter;
  for (const PoseEstimate& pose : track(tracker, events)) {
    CHECK(pose.id == 0);
    meter.add(pose, motion(seconds(pose.t)));
  }
  REQUIRE(meter.tracking() > 500);
  CHECK(meter.translation_mm().mean < 2);
  CHECK(tracker.statistics().unusable_poses > 10);
}

TEST_CASE("a tracker that follows something else gives way to its marker's detections elsewhere") {
  const Trajectory followed = simulated::near_motion(58);
  const auto events = simulated::near_events(followed, 0.6, 58);
  // From 0.2 s on, the detector finds the code elsewhere, in some frames or in all of them.
  struct Elsewhere {
    Trajectory motion;
    int every;
    int frames = 0;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
      Eigen::Isometry3d T = motion(seconds(frame.t()));
      if (frame.t() > 200000 && ++frames % every == 0) T.translation().x() += 0.2;
      return {{.id = 0, .T_camera_marker = T}};
    }
    MarkerModel model(MarkerId) const { return make_code_marker(simulated::kMarkerLength, simulated::code()); }
  };
  Tracker misled(simulated::camera, Elsewhere{followed, 2});
  track(misled, events);
  CHECK(misled.statistics().lost == 0);
  Tracker tracker(simulated::camera, Elsewhere{followed, 1});
  const auto poses = track(tracker, events);
  const auto lost = std::ranges::find(poses, TrackingState::lost, [](const auto& pose) { return pose.quality.state; });
  REQUIRE(lost != poses.end());
  CHECK(lost->quality.loss_reason == LossReason::replaced);
  CHECK(lost->t > 200000);
  CHECK(lost->t < 400000);
}

TEST_CASE("events off the sensor and steps back in time are counted and survived") {
  const Trajectory motion = simulated::near_motion(57);
  auto events = simulated::near_events(motion, 0.2, 57);
  const auto undisturbed = events;
  events.insert(events.begin() + 1000, Event{640, 0, 1, events[1000].t});
  events.insert(events.begin() + 2000, Event{0, 480, 0, events[2000].t});
  Tracker tracker(simulated::camera, TrueDetector{motion}), reference(simulated::camera, TrueDetector{motion});
  const auto poses = track(tracker, events);
  REQUIRE(poses.size() > 300);
  CHECK(poses.size() == track(reference, undisturbed).size());
  CHECK(tracker.statistics().off_sensor == 2);
  CHECK(tracker.statistics().time_steps_back == 0);

  // The camera is restarted: its clock begins again. Markers are still found and tracked.
  const auto again = track(tracker, undisturbed);
  CHECK(tracker.statistics().time_steps_back == 1);
  CHECK(again.size() > 300);
}

TEST_CASE("times at the ends of their range do no harm") {
  const Trajectory motion = simulated::near_motion(61);
  const auto events = simulated::near_events(motion, 0.1, 61);
  Tracker tracker(simulated::camera, TrueDetector{motion}, TrackerSettings<>{.detections_to_confirm = 1}, AcceptAll{});
  REQUIRE(!track(tracker, events).empty());
  int poses = 0;
  constexpr auto kFirst = std::numeric_limits<Timestamp>::min(), kLast = std::numeric_limits<Timestamp>::max();
  for (std::size_t i = 0; i < events.size(); ++i) {  // real places, times that jump to and fro, each for ten events
    Event event = events[i];
    event.t = i / 10 % 3 == 0 ? kLast : i / 10 % 3 == 1 ? kFirst : event.t;
    for (const PoseEstimate& pose : tracker.push(event)) {
      ++poses;
      CHECK(pose.T_camera_marker.matrix().allFinite());
    }
  }
  CHECK(poses > 0);
  CHECK(tracker.statistics().events == 2 * events.size());
  CHECK(tracker.statistics().time_steps_back > events.size() / 40);
}

TEST_CASE_TEMPLATE("a recording that is played on end, and whose ends meet, never loses its marker", Rule,
                   DecoupledUpdate, KalmanUpdate) {
  constexpr Timestamp kRound = 1000000;
  const Trajectory motion = [](double s) {  // repeats itself every second
    const double w = 2 * std::numbers::pi * s;
    return facing_pose({0.08 * std::sin(w + 1), 0.06 * std::sin(2 * w + 2), 0.6 + 0.06 * std::cos(w)},
                       {0.3 * std::sin(w), 0.3 * std::cos(w + 1), 0.2 * std::sin(2 * w)});
  };
  const auto events = simulated::near_events(motion, 1e-6 * kRound, 66);
  Tracker<TrueDetector, Rule> tracker(simulated::camera, TrueDetector{motion});
  AccuracyMeter meter;
  const int rounds = kSanitized ? 2 : 6;
  for (int round = 0; round < rounds; ++round)
    for (Event event : events) {
      event.t += round * kRound;
      for (const PoseEstimate& pose : tracker.push(event)) meter.add(pose, motion(seconds(pose.t)));
    }
  REQUIRE(meter.tracking() > static_cast<std::size_t>(2000 * rounds));
  CHECK(tracker.statistics().registered == 1);
  CHECK(tracker.statistics().lost == 0);
  CHECK(meter.coverage(rounds * kRound) > 0.97);
}

TEST_CASE("several markers are tracked at once, each by its own id") {
  const auto place = [](double x, std::uint64_t seed) {
    return trajectory::handheld(
        {.T_centre = facing_pose({x, 0, 0.6}), .amplitude_m = {0.03, 0.06, 0.05}, .frequency_hz = 1.3, .seed = seed});
  };
  const std::map<MarkerId, Trajectory> motions{{0, place(-0.15, 58)}, {1, place(0.15, 59)}};
  std::vector<SimulatedMarker> markers;
  for (const auto& [id, motion] : motions)
    markers.push_back({.id = id, .length = 0.10, .bits = simulated::code(id), .T_camera_marker = motion});
  const auto events = simulated::record(simulated::camera, markers, SimulatorSettings{.duration_s = 1, .seed = 58});
  Tracker tracker(simulated::camera, aruco());
  std::map<MarkerId, AccuracyMeter> meters;
  for (const PoseEstimate& pose : track(tracker, events)) {
    REQUIRE(motions.contains(pose.id));
    meters[pose.id].add(pose, motions.at(pose.id)(seconds(pose.t)));
  }
  REQUIRE(meters.size() == 2);
  for (const auto& of_marker : meters) {
    CAPTURE(of_marker.first);
    const AccuracyMeter& meter = of_marker.second;
    CHECK(meter.tracking() > 1000);
    CHECK(meter.translation_mm().mean < 6);
    CHECK(meter.rotation_deg().mean < 2.5);
  }
}

TEST_CASE("a marker that another one covers in part is followed by its own edges, not by the other's paper") {
  const auto sway = [](const Eigen::Vector3d& centre, const Eigen::Vector3d& amplitude_m, std::uint64_t seed) {
    return trajectory::handheld(
        {.T_centre = facing_pose(centre), .amplitude_m = amplitude_m, .frequency_hz = 1.3, .seed = seed});
  };
  constexpr double kHalf = simulated::kMarkerLength / 2, kHalfPaper = kHalf * 8 / 6;  // with a rim of one of six cells
  for (const std::uint64_t seed : {62u, 63u, 65u}) {
    if (kSanitized && seed != 62) break;
    CAPTURE(seed);
    const Trajectory behind = sway({-0.03, 0, 0.62}, {0.02, 0.02, 0.02}, seed);
    const Trajectory before = sway({0.10, 0, 0.55}, {0.03, 0.04, 0.02}, seed + 100);
    const auto covered_share = [&](double s) {
      constexpr int kPoints = 21;
      const Eigen::Isometry3d T_paper_camera = before(s).inverse();
      int covered = 0;
      for (int i = 0; i < kPoints * kPoints; ++i) {
        const Eigen::Vector3d on_marker(kHalf * (i % kPoints - 10) / 10.0, kHalf * (i / kPoints - 10) / 10.0, 0);
        const Eigen::Vector3d point = T_paper_camera * (behind(s) * on_marker), eye = T_paper_camera.translation();
        const Eigen::Vector3d on_sheet = eye + eye.z() / (eye.z() - point.z()) * (point - eye);
        covered += point.z() < 0 && on_sheet.head<2>().cwiseAbs().maxCoeff() < kHalfPaper;
      }
      return covered / static_cast<double>(kPoints * kPoints);
    };
    std::vector<double> covered;  // by 10 ms
    for (int i = 0; i < 151; ++i) covered.push_back(covered_share(0.01 * i));
    REQUIRE(std::ranges::count_if(covered, [](double share) { return share > 0.05; }) > 10);
    REQUIRE(std::ranges::max(covered) < 0.35);

    const auto events = simulated::record(
        simulated::camera,
        {{.id = 0, .length = simulated::kMarkerLength, .bits = simulated::code(0), .T_camera_marker = behind},
         {.id = 1, .length = simulated::kMarkerLength, .bits = simulated::code(1), .T_camera_marker = before}},
        SimulatorSettings{.duration_s = 1.5, .seed = seed});
    Tracker tracker(simulated::camera, aruco());
    AccuracyMeter meter;
    int while_covered = 0;
    for (const PoseEstimate& pose : track(tracker, events)) {
      if (pose.id != 0) continue;
      while_covered += covered[static_cast<std::size_t>(pose.t / 10000)] > 0.05;
      meter.add(pose, behind(seconds(pose.t)));
    }
    CHECK(while_covered > 300);
    CHECK(tracker.statistics().lost == 0);
    CHECK(meter.translation_mm().max < 3);
    CHECK(meter.rotation_deg().max < 3);
  }
}

namespace {

// 1.2 m away and tilted, the marker looks almost the same tilted the other way.
const Trajectory kTilted = trajectory::handheld({.T_centre = facing_pose({0, 0, 1.2}, {0.5, 0.2, 0}),
                                                 .amplitude_m = {0.15, 0.12, 0.1},
                                                 .amplitude_rad = {0.05, 0.05, 0.1},
                                                 .frequency_hz = 1.3,
                                                 .seed = 60});

}  // namespace

TEST_CASE("a marker that was found at the mirrored tilt, for sure, is not announced there") {
  // As behind something that just leaves it: once. It is followed there, for its image is nearly the same.
  struct MistakenOnce : TrueDetector {
    int frames = 0;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
      auto found = TrueDetector::detect(frame);
      if (++frames == 1) found[0].T_camera_marker = mirrored(found[0].T_camera_marker);
      return found;
    }
  };
  const auto events = simulated::near_events(kTilted, 0.3, 62);
  Tracker tracker(simulated::camera, MistakenOnce{{kTilted}});
  AccuracyMeter meter;
  for (const PoseEstimate& pose : track(tracker, events)) meter.add(pose, kTilted(seconds(pose.t)));
  REQUIRE(meter.tracking() > 200);
  MESSAGE("first pose after " << meter.first_t() << " us, at most " << meter.rotation_deg().max << " deg off");
  CHECK(meter.rotation_deg().max < 10);
}

TEST_CASE("of a planar marker's two poses, the events choose the right one") {
  struct MistakenDetector {  // takes the mirrored pose for the likelier one
    TrueDetector knowing;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
      auto found = knowing.detect(frame);
      found[0].T_camera_marker_alternative = found[0].T_camera_marker;
      found[0].T_camera_marker = mirrored(found[0].T_camera_marker);
      return found;
    }
    MarkerModel model(MarkerId id) const { return knowing.model(id); }
  };
  const auto events = simulated::near_events(kTilted, 0.6, 60);
  Tracker tracker(simulated::camera, MistakenDetector{{kTilted}},
                  {.detections_to_confirm = 1});  // poses from the start
  AccuracyMeter meter;
  double first_error_deg = 0;
  for (const PoseEstimate& pose : track(tracker, events)) {
    if (meter.poses() == 0) first_error_deg = pose_error(pose.T_camera_marker, kTilted(seconds(pose.t))).rotation_deg;
    meter.add(pose, kTilted(seconds(pose.t)));
  }
  REQUIRE(first_error_deg > 30);
  REQUIRE(meter.tracking() > 500);
  CHECK(meter.rotation_deg().mean < 3);
  CHECK(meter.wild() == 0);
}

TEST_CASE("motion that hardly shows in the image is followed: along the line of sight, nodding, and far away") {
  if (kSanitized) return;
  const auto tracked = [](const Trajectory& motion, std::uint64_t seed) {
    Tracker tracker(simulated::camera, TrueDetector{motion});
    AccuracyMeter meter;
    tracker.push(simulated::near_events(motion, 2, seed),
                 [&](const PoseEstimate& pose) { meter.add(pose, motion(seconds(pose.t))); });
    MESSAGE("seed " << seed << ": " << meter.translation_mm().mean << " mm, " << meter.rotation_deg().mean
                    << " deg, at most " << meter.translation_mm().max << " mm, " << meter.rotation_deg().max
                    << " deg, NEES " << meter.nees().mean);
    return meter;
  };
  constexpr double kTurn = 2 * std::numbers::pi;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    CAPTURE(seed);
    const AccuracyMeter along = tracked(
        [=](double t) {
          return facing_pose({0.02, 0.01, 1 + 0.4 * std::cos(kTurn * t)});
        },
        seed);
    CHECK(along.tracking() > 2000);
    CHECK(along.wild() == 0);
    CHECK(along.translation_mm().mean < 2);
    CHECK(along.nees().mean < 2.5);
    const AccuracyMeter nodding = tracked(
        [=](double t) {
          return facing_pose({0.02, 0.01, 0.6}, {0.5 * std::sin(2 * kTurn * t), 0, 0});
        },
        seed);
    CHECK(nodding.tracking() > 1500);
    CHECK(nodding.wild() == 0);
    CHECK(nodding.rotation_deg().mean < 0.9);
    CHECK(nodding.nees().mean < 6);
    const AccuracyMeter far = tracked(trajectory::handheld({.T_centre = facing_pose({0, 0, 1.5}),
                                                            .amplitude_m = {0.1, 0.08, 0.1},
                                                            .amplitude_rad = {0.5, 0.5, 0.3},
                                                            .seed = seed}),
                                      seed);
    CHECK(far.tracking() > 3000);
    CHECK(far.wild() == 0);
    CHECK(far.rotation_deg().mean < 0.8);
    CHECK(far.nees().mean < 1);
  }
}

TEST_CASE("a marker that comes nearer from afar is not tilted to the wrong side, and states by how much it lags") {
  if (kSanitized) return;
  for (const std::uint64_t seed : {1u, 4u, 9u}) {  // at 3 m, a marker of 18 px
    std::mt19937 random(static_cast<unsigned>(seed));
    std::uniform_real_distribution<double> unit(0, 1);
    const double tilt = 0.15 + 0.45 * unit(random), direction = 2 * std::numbers::pi * unit(random),
                 roll = unit(random), speed = 0.4 + 0.4 * unit(random);
    const double nod = 0.15 * unit(random), hz = 0.5 + unit(random);
    const Trajectory motion = [=](double t) {
      const double now = tilt + nod * std::sin(2 * std::numbers::pi * hz * t);
      return facing_pose({0.1, 0.05, 3 - speed * t}, {now * std::cos(direction), now * std::sin(direction), roll});
    };
    Tracker tracker(simulated::camera, TrueDetector{motion});
    int poses = 0, wrong = 0, off = 0;
    AccuracyMeter meter;  // of the poses that are called tracking
    Timestamp next = 0;
    tracker.push(simulated::near_events(motion, 4, seed), [&](const PoseEstimate& pose) {
      if (pose.quality.state == TrackingState::lost || pose.t < next) return;
      next = pose.t + 1000;
      ++poses;
      const Eigen::Isometry3d truth = motion(seconds(pose.t));
      meter.add(pose, truth);
      const double angle = geodesic_angle(pose.T_camera_marker.linear(), truth.linear());
      wrong += angle > geodesic_angle(pose.T_camera_marker.linear(), mirrored(truth).linear());
      off += pose.t > 1'000'000 && angle > 12 / 180.0 * std::numbers::pi;
    });
    MESSAGE("seed " << seed << ": " << wrong << " of " << poses << " ms at the wrong side, " << off << " ms off, "
                    << meter.translation_mm().mean << " mm, NEES " << meter.nees().mean);
    REQUIRE(poses > 600);
    CHECK(wrong == 0);
    CHECK(off == 0);
    REQUIRE(meter.tracking() > 300);
    CHECK(meter.nees().mean < 1.2);
  }
}

TEST_CASE("settings out of range are named") {
  const auto make = [](const TrackerSettings<>& settings) {
    return Tracker(simulated::camera, TrueDetector{trajectory::still(facing_pose({0, 0, 1}))}, settings);
  };
  using namespace std::chrono_literals;
  CHECK_THROWS_WITH(make({.detection_interval = 0us}), doctest::Contains("detection_interval"));
  CHECK_THROWS_WITH(make({.detection_latency = -1us}), doctest::Contains("detection_latency"));
  CHECK_THROWS_WITH(make({.detections_to_confirm = 0}), doctest::Contains("detections_to_confirm is 0"));
  CHECK_THROWS_WITH(make({.max_markers = 0}), doctest::Contains("max_markers is 0"));
  CHECK_THROWS_WITH(make({.history_events = 0}), doctest::Contains("history_events is 0"));
  CHECK_NOTHROW(make({.filter_window = kAutomaticWindow}));
  CHECK_THROWS_WITH(make({.filter_window = -1us}), doctest::Contains("window is -1 us"));
  CHECK_THROWS_WITH(make({.history_events = 0}), doctest::Contains("history"));
  // Before any marker is found: `push` cannot throw for a setting.
  CHECK_THROWS_WITH(make({.marker = {.events_per_update = -1}}), "edge follower: events_per_update is -1");
  CHECK_THROWS_WITH(make({.marker = {.matching = {.max_distance_px = 0}}}), doctest::Contains("max_distance_px is 0"));
  CHECK_THROWS_WITH(make({.marker = {.update = {.inflation = -1}}}),
                    doctest::Contains("kalman update: inflation is -1"));
  CHECK_THROWS_WITH(make({.marker = {.verification = {.every = 0}}}), "verification: every is 0");
  CHECK_THROWS_WITH(make({.marker = {.health = {.false_alarm_rate = 1}}}), doctest::Contains("false_alarm_rate is 1"));
  CHECK_THROWS_WITH(make({.marker = {.converging_events = -1}}), "marker tracker: converging_events is -1");
  CHECK_THROWS_WITH(make({.marker = {.start_search = StartPoseSearchSettings{.false_alarms = 2}}}),
                    doctest::Contains("start search: false_alarms is 2"));
}
