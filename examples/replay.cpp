// Plays a recording at its own pace through the live pipeline, as a camera would, and reports the latency of the poses.
#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/output_file.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/live/pipeline.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <functional>
#include <iterator>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "console.hpp"
#include "interruption.hpp"
#include "live_options.hpp"
#include "reader_options.hpp"
#include "recording_checks.hpp"
#include "trigger_output.hpp"

using namespace evmarker;

namespace {

struct ReplayOptions : LiveOptions {
  double speed = 1, detect_for_s = 0;
  int packet_us = 100;
  bool find_first = false;
  std::string delays;
  ReaderOptions reader;

  void add_to(CLI::App& app) {
    LiveOptions::add_to(app);
    reader.add_to(app);
    app.add_option("--speed", speed, "how many times as fast as it was recorded")
        ->check(console::positive_number())
        ->capture_default_str();
    app.add_option("--packet-us", packet_us, "recorded time between two deliveries of the camera")
        ->check(CLI::Range(1, 1000000))
        ->capture_default_str();
    app.add_option("--detect-for", detect_for_s, "detect markers only in the first seconds of the recording")
        ->check(console::positive_number());
    app.add_flag("--find-first", find_first,
                 "a twentieth as fast until a marker is tracked: to see an overload from then on");
    app.add_option("--delays", delays, "how long each pose took from its event, as CSV for delays.gnuplot");
    app.footer(console::exit_codes("2 no marker was found, or not both of --relative, "));
  }

  void require_distinct_files() const {
    require_distinct(files_read(), {{"--output", output}, {"--triggers", triggers}, {"--delays", delays}});
  }
};

// Maps recorded time to the wall clock and waits for it, but not across a jump of the recording's clock, nor when the
// program is interrupted. As a camera's thread should, the one that plays has real-time priority, until it is late:
// then it no longer waits, and would keep a processor from all others.
class Pace {
 public:
  Pace(double speed, live::TrackingPriority priority) : speed_(speed) {
    if (priority == live::TrackingPriority::automatic) live::request_real_time_priority();
  }

  void set_speed(double speed) {
    if (speed != std::exchange(speed_, speed)) again_ = true;
  }

  void wait_until(Timestamp t) {
    constexpr double kJump_us = 1e6;
    const auto now = live::Clock::now();
    if (std::exchange(again_, false) || std::abs(static_cast<double>(t) - static_cast<double>(last_t_)) > kJump_us)
      starts_.push_back({t, speed_, now});
    last_t_ = t;
    const auto then = wall(starts_.back(), t);
    if (then <= now - std::chrono::milliseconds(50)) live::drop_real_time_priority();
    for (auto until = now; until < then && !interruption::requested;) {
      until = std::min(then, live::Clock::now() + std::chrono::milliseconds(50));
      std::this_thread::sleep_until(until);
    }
  }

  /// The wall clock's time of a recorded time, by the start that was the latest at `now`.
  live::Clock::time_point wall(Timestamp t, live::Clock::time_point now) const {
    const auto later = std::ranges::upper_bound(starts_, now, {}, &Start::wall);
    return wall(later == starts_.begin() ? starts_.front() : *std::prev(later), t);
  }

 private:
  struct Start {
    Timestamp t;
    double speed;
    live::Clock::time_point wall;
  };

  static live::Clock::time_point wall(const Start& start, Timestamp t) {
    return start.wall + std::chrono::nanoseconds(std::llround(1000 * static_cast<double>(t - start.t) / start.speed));
  }

  double speed_;
  bool again_ = true;
  std::vector<Start> starts_;  // of the recording, and after jumps and changes of speed
  Timestamp last_t_ = 0;
};

// Everything that comes out of the pipeline, and the files that it goes to.
class Outputs {
 public:
  // Opens the files, so that one that cannot be written is reported before the recording is played.
  Outputs(const ReplayOptions& options, io::PoseColumns columns)
      : poses_(options, options.track_one(), columns), triggers_(options.triggers) {
    if (!options.delays.empty()) delay_file_.emplace(options.delays);
  }

