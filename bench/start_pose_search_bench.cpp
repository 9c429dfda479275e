#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

// CPU time of this thread: other work on the machine is not counted.
double thread_us() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
}

// A tracker that searches its marker around a start that is off, and the events of the marker.
struct Search {
  MarkerTracker<KalmanUpdate> tracker;
  std::vector<Event> events;
};

Search prepare(const PinholeCamera& camera, double distance_m, double noise_hz_per_px) {
  const double sway_m = 0.02 * distance_m;
  const Trajectory motion = trajectory::handheld({.T_centre = facing_pose({0, 0, distance_m}),
                                                  .amplitude_m = {sway_m, sway_m, sway_m},
                                                  .frequency_hz = 1.3,
                                                  .seed = 3});
  SimulatedMarker marker;
  marker.id = bench::kDictionaryId;
  marker.bits = bench::code_bits();
  marker.T_camera_marker = motion;
  Simulator simulator(camera, {marker}, {.duration_s = 0.1, .seed = 3, .noise_hz_per_px = noise_hz_per_px});
  std::vector<Event> events;
  for_each_event(simulator, [&](const Event& event) { events.push_back(event); });

  Eigen::Isometry3d start = motion(0);
  start.translation() += Eigen::Vector3d(0.015, -0.005, 0.06 * distance_m);
  start.linear() = so3_exp({0.03, 0.03, 0.06}) * start.linear();
  return {MarkerTracker<KalmanUpdate>(camera, make_code_marker(marker.length, marker.bits), start), std::move(events)};
}

// Pushes events until the marker is found and the events since then are replayed, and times each push, clock included.
// Returns the index of the event that gave the first pose, or their number if there is none.
std::size_t push_until_found(MarkerTracker<KalmanUpdate>& tracker, const std::vector<Event>& events,
                             std::vector<double>& pushes_us) {
  for (std::size_t i = 0; i < events.size(); ++i) {
    const double before_us = thread_us();
    const PoseEstimate* const pose = tracker.push(events[i]);
    pushes_us.push_back(thread_us() - before_us);
    if (pose) return i;
  }
  return events.size();
}

void start_search(benchmark::State& state, const PinholeCamera& camera, double distance_m, double noise_hz_per_px) {
  const Search search = prepare(camera, distance_m, noise_hz_per_px);
  std::vector<double> pushes_us;
  std::size_t first = 0;
  for (auto _ : state) {
    MarkerTracker<KalmanUpdate> tracker = search.tracker;
    const double begin_us = thread_us();
    first = push_until_found(tracker, search.events, pushes_us);
    state.SetIterationTime((thread_us() - begin_us) * 1e-6);
    if (first == search.events.size()) return state.SkipWithError("the marker is not found");
  }
  std::ranges::sort(pushes_us);
  state.counters["longest_push_us"] = pushes_us.back();
  state.counters["p99.99_push_us"] =
      pushes_us[static_cast<std::size_t>(0.9999 * static_cast<double>(pushes_us.size()))];
  state.counters["median_push_us"] = pushes_us[pushes_us.size() / 2];
  state.counters["first_pose_ms"] = 1e-3 * static_cast<double>(search.events[first].t - search.events[0].t);
  state.counters["events"] = static_cast<double>(first + 1);
}

const PinholeCamera hd{{1280, 720}, 1066, 1066, 639.5, 359.5};

void run(benchmark::internal::Benchmark* b) { b->UseManualTime()->Unit(benchmark::kMillisecond); }
BENCHMARK_CAPTURE(start_search, vga, bench::camera(), 0.6, 1)->Name("start_search/640x480")->Apply(run);
BENCHMARK_CAPTURE(start_search, vga_noise, bench::camera(), 0.6, 10)->Name("start_search/640x480_10_Hz")->Apply(run);
BENCHMARK_CAPTURE(start_search, hd_far, hd, 0.6, 1)->Name("start_search/1280x720")->Apply(run);
BENCHMARK_CAPTURE(start_search, hd_near, hd, 0.2, 1)->Name("start_search/1280x720_at_0.2m")->Apply(run);

}  // namespace
