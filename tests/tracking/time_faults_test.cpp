// Single events with wrong times, through whole trackers.
#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "evmarker/tracking/tracker.hpp"
#include "sanitized.hpp"
#include "simulated.hpp"

using namespace evmarker;
using simulated::TrueDetector;

namespace {

const Trajectory& motion() {
  static const Trajectory motion = simulated::near_motion(91);
  return motion;
}

// 60 ms of marker 0.
const std::vector<Event>& events() {
  static const std::vector<Event> events = simulated::near_events(motion(), 0.06, 91);
  return events;
}

// Two markers at once: one detector's answer for both, at the same place.
struct TwoMarkers {
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
    auto found = TrueDetector{motion()}.detect(frame);
    found.push_back(found.front());
    found.back().id = 1;
    return found;
  }
  MarkerModel model(MarkerId) const { return make_code_marker(simulated::kMarkerLength, simulated::code()); }
};

const std::vector<Timestamp> kJumps_us{1000, 20000, 1000000, Timestamp{1} << 32, Timestamp{1} << 40};

// The events with one more, of the same place as number `at`, at a wrong time.
std::vector<Event> with_fault(const std::vector<Event>& right, std::size_t at, Timestamp by) {
  std::vector<Event> events = right;
  Event wrong = right[at];
  wrong.t += by;
  events.insert(events.begin() + static_cast<std::ptrdiff_t>(at), wrong);
  return events;
}

template <typename T>
std::vector<PoseEstimate> one_by_one(T& tracker, const std::vector<Event>& events) {
  std::vector<PoseEstimate> poses;
  for (const Event& event : events) {
    if constexpr (requires { tracker.markers(); }) {
      for (const PoseEstimate& pose : tracker.push(event)) poses.push_back(pose);
    } else if (const PoseEstimate* const pose = tracker.push(event)) {
      poses.push_back(*pose);
    }
  }
  return poses;
}

template <typename T>
std::vector<PoseEstimate> in_ranges(T& tracker, std::span<const Event> events, std::size_t piece) {
  std::vector<PoseEstimate> poses;
  for (; !events.empty(); events = events.subspan(std::min(piece, events.size())))
    tracker.push(events.first(std::min(piece, events.size())),
                 [&](const PoseEstimate& pose) { poses.push_back(pose); });
  return poses;
}

void require_same(const std::vector<PoseEstimate>& a, const std::vector<PoseEstimate>& b) {
  REQUIRE(a.size() == b.size());
  const auto same = [](const PoseEstimate& l, const PoseEstimate& r) {
    return l.id == r.id && l.t == r.t && l.T_camera_marker.matrix() == r.T_camera_marker.matrix() &&
           l.covariance == r.covariance && l.quality.state == r.quality.state;
  };
  REQUIRE(std::ranges::equal(a, b, same));
}

// Numbers of events: some anywhere, and those that complete a pose.
std::vector<std::size_t> places(const std::vector<Event>& events, const std::vector<PoseEstimate>& poses) {
  std::vector<std::size_t> places{events.size() / 3, events.size() / 2 + 7};
  for (const std::size_t pose : {poses.size() / 2, poses.size() * 3 / 4})
    for (std::size_t i = 0; i < events.size(); ++i)
      if (events[i].t == poses[pose].t) places.push_back(i);
  return places;
}