  PoseOutput& poses() { return poses_; }
  TriggerOutput& triggers() { return triggers_; }
  /// What is in the files.
  std::vector<std::string> kept(const ReplayOptions& options) const {
    std::vector<std::string> files = poses_.kept();
    if (delay_file_) files.push_back(std::to_string(deliveries_.size()) + " delays in " + options.delays);
    for (const std::string& file : triggers_.kept()) files.push_back(file);
    return files;
  }
  void add_delivery(Timestamp t) {
    if (delay_file_) deliveries_.push_back({t, live::Clock::now()});
  }

  void close(const Pace& pace, live::Clock::time_point start) {
    poses_.close();
    triggers_.close();
    if (!delay_file_) return;
    delay_file_->write(delay_table(pace, start));
    delay_file_->close();
  }

 private:
  struct Delivery {
    Timestamp t;  // of the pose
    live::Clock::time_point wall;
  };

  std::string delay_table(const Pace& pace, live::Clock::time_point start) const {
    using Milliseconds = std::chrono::duration<double, std::milli>;
    std::string text = "time_s,delay_ms\n";
    for (const Delivery& delivery : deliveries_) {
      io::append_number(text, 1e-3 * Milliseconds(delivery.wall - start).count());
      text += ',';
      io::append_number(text, Milliseconds(delivery.wall - pace.wall(delivery.t, delivery.wall)).count());
      text += '\n';
    }
    return text;
  }

