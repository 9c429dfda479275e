// Plays a recording at its own pace through the live pipeline, as a camera would, and tells the latency of the poses.
#include <chrono>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/live/pipeline.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "console.hpp"
#include "live_options.hpp"
#include "recording_checks.hpp"

using namespace evmarker;

namespace {

struct ReplayOptions : LiveOptions {
  double speed = 1, detect_for_s = 0;
  int packet_us = 100;

  void add_to(CLI::App& app) {
    LiveOptions::add_to(app);
    app.add_option("--speed", speed, "how many times as fast as it was recorded")
        ->check(console::positive_number())
        ->capture_default_str();
    app.add_option("--packet-us", packet_us, "recorded time between two deliveries of the camera")
        ->check(CLI::Range(1, 1000000))
        ->capture_default_str();
    app.add_option("--detect-for", detect_for_s, "look for markers only in the first seconds of the recording")
        ->check(console::positive_number());
  }
};

// Says when recorded time comes. A jump of the recording's clock is no reason to wait.
class Pace {
 public:
  explicit Pace(double speed) : speed_(speed) {}

  void wait_until(Timestamp t) {
    constexpr double kJump_us = 1e6;
    const auto now = live::Clock::now();
    const double ahead_us = static_cast<double>(t) - static_cast<double>(last_t_);
    if (!started_ || std::abs(ahead_us) > kJump_us) {
      started_ = true;
      next_ = now;
    } else {
      next_ += std::chrono::nanoseconds(std::llround(1000 * ahead_us / speed_));
    }
    last_t_ = t;
    if (next_ > now) std::this_thread::sleep_until(next_);
  }

 private:
  double speed_;
  bool started_ = false;
  Timestamp last_t_ = 0;
  live::Clock::time_point next_;
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

void print(const live::Status& s, const live::LatencyHistogram& histogram, double wall_s) {
  print_histogram(histogram, s.push_to_pose.count);
  std::printf("waiting in the queue: p50 %.0f us, p99 %.0f us, max %.0f us\n", s.queue_wait.p50_us, s.queue_wait.p99_us,
              s.queue_wait.max_us);
  std::printf("detection: %" PRIu64 " looks, p50 %.0f us, p99 %.0f us, max %.0f us; %" PRIu64 " events replayed\n",
              s.detections, s.detection.p50_us, s.detection.p99_us, s.detection.max_us, s.replayed);
  std::printf("markers: %" PRIu64 " found, %" PRIu64 " lost; %" PRIu64 " steps back in time, %" PRIu64
              " gaps; %.2f s\n",
              s.registered, s.lost, s.time_steps_back, s.time_gaps, wall_s);
  print_last_line(s);
}

template <PoseUpdateRule Rule>
void replay(const ReplayOptions& options, const typename Rule::Settings& rule, io::PoseColumns columns) {
  const PinholeCamera camera = opencv::load_calibration(options.camera);
  const std::vector<Board> boards = options.load_boards();
  BoardDetector detector(camera, opencv::ArucoDetector(camera, options.detector(boards)), boards);
  io::EventReader recording(options.recording, {.sensor_size = camera.sensor_size()});
  recording_checks::require_size(recording.sensor_size(), options.recording, camera.sensor_size(), options.camera);
  std::optional<io::PoseCsvWriter> output;
  if (!options.output.empty()) output.emplace(options.output, columns);

  live::Pipeline pipeline(
      camera, detector,
      [&](const PoseEstimate& pose) {
        if (output) output->write(pose);
      },
      options.pipeline_settings<Rule>(rule));
  Pace pace(options.speed);
  std::optional<Timestamp> begin;
  const auto start = live::Clock::now();
  {
    console::ProgressBar progress(options.quiet);
    for (auto batch = recording.next_batch(); !batch.empty(); batch = recording.next_batch()) {
      while (!batch.empty()) {
        if (!begin) begin = batch[0].t;
        const auto n = packet_size(batch, batch[0].t + options.packet_us);
        pace.wait_until(batch[n - 1].t);  // a camera delivers when the last of them has happened
        pipeline.push(batch.first(n));
        if (options.detect_for_s > 0 && static_cast<double>(batch[0].t - *begin) > 1e6 * options.detect_for_s)
          pipeline.set_detection(false);
        batch = batch.subspan(n);
      }
      recording_checks::require_sane(recording, options.recording, options.camera, false);
      progress.update(recording.bytes_read(), recording.bytes_total());
    }
    pipeline.flush();
  }
  const std::chrono::duration<double> wall = live::Clock::now() - start;
  recording_checks::require_sane(recording, options.recording, options.camera, true);
  pipeline.stop();
  if (output) output->close();
  print(pipeline.status(), pipeline.latency(), wall.count());
}

void replay(const ReplayOptions& options) {
  options.with_rule([&]<PoseUpdateRule Rule>(const typename Rule::Settings& rule, io::PoseColumns columns) {
    replay<Rule>(options, rule, columns);
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Plays an event camera's recording at its own pace through the live pipeline.", "replay");
  ReplayOptions options;
  options.add_to(app);
  return console::run(app, argc, argv, [&] { replay(options); });
}
