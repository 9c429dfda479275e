// Plays a recording again and again through a pipeline that is stopped and started: does it stay as it was?
#if __has_include(<malloc.h>)
#include <malloc.h>
#endif

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cstddef>
#include <cstdio>
#include <numbers>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../examples/console.hpp"
#include "../examples/interruption.hpp"
#include "encoding_loop.hpp"
#include "evmarker/live/pipeline.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "periodic_recording.hpp"
#include "resident_memory.hpp"
#include "soak_record.hpp"

using namespace evmarker;
using bench::Encoding;
using Clock = std::chrono::steady_clock;

namespace {

constexpr Timestamp kSecond = 1000000;
constexpr std::size_t kPacket = 4096;  // events that a camera delivers at once

// Between a start of the pipeline and its stop, camera time passes `middle_us`.
struct Leg {
  std::string name;
  Encoding encoding;
  Timestamp middle_us;
};

const std::vector<Leg> kLegs{{"evt3", Encoding::evt3, Timestamp{1} << 24},     // its clock wraps every 16.8 s
                             {"evt2", Encoding::evt2, Timestamp{1} << 34},     // every 4.8 h
                             {"evt2.1", Encoding::evt21, Timestamp{1} << 34},  // the same
                             {"2^53", Encoding::none, Timestamp{1} << 53}};    // beyond, a double skips microseconds

struct Options {
  int minutes = 60;
  int restart_s = 60;
  std::vector<std::string> through;

  void add_to(CLI::App& app) {
    std::vector<std::string> names;
    for (const Leg& leg : kLegs) names.push_back(leg.name);
    through = names;
    app.add_option("--minutes", minutes, "how long to play")->check(CLI::Range(2, 100000))->capture_default_str();
    app.add_option("--restart-every", restart_s, "camera time from a start of the pipeline to its stop [s]")
        ->check(CLI::Range(2, 10000))
        ->capture_default_str();
    app.add_option("--through", through, "what camera time passes after each start in turn: wraps of formats, or 2^53")
        ->delimiter(',')
        ->check(CLI::IsMember(names))
        ->capture_default_str();
  }

  std::vector<Leg> legs() const {
    std::vector<Leg> chosen;
    for (const std::string& name : through) chosen.push_back(*std::ranges::find(kLegs, name, &Leg::name));
    return chosen;
  }
};

// A marker on a closed path, up to 1000 px/s.
bench::PeriodicRecording closed_path() {
  constexpr Timestamp kPeriod_us = kSecond;
  const Trajectory motion = [](double s) {
    const double w = 2 * std::numbers::pi * s;
    return facing_pose({0.08 * std::sin(w + 1), 0.06 * std::sin(2 * w + 2), 0.6 + 0.06 * std::cos(w)},
                       {0.3 * std::sin(w), 0.3 * std::cos(w + 1), 0.2 * std::sin(2 * w)});
  };
  Random random(1);
  return {bench::detail::one_marker(random, motion, 0), kPeriod_us};
}

// Poses do not depend on the machine's speed, as the pipeline waits for the detector. It plays many times as fast as
// the recording was made, so that detections are as frequent by the wall clock as they would be live.
live::PipelineSettings<> pipeline_settings() {
  live::PipelineSettings<> settings{.overload = live::OverloadPolicy::block, .wait_for_detector = true};
  settings.tracker.detection_interval = std::chrono::milliseconds(250);
  return settings;
}

class Soak {
 public:
  explicit Soak(const Options& options)
      : options_(options),
        pipeline_(
            situation_.camera,
            {situation_.camera, {.dictionary = situation_.dictionary, .marker_length = situation_.marker_length()}},
            [this](const PoseEstimate& pose) { judge(pose); }, pipeline_settings()) {}

  // Plays until the time is over.
  const std::vector<bench::SoakMinute>& play() {
    std::puts(
        "minute  Mevents  Mev/s  memory MB  growth  error: mm     deg    NEES     poses  found  lost  dropped  time "
        "faults  steps back");
    const std::vector<Leg> legs = options_.legs();
    minute_begin_ = Clock::now();
    for (std::size_t number = 0; !is_over(); ++number) play(legs[number % legs.size()]);
    return minutes_;
  }