  PoseOutput poses_;
  TriggerOutput triggers_;
  std::optional<io::OutputFile> delay_file_;
  std::vector<Delivery> deliveries_;
};

// The first events of a batch, as many as the camera would deliver at once.
std::size_t packet_size(std::span<const Event> events, Timestamp end) {
  std::size_t n = 1;
  while (n < events.size() && events[n].t < end && events[n].t >= events[n - 1].t) ++n;
  return n;
}

void print_histogram(const live::LatencyHistogram& histogram, std::uint64_t poses) {
  if (poses == 0) return;
  std::puts("latency from push to pose");
  for (double low = 0, high = 8; low < 1e7; low = high, high *= 2) {
    const std::uint64_t count = histogram.between_us(low, high);
    if (count == 0) continue;
    const double share = static_cast<double>(count) / static_cast<double>(poses);
    std::printf("%9.0f to %9.0f us %9" PRIu64 " %5.1f %% %s\n", low, high, count, 100 * share,
                std::string(static_cast<std::size_t>(std::ceil(50 * share)), '#').c_str());
  }
}

void print(const ReplayOptions& options, const live::Status& s, const live::LatencyHistogram& histogram,
           double wall_s) {
  print_histogram(histogram, s.push_to_pose.count);
  std::printf("waiting in the queue: p50 %.0f us, p99 %.0f us, max %.0f us\n", s.queue_wait.p50_us, s.queue_wait.p99_us,
              s.queue_wait.max_us);
  std::printf("detection: %" PRIu64 " times, p50 %.0f us, p99 %.0f us, max %.0f us; %" PRIu64 " events replayed\n",
              s.detections, s.detection.p50_us, s.detection.p99_us, s.detection.max_us, s.replayed);
  if (s.replays_cut > 0) std::printf("replays that lacked events: %" PRIu64 "\n", s.replays_cut);
  if (s.triggers > 0) std::printf("triggers: %" PRIu64 ", %" PRIu64 " dropped\n", s.triggers, s.triggers_dropped);
  std::printf("markers: %" PRIu64 " found, %" PRIu64 " lost; %" PRIu64 " steps back in time, %" PRIu64
              " gaps; %.2f s\n",
              s.registered, s.lost, s.time_steps_back, s.time_gaps, wall_s);
  if (s.outages > 0) std::printf("outages of the sensor: %" PRIu64 "\n", s.outages);
  if (s.hot > 0) std::printf("events of hot pixels, dropped: %" PRIu64 "\n", s.hot);
  if (!s.real_time && options.tracking_priority() == live::TrackingPriority::automatic)
    std::printf("%s\n", live::kRealTimeHint);
  print_last_line(s);
}

// Pushes packets as a camera delivers them, with trigger events in their place among the events.
// Returns for how long they were recorded [s].
template <typename Pipeline>
double play(const ReplayOptions& options, io::EventReader& recording, Pace& pace, Pipeline& pipeline,
            const std::function<void()>& after_batch) {
  std::optional<Timestamp> begin;
  Timestamp last = 0;
  for (bool more = true; more && !interruption::requested;) {
    auto batch = recording.next_batch();
    auto triggers = recording.triggers();
    more = !batch.empty();
    if (options.find_first) pace.set_speed(pipeline.status().registered > 0 ? options.speed : options.speed / 20);
    while ((!batch.empty() || !triggers.empty()) && !interruption::requested) {
      if (!triggers.empty() && (batch.empty() || triggers[0].t < batch[0].t)) {
        pace.wait_until(triggers[0].t);
        pipeline.push(triggers[0]);
        triggers = triggers.subspan(1);
        continue;
      }
      if (!begin) begin = batch[0].t;
      if (options.detect_for_s > 0 && static_cast<double>(batch[0].t - *begin) > 1e6 * options.detect_for_s)
        pipeline.set_detection(false);
      Timestamp end = batch[0].t + options.packet_us;
      if (!triggers.empty()) end = std::min(end, triggers[0].t + 1);
      const auto n = packet_size(batch, end);
      pace.wait_until(batch[n - 1].t);  // a camera delivers when the last of them has happened
      pipeline.push(batch.first(n));
      last = batch[n - 1].t;
      batch = batch.subspan(n);
    }
    after_batch();
  }
  pipeline.flush();
  return begin && last > *begin ? 1e-6 * static_cast<double>(elapsed_us(*begin, last)) : 0;
}

template <PoseUpdateRule Rule>
live::PipelineSettings<Rule> settings(const ReplayOptions& options, const typename Rule::Settings& rule,
                                      Outputs& outputs) {
  live::PipelineSettings<Rule> settings = options.pipeline_settings<Rule>(rule, outputs.poses());
  settings.on_trigger = [&](const TriggerEvent& trigger) { outputs.triggers().write(trigger); };
  return settings;
}

template <PoseUpdateRule Rule>
void replay(const ReplayOptions& options, const typename Rule::Settings& rule, io::PoseColumns columns) {
  options.require_distinct_files();
  interruption::watch();
  const PinholeCamera camera = options.camera.load();
  auto detector = options.detector(camera);
  io::EventReader recording =
      recording_checks::open(options.recording, camera.sensor_size(), options.camera.path, options.reader);
  Outputs outputs(options, columns);
  live::Pipeline pipeline(
      camera, detector,
      [&](const PoseEstimate& pose) {
        outputs.add_delivery(pose.t);
        outputs.poses().write(pose);
      },
      settings<Rule>(options, rule, outputs));

  Pace pace(options.speed, options.tracking_priority());
  const auto start = live::Clock::now();
  double recorded_s = 0;
  {
    console::ProgressBar progress(options.quiet);
    recorded_s = play(options, recording, pace, pipeline, [&] {
      recording_checks::require_sane(recording, options.recording, options.camera.path, false);
      progress.update(recording.bytes_read(), recording.bytes_total());
    });
  }
  const std::chrono::duration<double> wall = live::Clock::now() - start;
  const bool interrupted = interruption::requested;
  if (!interrupted) recording_checks::require_sane(recording, options.recording, options.camera.path, true);
  pipeline.stop();
  outputs.close(pace, start);
  outputs.poses().print();
  print(options, pipeline.status(), pipeline.latency(), wall.count());
  if (interrupted) interruption::end(recorded_s, outputs.kept(options));
  const live::Status status = pipeline.status();
  const bool too_slow = status.dropped > 0 || status.replays_cut > 0;
  if (status.registered == 0)
    throw console::Exit(kNothingFound, too_slow
                                           ? "no marker was tracked: this computer was too slow for it, beside its "
                                             "other work; play slower, as by --speed 0.2"
                                           : kNoMarkerHint);
  if (const std::string none = outputs.poses().none_at_rate(recorded_s); !none.empty()) console::say(none);
  if (const std::string none = outputs.poses().no_relative(); !none.empty()) throw console::Exit(kNothingFound, none);
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<ReplayOptions>(
      "replay", "Plays an event camera's recording at its own pace through the live pipeline.", argc, argv,
      [](const ReplayOptions& options) {
        options.with_rule([&]<PoseUpdateRule Rule>(const auto&... chosen) { replay<Rule>(options, chosen...); });
      });
}