template <typename Make>
void check_single_faults(const Make& make, std::size_t fewest_poses) {
  auto undisturbed = make();
  const auto expected = one_by_one(undisturbed, events());
  REQUIRE(expected.size() > fewest_poses);
  std::size_t piece = 1, trial = 0;
  for (const std::size_t at : places(events(), expected))
    // At each place another third of all jumps, or twelfth under a sanitizer: together they take too long.
    for (const Timestamp jump : kJumps_us)
      for (const Timestamp by : {jump, -jump}) {
        if (++trial % (kSanitized ? 12 : 3) != 0) continue;
        CAPTURE(at);
        CAPTURE(by);
        const auto faulty = with_fault(events(), at, by);
        auto one = make(), many = make();
        require_same(one_by_one(one, faulty), expected);
        require_same(in_ranges(many, faulty, piece = piece % 997 + 48), expected);
        if constexpr (requires { one.time_faults(); }) {
          CHECK(one.time_faults() == 1);
          CHECK(many.time_faults() == 1);
        } else {
          CHECK(one.statistics().time_faults == 1);
          CHECK(many.statistics().time_faults == 1);
          CHECK(one.statistics().events == faulty.size());
          CHECK(many.statistics().filtered == one.statistics().filtered);
          CHECK(many.statistics().time_steps_back == 0);
        }
      }
}

}  // namespace

TEST_CASE("a single wrong time changes nothing in the tracker of many markers") {
  for (const int n : {1, 10, 100}) {
    CAPTURE(n);
    TrackerSettings<> settings;
    settings.marker.events_per_update = n;
    check_single_faults([&] { return Tracker(simulated::camera, TrueDetector{motion()}, settings); },
                        static_cast<std::size_t>(3000 / n));
  }
}

TEST_CASE("a single wrong time changes nothing while several markers are tracked") {
  check_single_faults([] { return Tracker(simulated::camera, TwoMarkers()); }, 100);
}

TEST_CASE("a single wrong time changes nothing in the tracker of one marker") {
  for (const int n : {1, 10, 100}) {
    CAPTURE(n);
    check_single_faults(
        [&] {
          return MarkerTracker<>(simulated::camera, make_code_marker(simulated::kMarkerLength, simulated::code()),
                                 motion()(0), {.events_per_update = n, .start_search = std::nullopt});
        },
        static_cast<std::size_t>(3000 / n));
  }
}

TEST_CASE("a jump of the clock that lasts is followed, one by one as in ranges") {
  for (const Timestamp jump : kJumps_us)
    for (const Timestamp by : {jump, -jump}) {
      CAPTURE(by);
      auto jumping = events();
      for (std::size_t i = jumping.size() / 2; i < jumping.size(); ++i) jumping[i].t += by;
      const double jump_s = 1e-6 * static_cast<double>(by);
      const auto seen = [=](double t) { return motion()(by > 0 && t > 0.03 + jump_s / 2 ? t - jump_s : t); };
      Tracker one(simulated::camera, TrueDetector{seen}), many = one;
      const auto poses = one_by_one(one, jumping);
      require_same(in_ranges(many, jumping, 777), poses);
      CHECK(one.statistics().time_faults == 0);
      CHECK(one.statistics().time_steps_back == (by < 0));
      CHECK(one.statistics().outages == (by > 0 ? 1 : 0));  // what a clock that steps forward looks like
      REQUIRE(!poses.empty());
      CHECK(poses.back().t > jumping.back().t - 20000);
      CHECK(poses.back().quality.state == TrackingState::tracking);
    }
}

TEST_CASE("events that come one in a millisecond each wait for the next one, and none is lost") {
  std::vector<Event> sparse;
  for (std::size_t i = 0; i < events().size(); i += 30) sparse.push_back(events()[i]);
  for (std::size_t i = 0; i < sparse.size(); ++i) sparse[i].t = static_cast<Timestamp>(1000 * i);
  TrackerSettings<> settings;
  settings.filter_window = std::chrono::milliseconds(50);
  Tracker one(simulated::camera, TrueDetector{trajectory::still(motion()(0.03))}, settings), many = one;
  const auto poses = one_by_one(one, sparse);
  require_same(in_ranges(many, sparse, 100), poses);
  CHECK(one.statistics().events == sparse.size());
  CHECK(one.statistics().time_faults == 0);
  CHECK(one.statistics().filtered == many.statistics().filtered);
  CHECK(one.statistics().detections == many.statistics().detections);
}
