// Tracks the markers of a recording: poses as CSV, a summary, pictures, the error against the truth.
#include <chrono>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/pose_reader.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "console.hpp"
#include "recording_checks.hpp"
#include "track_options.hpp"
#include "track_summary.hpp"
#include "viewer.hpp"

using namespace evmarker;

namespace {

struct TrackFileOptions : TrackOptions {
  std::string truth;
  ViewerOptions view;

  void add_to(CLI::App& app) {
    TrackOptions::add_to(app);
    app.add_option("--truth", truth, "true poses to compare with: TUM, or a pose table with marker ids");
    app.add_option("--overlay", view.overlay, "picture of the tracked markers at the end of the recording");
    app.add_option("--video", view.video, "video of the tracked markers, .mp4, .mkv or .avi");
    app.add_option("--video-fps", view.video_fps, "frames per second of recorded time")
        ->check(console::positive_number())
        ->check(CLI::Range(1.0, 1000.0))
        ->capture_default_str();
    app.add_flag("--show", view.show, "show the same in a window, at the recording's pace");
  }
};

template <PoseUpdateRule Rule>
void track(const TrackFileOptions& options, const typename Rule::Settings& rule, io::PoseColumns columns) {
  const PinholeCamera camera = opencv::load_calibration(options.camera);
  const std::vector<Board> boards = options.load_boards();
  BoardDetector detector(camera, opencv::ArucoDetector(camera, options.detector(boards)), boards);
  Viewer viewer(camera, options.view);  // before there are other threads
  io::EventReader recording(options.recording, {.sensor_size = camera.sensor_size()});
  recording_checks::require_size(recording.sensor_size(), options.recording, camera.sensor_size(), options.camera);
  std::optional<io::GroundTruth> truth;
  if (!options.truth.empty()) truth = io::GroundTruth::read(options.truth);
  std::optional<io::PoseCsvWriter> output;
  if (!options.output.empty()) output.emplace(options.output, columns);

  Tracker tracker(camera, detector, options.settings<Rule>(rule));
  TrackSummary summary;
  const auto model_of = [&](MarkerId id) { return detector.model(id); };
  const auto start = std::chrono::steady_clock::now();
  {
    console::ProgressBar progress(options.quiet);
    for (auto batch = recording.next_batch(); !batch.empty(); batch = recording.next_batch()) {
      recording_checks::require_sane(recording, options.recording, options.camera, false);
      for (std::span<const Event> left = batch; !left.empty();) {
        viewer.advance(left.front().t, tracker, model_of);
        const std::span<const Event> until_frame = viewer.before_next_frame(left);
        tracker.push(until_frame, [&](const PoseEstimate& pose) {
          if (output) output->write(pose);
          summary.add(pose, truth ? truth->at(pose.id, pose.t) : std::nullopt);
          viewer.add(pose);
        });
        left = left.subspan(until_frame.size());
      }
      summary.add(batch);
      progress.update(recording.bytes_read(), recording.bytes_total());
    }
  }
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;

  recording_checks::require_sane(recording, options.recording, options.camera, true);
  if (truth) summary.require_compared(options.truth);
  viewer.finish(tracker, model_of);
  if (output) output->close();
  summary.print(recording.statistics(), tracker.statistics(), wall.count());
}

void track(const TrackFileOptions& options) {
  options.with_rule([&]<PoseUpdateRule Rule>(const typename Rule::Settings& rule, io::PoseColumns columns) {
    track<Rule>(options, rule, columns);
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Tracks fiducial markers in an event camera's recording.", "track_file");
  TrackFileOptions options;
  options.add_to(app);
  return console::run(app, argc, argv, [&] { track(options); });
}
