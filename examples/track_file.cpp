// Tracks the markers of a recording: poses as CSV, a summary, pictures, the error against the truth.
#include <chrono>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "console.hpp"
#include "followed_body.hpp"
#include "interruption.hpp"
#include "reader_options.hpp"
#include "recording_checks.hpp"
#include "timed_poses.hpp"
#include "track_options.hpp"
#include "track_summary.hpp"
#include "truth_comparison.hpp"
#include "untracked.hpp"
#include "viewer.hpp"

using namespace evmarker;

namespace {

struct TrackFileOptions : TrackOptions {
  std::string truth, wireframe;
  std::vector<double> start;
  ViewerOptions view;
  ReaderOptions reader;

  void add_to(CLI::App& app) {
    TrackOptions::add_to(app);
    reader.add_to(app);
    auto* const body = app.add_option("--wireframe", wireframe, "body of straight edges to track alone, a YAML file");
    app.add_option("--start", start, "where the body is at first: tx,ty,tz,qx,qy,qz,qw, in place of the file's `start`")
        ->delimiter(',')
        ->expected(7)
        ->needs(body);
    app.add_option("--truth", truth, "true poses to compare with: TUM, or a pose table with marker ids");
    app.add_option("--overlay", view.overlay, "picture of the tracked markers at the end of the recording");
    CLI::Option* video = app.add_option("--video", view.video, "video of the tracked markers, .mp4, .mkv or .avi");
    app.add_option("--video-fps", view.video_fps, "frames per second of recorded time")
        ->check(console::positive_number())
        ->check(CLI::Range(1.0, 1000.0))
        ->needs(video)
        ->capture_default_str();
    app.add_flag("--show", view.show, "show the same in a window, at the recording's pace");
    app.footer(console::exit_codes("2 no marker or body was found, or not both of --relative, "));
  }

  void require_distinct_files() const {
    std::vector<FileOption> read = files_read();
    read.insert(read.end(), {{"--truth", truth}, {"--wireframe", wireframe}});
    require_distinct(read, {{"--output", output}, {"--overlay", view.overlay}, {"--video", view.video}});
  }

  /// @throws std::invalid_argument where other markers are to be tracked beside a body
  Wireframe load_body() const {
    if (!lengths.empty() || !boards.empty() || !ids.empty())
      throw std::invalid_argument(
          "--wireframe: a body is tracked alone, without --marker-length, --markers, --board and --ids");
    return ::load_body(wireframe, start);
  }
};

// Everything around the tracker: what goes into it and what comes of its poses.
class Run {
 public:
  Run(const TrackFileOptions& options, const PinholeCamera& camera, io::PoseColumns columns)
      : options_(options),
        viewer_(camera, options.view),  // before there are other threads
        recording_(
            recording_checks::open(options.recording, camera.sensor_size(), options.camera.path, options.reader)),
        comparison_(options.truth),
        output_(options, options.track_one() || !options.wireframe.empty(), columns) {
    if (const auto interval = options.interval()) ticks_.emplace(*interval, std::chrono::seconds(1));
  }

  /// @param model_of gives the model of a marker's id
  /// @param if_none gives what to say where there was no pose, from frames of the recording
  /// @throws console::Exit where there was none, or the program was interrupted, and std::runtime_error where they
  /// cannot be compared with the truth; all files are complete
  template <typename AnyTracker, typename ModelOf, typename IfNone>
  void operator()(AnyTracker& tracker, const ModelOf& model_of, const IfNone& if_none) {
    const auto start = std::chrono::steady_clock::now();
    push_all(tracker, model_of);
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    const bool interrupted = interruption::requested;
    io::RecordingStatistics statistics = recording_.statistics();
    if (interrupted)
      statistics.truncated_bytes = 0;  // it is not the recording that ends there
    else
      recording_checks::require_sane(recording_, options_.recording, options_.camera.path, true);
    viewer_.finish(tracker, model_of);
    output_.close();
    summary_.print(statistics, tracker.statistics(), comparison_, wall.count());
    output_.print();
    if (const std::string doubt = comparison_.doubt(); !doubt.empty()) console::say(doubt);
    if (interrupted) interruption::end(summary_.recorded_s(), kept());
    comparison_.require_comparable(options_.recording);
    if (comparison_.poses() == 0) {
      require_order(statistics);
      throw console::Exit(kNothingFound, if_none(frames_.get()));
    }
    if (const std::string none = output_.none_at_rate(summary_.recorded_s()); !none.empty()) console::say(none);
    if (const std::string none = output_.no_relative(); !none.empty()) throw console::Exit(kNothingFound, none);
  }