 private:
  bool is_over() const {
    return interruption::requested || minutes_.size() >= static_cast<std::size_t>(options_.minutes);
  }

  void play(const Leg& leg) {
    bench::EncodingLoop loop(leg.encoding, situation_.camera.sensor_size());
    leg_begin_ = std::max<Timestamp>(0, leg.middle_us - options_.restart_s * kSecond / 2);
    pipeline_.start();
    const Timestamp end = leg_begin_ + options_.restart_s * kSecond;
    for (Timestamp t = leg_begin_; t < end && !is_over(); t += recording_.period_us()) {
      recording_.move_to(t, moved_);
      for (std::span<const Event> left = moved_; !left.empty(); left = left.subspan(std::min(kPacket, left.size())))
        pipeline_.push(loop.pass(left.first(std::min(kPacket, left.size()))));
      pipeline_.flush();
      if (Clock::now() - minute_begin_ >= std::chrono::minutes(1)) end_minute();
    }
    finished_.add(pipeline_.status());
    pipeline_.stop();
  }

  void judge(const PoseEstimate& pose) { finished_.add(bench::judge(pose, recording_.truth(pose.t - leg_begin_))); }

  void end_minute() {
    bench::SoakCounts now = finished_;
    now.add(pipeline_.status());
    const std::chrono::duration<double> length = Clock::now() - minute_begin_;
    minute_begin_ = Clock::now();
    minutes_.push_back({length.count(), bench::resident_mb(), now.since(std::exchange(at_minute_begin_, now))});
    print(minutes_.back());
  }

  void print(const bench::SoakMinute& minute) const {
    const bench::SoakCounts& c = minute.counts;
    const double million = 1e-6 * static_cast<double>(c.events);
    std::printf("%6zu  %7.1f  %5.1f  %9.1f  %6.1f  %9.4f  %6.4f  %6.4f  %8" PRIu64 "  %5" PRIu64 "  %4" PRIu64
                "  %7" PRIu64 "  %11" PRIu64 "  %10" PRIu64 "\n",
                minutes_.size(), million, million / minute.seconds, minute.resident_mb,
                minute.resident_mb - minutes_.front().resident_mb, c.rms_mm(), c.rms_deg(), c.mean_nees(), c.poses,
                c.registered, c.lost, c.dropped, c.time_faults, c.time_steps_back);
    std::fflush(stdout);
  }

  Options options_;
  const bench::PeriodicRecording recording_ = closed_path();
  const bench::Situation& situation_ = recording_.situation();
  std::vector<Event> moved_;  // of the period that is played
  Timestamp leg_begin_ = 0;
  bench::SoakCounts finished_;  // of the legs until now; the poses of this one, too
  bench::SoakCounts at_minute_begin_;
  Clock::time_point minute_begin_;
  std::vector<bench::SoakMinute> minutes_;
  live::Pipeline<opencv::ArucoDetector<PinholeCamera>> pipeline_;
};

// Throws if something has changed in the course of time, or it was interrupted.
void run(const Options& options) {
  interruption::watch();
  Soak soak(options);
  const auto& minutes = soak.play();
  const std::string fault = bench::find_fault(minutes);
  if (interruption::requested)
    throw console::Exit(128 + interruption::caught_signal, "interrupted after " + std::to_string(minutes.size()) +
                                                               " minutes: " + (fault.empty() ? "unchanged" : fault));
  if (!fault.empty()) throw std::runtime_error(fault);
  std::puts("unchanged: memory within 1 MB, error and NEES within 2 %, nothing dropped or lost");
}

}  // namespace

int main(int argc, char** argv) {
#ifdef M_ARENA_MAX
  // Which of glibc's arenas a thread gets, and so how many there are after the pipeline's later starts, is chance.
  mallopt(M_ARENA_MAX, 1);
#endif
  return console::run<Options>(
      "soak", "Plays a recording again and again through a pipeline and says whether memory and error stay the same.",
      argc, argv, run);
}
