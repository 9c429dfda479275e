// Floods a pipeline with more events than a camera's marker makes, at real pace, and checks each policy to the event.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <fstream>
#include <numbers>
#include <random>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/live/pipeline.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "evmarker/simulation/trajectory.hpp"

using namespace evmarker;
using live::OverloadPolicy;

namespace {

constexpr Timestamp kSecond = 1000000, kMillisecond = 1000;
const PinholeCamera kCamera{{640, 480}, 533, 533, 319.5, 239.5};
const opencv::ArucoDetectorSettings kMarker{.dictionary = "DICT_4X4_50", .marker_length = 0.1};

// The events of one marker that turns once in a second, for ever.
class TurningMarker {
 public:
  TurningMarker() {
    const Trajectory motion = trajectory::spin(facing_pose({0, 0, 0.4}), {0, 0, 1}, 2 * std::numbers::pi);
    const CodeBits bits = opencv::ArucoDetector(kCamera, kMarker).bits(7);
    Simulator simulator(kCamera, {{.id = 7, .length = kMarker.marker_length, .bits = bits, .T_camera_marker = motion}},
                        SimulatorSettings{.duration_s = 2, .seed = 1});
    for_each_event(simulator, [&](Event event) {
      if (event.t < kSecond) return;  // in the first turn, pixels see their first edge
      event.t -= kSecond;
      turn_.push_back(event);
    });
  }

  std::size_t events_in_a_second() const noexcept { return turn_.size(); }

  template <typename Use>
  void for_each_until(Timestamp end, Use&& use) {
    for (;; ++next_) {
      if (next_ == turn_.size()) {
        next_ = 0;
        turned_ += kSecond;
      }
      Event event = turn_[next_];
      event.t += turned_;
      if (event.t >= end) return;
      use(event);
    }
  }

  void restart() noexcept { next_ = 0, turned_ = 0; }

 private:
  std::vector<Event> turn_;
  std::size_t next_ = 0;
  Timestamp turned_ = 0;
};

long resident_mb() {
  constexpr long kPageKb = 4;
  long pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  return pages * kPageKb / 1024;
}

// True if every event is accounted for.
bool run(OverloadPolicy policy, const char* name, TurningMarker& marker, double rate, int seconds) {
  std::atomic<std::uint64_t> tracked = 0;
  live::Pipeline pipeline(kCamera, opencv::ArucoDetector(kCamera, kMarker),
                          [&](const PoseEstimate& pose) { tracked += pose.quality.state == TrackingState::tracking; },
                          {.overload = policy});
  std::mt19937 random(1);
  std::vector<Event> piece;
  const double noise = rate / static_cast<double>(marker.events_in_a_second()) - 1;  // for every event of the marker
  double owed = 0;
  std::uint64_t pushed = 0, most_waiting = 0;
  long mb_at_first = 0, most_mb = 0;
  bool exact = true;
  std::chrono::steady_clock::duration late{};
  marker.restart();
  const auto start = std::chrono::steady_clock::now();
  // A second of the marker alone, the flood, and another second alone.
  const Timestamp flood_end = (1 + seconds) * kSecond, end = flood_end + kSecond;
  for (Timestamp t = kMillisecond; t <= end; t += kMillisecond) {
    piece.clear();
    marker.for_each_until(t, [&](const Event& event) {
      piece.push_back(event);
      if (event.t < kSecond || event.t >= flood_end) return;
      for (owed += noise; owed >= 1; owed -= 1)
        piece.push_back({static_cast<std::uint16_t>(random() % 60), static_cast<std::uint16_t>(random() % 480),
                         static_cast<std::int16_t>(random() % 2), event.t});
    });
    const auto due = start + std::chrono::microseconds(t);
    late = std::max(late, std::chrono::steady_clock::now() - due);
    std::this_thread::sleep_until(due);
    pipeline.push(piece);
    pushed += piece.size();
    if (t % (100 * kMillisecond) != 0) continue;
    const live::Status s = pipeline.status();
    exact = exact && s.events == s.processed + s.filtered + s.off_sensor + s.dropped + s.queue_depth;
    most_waiting = std::max(most_waiting, s.queue_depth);
    most_mb = std::max(most_mb, resident_mb());
    if (t == 2 * kSecond) mb_at_first = most_mb;
  }
  pipeline.flush();
  const live::Status s = pipeline.status();
  exact = exact && pushed == s.events && s.events == s.processed + s.filtered + s.off_sensor + s.dropped;
  const auto number = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("%-12s %11llu %11llu %10llu %10llu  %-5s %9llu %8llu  %4ld %4ld %10.1f\n", name, number(s.events),
              number(s.processed), number(s.filtered), number(s.dropped), exact ? "yes" : "NO", number(tracked),
              number(most_waiting), mb_at_first, most_mb, std::chrono::duration<double, std::milli>(late).count());
  std::fflush(stdout);
  return exact;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("One tracked marker and a flood of other events at real pace: what each overload policy does");
  double rate = 20;
  int seconds = 10;
  app.add_option("--rate", rate, "millions of events in a second")
      ->check(CLI::Range(3.0, 1000.0))
      ->capture_default_str();
  app.add_option("--seconds", seconds, "length of the flood")->check(CLI::Range(1, 3600))->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    TurningMarker marker;
    std::printf("%.1f Mev/s for %d s, of which %.1f are the marker's; three policies\n", rate, seconds,
                1e-6 * static_cast<double>(marker.events_in_a_second()));
    std::printf(
        "policy            events   processed   filtered    dropped  exact     poses  waiting  MB: first, most  "
        "late_ms\n");
    bool exact = true;
    for (const auto& [policy, name] :
         {std::pair(OverloadPolicy::block, "block"), std::pair(OverloadPolicy::drop_oldest, "drop-oldest"),
          std::pair(OverloadPolicy::thin, "thin")})
      exact = run(policy, name, marker, 1e6 * rate, seconds) && exact;
    return exact ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "overload: %s\n", error.what());
    return 1;
  }
}
