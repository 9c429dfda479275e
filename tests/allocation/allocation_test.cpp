#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <new>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "evmarker/tracking/wireframe_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "sanitized.hpp"
#include "simulated.hpp"

namespace {

std::atomic<std::size_t> allocations{0}, deallocations{0};

void* counted(std::size_t size, std::size_t alignment) {
  ++allocations;
  const std::size_t rounded = (size + alignment - 1) / alignment * alignment;
  void* const memory = std::aligned_alloc(alignment, rounded > 0 ? rounded : alignment);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

void freed(void* memory) noexcept {
  deallocations += memory != nullptr;
  std::free(memory);
}

}  // namespace

void* operator new(std::size_t size) { return counted(size, __STDCPP_DEFAULT_NEW_ALIGNMENT__); }
void* operator new[](std::size_t size) { return counted(size, __STDCPP_DEFAULT_NEW_ALIGNMENT__); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t size, std::align_val_t alignment) {
  return counted(size, static_cast<std::size_t>(alignment));
}
// The default forms that do not throw call those above, but not under AddressSanitizer, which has its own.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept try {
  return operator new(size);
} catch (const std::bad_alloc&) {
  return nullptr;
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept try {
  return operator new[](size);
} catch (const std::bad_alloc&) {
  return nullptr;
}
void operator delete(void* memory) noexcept { freed(memory); }
void operator delete[](void* memory) noexcept { freed(memory); }
void operator delete(void* memory, std::size_t) noexcept { freed(memory); }
void operator delete[](void* memory, std::size_t) noexcept { freed(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { freed(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { freed(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { freed(memory); }
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept { freed(memory); }

using namespace evmarker;

namespace {

// What goes through `new`: containers, and whatever a later change may bring. Eigen takes memory past it, for matrices
// of dynamic size only.
struct Count {
  std::size_t before = allocations, freed_before = deallocations;
  std::size_t taken() const { return allocations - before; }
  std::size_t given_back() const { return deallocations - freed_before; }
};

constexpr std::size_t kEvents = kSanitized ? 100'000 : 1'000'000;

// Filtered events of 1.2 s, gone through again and again.
struct Recording {
  Trajectory motion = simulated::near_motion(71);
  std::vector<Event> events = simulated::near_events(motion, 1.2, 71);
  std::vector<Event> filtered = simulated::filtered(events);
};

const Recording& recording() {
  static const Recording recording;
  return recording;
}

// Finds the marker in its first frame, wherever it is then.
struct FirstFrame {
  bool detected = false;
  std::size_t* frames;
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
    ++*frames;
    std::vector<MarkerDetection> detections;
    if (std::exchange(detected, true)) return detections;
    MarkerDetection detection;
    detection.id = 7;
    detection.t = frame.t();
    detection.T_camera_marker = recording().motion(1e-6 * static_cast<double>(frame.t()));
    for (std::size_t corner = 0; corner < 4; ++corner)
      detection.corners_px[corner] = simulated::camera.project(
          detection.T_camera_marker * make_square_marker(simulated::kMarkerLength).vertices[corner]);
    detections.push_back(detection);
    return detections;
  }
  MarkerModel model(MarkerId) const { return make_code_marker(simulated::kMarkerLength, simulated::code()); }
};

}  // namespace

TEST_CASE("the counter counts") {
  const Count count;
  {
    std::vector<double> numbers(static_cast<std::size_t>(std::rand() % 2 + 5));
    numbers.front() = 1;
  }
  CHECK(count.taken() == 1);
  CHECK(count.given_back() == 1);
}

TEST_CASE_TEMPLATE("many events through a marker's tracker, verification included, without an allocation", Rule,
                   DecoupledUpdate, KalmanUpdate) {
  for (const int n : {1, 100}) {
    CAPTURE(n);
    const auto& events = recording().filtered;
    REQUIRE(events.size() > 100'000);
    const MarkerTracker<Rule> start(simulated::camera, make_code_marker(simulated::kMarkerLength, simulated::code()),
                                    recording().motion(0), {.events_per_update = n});
    std::size_t pushed = 0, poses = 0, lost = 0, verifications = 0;
    while (pushed < kEvents) {
      MarkerTracker<Rule> tracker = start;  // the recording once more
      Timestamp verified = 0;
      const Count count;
      for (const Event& event : events) {
        const auto pose = tracker.push(event);
        if (!pose) continue;
        ++poses;
        lost += pose->quality.state == TrackingState::lost;
        verifications += pose->quality.backtrack_t != std::exchange(verified, pose->quality.backtrack_t);
      }
      pushed += events.size();
      REQUIRE(count.taken() == 0);
      REQUIRE(count.given_back() == 0);
      CHECK(tracker.state() == TrackingState::tracking);

      MarkerTracker<Rule> together = start;
      const Count count_together;
      together.push(events, [](const PoseEstimate&) {});
      REQUIRE(count_together.taken() == 0);
      REQUIRE(count_together.given_back() == 0);
      CHECK(together.state() == TrackingState::tracking);
    }
    CHECK(pushed >= kEvents);
    CHECK(poses > pushed / static_cast<std::size_t>(2 * n));
    CHECK(verifications > 50);  // every other window
    CHECK(lost == 0);
  }
}

TEST_CASE("events of a board are tracked and verified without an allocation, one by one and together") {
  Board board{.id = 9, .markers = {}};
  for (const int side : {-1, 1}) {
    board.markers.push_back({.id = side, .length = 0.06, .bits = simulated::code(side > 0)});
    board.markers.back().T_board_marker.translation().x() = 0.04 * side;
  }
  const Trajectory motion = simulated::near_motion(91);
  const auto events = simulated::record(simulated::camera, simulated_markers(board, motion),
                                        SimulatorSettings{.duration_s = 0.3, .seed = 91});
  REQUIRE(events.size() > 100'000);
  const MarkerTracker<> start(simulated::camera, make_board_model(board), motion(0));
  REQUIRE(start.follower().matcher().board() != nullptr);
  for (const std::size_t piece : {std::size_t{1}, events.size()}) {
    MarkerTracker<> tracker = start;
    Timestamp verified = 0;
    int poses = 0, verifications = 0;
    const Count count;
    for (auto rest = std::span<const Event>(events); !rest.empty(); rest = rest.subspan(piece))
      tracker.push(rest.first(piece), [&](const PoseEstimate& pose) {
        ++poses;
        verifications += pose.quality.backtrack_t != std::exchange(verified, pose.quality.backtrack_t);
      });
    REQUIRE(count.taken() == 0);
    REQUIRE(count.given_back() == 0);
    CHECK(poses > 1000);
    CHECK(verifications > 5);
    CHECK(tracker.state() == TrackingState::tracking);
  }
}

TEST_CASE("many events through the tracker of all markers without an allocation between detections") {
  constexpr std::chrono::microseconds kLatency{3000};
  std::size_t pushed = 0, poses = 0, frames = 0;
  while (pushed < kEvents) {
    Tracker<FirstFrame> tracker(simulated::camera, FirstFrame{.frames = &frames},
                                {.detection_latency = kLatency, .detections_to_confirm = 1});
    std::size_t before = 0, allocating_pushes = 0, frames_seen = frames, settled_poses = 0;
    std::optional<Timestamp> first_frame;
    bool registered = false;
    for (const Event& event : recording().events) {
      const Count count;
      const std::span<const PoseEstimate> found = tracker.push(event);
      ++pushed;
      poses += found.size();
      const bool detected = frames != std::exchange(frames_seen, frames);
      const std::size_t tracked = tracker.statistics().registered;
      const bool began = tracked != std::exchange(before, tracked);
      if (detected && !first_frame) first_frame = event.t;
      const bool registers = !registered && first_frame && event.t >= *first_frame + kLatency.count();
      registered = registered || registers;
      if (!detected && !registers && !began) {
        allocating_pushes += count.taken() > 0 || count.given_back() > 0;
        settled_poses += found.size();
      }
    }
    REQUIRE(tracker.statistics().registered == 1);
    CHECK(allocating_pushes == 0);
    CHECK(settled_poses > 500);
  }
  CHECK(frames > (kSanitized ? 10 : 30));
  CHECK(poses > 1000);
}

// Finds the marker at both of its poses, and once it is lost, again.
struct BothPoses {
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
    const Eigen::Isometry3d T = recording().motion(1e-6 * static_cast<double>(frame.t()));
    Eigen::Isometry3d other = T;
    other.linear() = so3_exp({0.3, 0, 0}) * T.linear();
    return {{.id = 7, .T_camera_marker = other, .T_camera_marker_alternative = T}};
  }
  MarkerModel model(MarkerId) const { return make_code_marker(simulated::kMarkerLength, simulated::code()); }
};

TEST_CASE("no push allocates or frees: not where a marker is announced, one of its poses dropped, or it is lost") {
  // Every 0.2 s, the marker's events are scattered for 50 ms, so that it is lost and found again.
  std::vector<Event> events = recording().events;
  std::uint64_t state = 46;
  for (Event& event : events)
    if (event.t % 200000 > 150000) {
      state = state * 6364136223846793005u + 1442695040888963407u;
      event.x = static_cast<std::uint16_t>((state >> 33) % 640);
      event.y = static_cast<std::uint16_t>((state >> 45) % 480);
    }
  for (const std::size_t together : {1u, 100u}) {
    CAPTURE(together);
    TrackerCore<> core(simulated::camera, {.max_markers = 2}, SpatiotemporalFilter(simulated::camera.sensor_size()));
    BothPoses detector;
    std::size_t allocating = 0, pushes = 0, poses = 0;
    const auto use = [&](const PoseEstimate&) { ++poses; };
    bool due = false;
    Timestamp due_t = 0;
    const auto stop = [&](const Event& event) {
      due = core.detection_due(event.t);
      due_t = event.t;
      return due;
    };
    for (std::size_t i = 0; i < events.size();) {
      const auto batch = std::span(events).subspan(i, std::min(together, events.size() - i));
      const Count count;
      i += core.push(batch, stop, use);
      allocating += count.taken() > 0 || count.given_back() > 0;
      ++pushes;
      if (!due) continue;
      core.register_markers(answer_request(detector, core.polarity_frame(), core.request_detection(due_t)), use);
      due = false;
    }
    REQUIRE(core.statistics().registered >= 4);
    REQUIRE(core.statistics().lost >= 3);
    CHECK(poses > 1000);
    CHECK(pushes > events.size() / 150);
    CHECK(allocating == 0);
  }
}

TEST_CASE("events that come together are tracked without an allocation between detections, too") {
  constexpr std::chrono::microseconds kLatency{3000};
  std::size_t frames = 0, poses = 0, batches = 0, allocating = 0;
  Tracker<FirstFrame> tracker(simulated::camera, FirstFrame{.frames = &frames},
                              {.detection_latency = kLatency, .detections_to_confirm = 1});
  const auto& events = recording().events;
  std::optional<Timestamp> first_frame;
  for (std::size_t i = 0; i < events.size(); i += 100) {
    const auto batch = std::span(events).subspan(i, std::min<std::size_t>(100, events.size() - i));
    const std::size_t frames_before = frames, registered_before = tracker.statistics().registered;
    std::size_t told = 0;
    const Count count;
    tracker.push(batch, [&](const PoseEstimate&) { ++told; });
    const std::size_t taken = count.taken() + count.given_back();
    poses += told;
    if (frames != frames_before) first_frame = first_frame.value_or(batch.back().t);
    const bool registered = first_frame && batch.front().t > *first_frame + kLatency.count();
    if (frames != frames_before || tracker.statistics().registered != registered_before || !registered) continue;
    ++batches;
    allocating += taken > 0;
  }
  REQUIRE(tracker.statistics().registered == 1);
  CHECK(poses > 500);
  CHECK(batches > 500);
  CHECK(allocating == 0);
}

TEST_CASE("a body of edges is searched and followed without an allocation until it is lost") {
  const auto& events = recording().events;
  const WireframeTracker<KalmanUpdate> start(
      simulated::camera,
      Wireframe{200, make_code_marker(simulated::kMarkerLength, simulated::code()), recording().motion(0)});
  for (std::size_t pushed = 0; pushed < kEvents; pushed += events.size()) {
    WireframeTracker<KalmanUpdate> tracker = start;
    std::size_t poses = 0;
    const Count count;
    for (const Event& event : events) poses += tracker.push(event) != nullptr;
    REQUIRE(count.taken() == 0);
    REQUIRE(count.given_back() == 0);
    CHECK(poses > 500);
    REQUIRE(tracker.statistics().lost == 0);
  }
}