 private:
  // Cameras and drivers deliver a few events late; more are in another order than that of time.
  void require_order(const io::RecordingStatistics& statistics) const {
    if (statistics.time_steps_back * 100 > statistics.events)
      throw console::Exit(kNothingFound, "no marker was tracked: the times of " + options_.recording + " step back " +
                                             std::to_string(statistics.time_steps_back) +
                                             " times: are its events in the order of time?");
  }

  std::vector<std::string> kept() const {
    std::vector<std::string> files = output_.kept();
    for (const std::string& file : {options_.view.overlay, options_.view.video})
      if (!file.empty()) files.push_back(file);
    return files;
  }

  template <typename AnyTracker, typename ModelOf>
  void push_all(AnyTracker& tracker, const ModelOf& model_of) {
    console::ProgressBar progress(options_.quiet);
    for (auto batch = recording_.next_batch(); !batch.empty() && !interruption::requested;
         batch = recording_.next_batch()) {
      recording_checks::require_sane(recording_, options_.recording, options_.camera.path, false);
      for (std::span<const Event> left = batch; !left.empty();) {
        viewer_.advance(left.front().t, tracker, model_of);
        const std::span<const Event> until_frame = viewer_.before_next_frame(left);
        push(tracker, until_frame);
        left = left.subspan(until_frame.size());
      }
      summary_.add(batch);
      if (comparison_.poses() == 0) frames_.add(tracker.polarity_frame());
      progress.update(recording_.bytes_read(), recording_.bytes_total());
    }
  }

  template <typename AnyTracker>
  void push(AnyTracker& tracker, std::span<const Event> events) {
    const auto use = [&](const PoseEstimate& pose) {
      output_.write(pose);
      summary_.add(pose);
      comparison_.add(pose);
      viewer_.add(pose);
    };
    if (ticks_)
      push_with_ticks(*ticks_, tracker, events, use,
                      [&](Timestamp, std::span<const PoseEstimate> poses) { output_.write(poses); });
    else
      tracker.push(events, use);
  }

  const TrackFileOptions& options_;
  Viewer viewer_;
  io::EventReader recording_;
  TruthComparison comparison_;
  PoseOutput output_;
  std::optional<TickTimes> ticks_;
  UntrackedFrames frames_;
  TrackSummary summary_;
};

template <PoseUpdateRule Rule>
void track(const TrackFileOptions& options, const typename Rule::Settings& rule, io::PoseColumns columns) {
  options.require_distinct_files();
  interruption::watch();
  const PinholeCamera camera = options.camera.load();
  const TrackerSettings<Rule> settings = options.settings<Rule>(rule);
  if (!options.wireframe.empty()) {
    const Wireframe body = options.load_body();
    Run run(options, camera, columns);
    FollowedBody<Rule> tracker(camera, body, {settings.filter_window, settings.marker});
    run(
        tracker, [&](MarkerId) { return body.model; },
        [](const auto&) {
          return "the body was not found: it must move to be seen; is it where --start or the file's `start` says?";
        });
    return;
  }
  auto detector = options.detector(camera);
  Run run(options, camera, columns);
  Tracker tracker(camera, detector, settings);
  run(
      tracker, [&](MarkerId id) { return detector.model(id); },
      [&](const std::vector<PolarityFrame>& frames) {
        const std::string reason = why_untracked(frames, camera, options.looked_for());
        return reason.empty() ? std::string(kNoMarkerHint) : reason;
      });
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<TrackFileOptions>(
      "track_file", "Tracks fiducial markers in an event camera's recording.", argc, argv,
      [](const TrackFileOptions& options) {
        options.with_rule([&]<PoseUpdateRule Rule>(const auto&... chosen) { track<Rule>(options, chosen...); });
      });
}
