// Tracks the markers of a recording: poses as CSV, a summary, a picture, the error against the truth.
#include <chrono>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/pose_reader.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <optional>
#include <vector>

#include "console.hpp"
#include "recording_checks.hpp"
#include "track_options.hpp"
#include "track_summary.hpp"

using namespace evmarker;

namespace {

template <PoseUpdateRule Rule>
void track(const TrackOptions& options, const typename Rule::Settings& rule, io::PoseColumns columns) {
  const PinholeCamera camera = opencv::load_calibration(options.camera);
  const std::vector<Board> boards = options.load_boards();
  BoardDetector detector(camera, opencv::ArucoDetector(camera, options.detector(boards)), boards);
  io::EventReader recording(options.recording, {.sensor_size = camera.sensor_size()});
  recording_checks::require_size(recording, options.recording, camera.sensor_size(), options.camera);
  std::optional<io::GroundTruth> truth;
  if (!options.truth.empty()) truth = io::GroundTruth::read(options.truth);
  std::optional<io::PoseCsvWriter> output;
  if (!options.output.empty()) output.emplace(options.output, columns);

  Tracker tracker(camera, detector, options.settings<Rule>(rule));
  TrackSummary summary;
  Snapshot snapshot(options.overlay);
  const auto start = std::chrono::steady_clock::now();
  {
    console::ProgressBar progress(options.quiet);
    for (auto batch = recording.next_batch(); !batch.empty(); batch = recording.next_batch()) {
      for (const Event& event : batch)
        for (const PoseEstimate& pose : tracker.push(event)) {
          if (output) output->write(pose);
          summary.add(pose, truth ? truth->at(pose.id, pose.t) : std::nullopt);
        }
      summary.add(batch);
      snapshot.take(camera, tracker);
      recording_checks::require_sane(recording, options.recording, options.camera, false);
      progress.update(recording.bytes_read(), recording.bytes_total());
    }
  }
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;

  recording_checks::require_sane(recording, options.recording, options.camera, true);
  if (truth) summary.require_compared(options.truth);
  snapshot.write();
  if (output) output->close();
  summary.print(recording.statistics(), tracker.statistics(), wall.count());
}

void track(const TrackOptions& options) {
  options.with_rule([&]<PoseUpdateRule Rule>(const typename Rule::Settings& rule, io::PoseColumns columns) {
    track<Rule>(options, rule, columns);
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Tracks fiducial markers in an event camera's recording.", "track_file");
  TrackOptions options;
  options.add_to(app);
  return console::run(app, argc, argv, [&] { track(options); });
}
