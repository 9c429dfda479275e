// Floods a pipeline with more events than a camera's marker makes, at real pace, and checks each policy to the event.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <numbers>
#include <random>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/live/pipeline.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/simulation/trajectory.hpp"
#include "periodic_recording.hpp"
#include "resident_memory.hpp"

using namespace evmarker;
using live::OverloadPolicy;

namespace {

constexpr Timestamp kSecond = 1000000, kMillisecond = 1000;
const PinholeCamera kCamera{{640, 480}, 533, 533, 319.5, 239.5};
const opencv::ArucoDetectorSettings kMarker{.dictionary = "DICT_4X4_50", .marker_length = 0.1};

// Turns once in a second.
bench::PeriodicRecording turning_marker() {
  const Trajectory motion = trajectory::spin(facing_pose({0, 0, 0.4}), {0, 0, 1}, 2 * std::numbers::pi);
  bench::Situation situation{kCamera, {}, {.seed = 1}};
  situation.scene.markers.push_back(bench::detail::marker(7, kMarker.marker_length, motion));
  return {situation, kSecond};
}

// The events of one marker that turns once in a second, for ever.
class TurningMarker {
 public:
  std::size_t events_in_a_second() const noexcept { return turn_.events().size(); }

  template <typename Use>
  void for_each_until(Timestamp end, Use&& use) {
    for (;; ++next_) {
      if (next_ == turn_.events().size()) {
        next_ = 0;
        turned_ += kSecond;
      }
      Event event = turn_.events()[next_];
      event.t += turned_;
      if (event.t >= end) return;
      use(event);
    }
  }

  void restart() noexcept { next_ = 0, turned_ = 0; }

 private:
  const bench::PeriodicRecording turn_ = turning_marker();
  std::size_t next_ = 0;
  Timestamp turned_ = 0;
};

// The marker alone for a second, with a flood of other events for some seconds, and alone again for a second.
class Flood {
 public:
  Flood(TurningMarker& marker, double rate, int seconds)
      : marker_(marker),
        noise_(rate / static_cast<double>(marker.events_in_a_second()) - 1),
        flood_end_((1 + seconds) * kSecond) {
    marker_.restart();
  }

  Timestamp end() const { return flood_end_ + kSecond; }

  /// The events since the last call; valid until the next one.
  std::span<const Event> until(Timestamp t) {
    piece_.clear();
    marker_.for_each_until(t, [&](const Event& event) {
      piece_.push_back(event);
      if (event.t < kSecond || event.t >= flood_end_) return;
      for (owed_ += noise_; owed_ >= 1; owed_ -= 1)
        piece_.push_back({static_cast<std::uint16_t>(random_() % 60), static_cast<std::uint16_t>(random_() % 480),
                          static_cast<std::int16_t>(random_() % 2), event.t});
    });
    return piece_;
  }

 private:
  TurningMarker& marker_;
  double noise_, owed_ = 0;  // events for every event of the marker
  Timestamp flood_end_;
  std::mt19937 random_{1};
  std::vector<Event> piece_;
};

// What a run showed: whether the counters add up, how much waited, how much memory it took.
class Record {
 public:
  void add(const live::Status& s, Timestamp t) {
    exact_ = exact_ && s.events == s.processed + s.filtered + s.off_sensor + s.hot + s.dropped + s.queue_depth;
    most_waiting_ = std::max(most_waiting_, s.queue_depth);
    most_mb_ = std::max(most_mb_, std::lround(bench::resident_mb()));
    if (t == 2 * kSecond) mb_at_first_ = most_mb_;
  }

  /// After everything was pushed and flushed.
  void require_all(std::uint64_t pushed, const live::Status& s) {
    exact_ = exact_ && pushed == s.events && s.queue_depth == 0;
  }

  bool exact() const { return exact_; }

  void print(const char* name, const live::Status& s, std::uint64_t tracked, double late_ms) const {
    const auto number = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
    std::printf("%-12s %11llu %11llu %10llu %10llu  %-5s %9llu %8llu  %4ld %4ld %10.1f\n", name, number(s.events),
                number(s.processed), number(s.filtered), number(s.dropped), exact_ ? "yes" : "NO", number(tracked),
                number(most_waiting_), mb_at_first_, most_mb_, late_ms);
    std::fflush(stdout);
  }

 private:
  bool exact_ = true;
  std::uint64_t most_waiting_ = 0;
  long mb_at_first_ = 0, most_mb_ = 0;
};

// True if every event is accounted for.
bool run(OverloadPolicy policy, const char* name, TurningMarker& marker, double rate, int seconds) {
  std::atomic<std::uint64_t> tracked = 0;
  live::Pipeline pipeline(kCamera, opencv::ArucoDetector(kCamera, kMarker),
                          [&](const PoseEstimate& pose) { tracked += pose.quality.state == TrackingState::tracking; },
                          {.overload = policy});
  Flood flood(marker, rate, seconds);
  Record record;
  std::uint64_t pushed = 0;
  std::chrono::steady_clock::duration late{};
  const auto start = std::chrono::steady_clock::now();
  for (Timestamp t = kMillisecond; t <= flood.end(); t += kMillisecond) {
    const auto events = flood.until(t);
    const auto due = start + std::chrono::microseconds(t);
    late = std::max(late, std::chrono::steady_clock::now() - due);
    std::this_thread::sleep_until(due);
    pipeline.push(events);
    pushed += events.size();
    if (t % (100 * kMillisecond) == 0) record.add(pipeline.status(), t);
  }
  pipeline.flush();
  const live::Status end = pipeline.status();
  record.add(end, flood.end());
  record.require_all(pushed, end);
  record.print(name, end, tracked, std::chrono::duration<double, std::milli>(late).count());
  return record.exact();
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
