// Measures where single markers are on a body from a recording of it, and writes them as a board.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/board_writer.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/model/board_calibration.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <filesystem>
#include <numbers>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "camera_option.hpp"
#include "console.hpp"
#include "distinct_files.hpp"
#include "interruption.hpp"
#include "reader_options.hpp"
#include "recording_checks.hpp"
#include "timed_poses.hpp"

using namespace evmarker;

namespace {

struct Options {
  std::string recording, dictionary = "DICT_4X4_50", output;
  CameraOption camera;
  double marker_length = 0;
  std::vector<int> ids;
  int board_id = 100;
  std::optional<int> origin;
  ReaderOptions reader;
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("recording", recording,
                   "the body, turned before the camera so that neighbouring markers are seen together: Prophesee RAW "
                   "or DAT, AEDAT, ROS, HDF5 or text")
        ->required();
    camera.add_to(app)->required();
    camera.add_size_to(app);
    app.add_option("--marker-length", marker_length, "side of the black squares [m]")
        ->check(console::marker_length())
        ->required();
    app.add_option("--dictionary", dictionary, "OpenCV's name of the ArUco or AprilTag dictionary")
        ->capture_default_str();
    app.add_option("--ids", ids, "the markers on the body, as 1,2,3")->delimiter(',')->required();
    app.add_option("--output", output, "the board, a YAML file for the option --board of the other programs")
        ->required();
    app.add_option("--board-id", board_id, "id of the board's poses, other than those of the markers")
        ->check(CLI::Range(0, 1000000000))
        ->capture_default_str();
    app.add_option("--origin", origin, "the marker whose frame is the board's; default: the first of --ids");
    reader.add_to(app);
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes());
  }

  // The marker at the origin first.
  std::vector<MarkerId> ordered_ids() const {
    if (std::ranges::count(ids, board_id) > 0)
      throw std::invalid_argument("--board-id: " + std::to_string(board_id) + " is a marker of --ids, too");
    std::vector<MarkerId> ordered = ids;
    if (!origin) return ordered;
    const auto first = std::ranges::find(ordered, *origin);
    if (first == ordered.end())
      throw std::invalid_argument("--origin: " + std::to_string(*origin) + " is not one of --ids");
    std::rotate(ordered.begin(), first, first + 1);
    return ordered;
  }
};

// Adds the poses of all markers a hundred times a second; returns for how long they were recorded [s].
double track(const Options& o, const PinholeCamera& camera, const TrackerSettings<>& settings,
             BoardCalibrator& calibrator) {
  io::EventReader recording = recording_checks::open(o.recording, camera.sensor_size(), o.camera.path, o.reader);
  const opencv::ArucoDetector detector(camera,
                                       {.dictionary = o.dictionary, .marker_length = o.marker_length, .ids = o.ids});
  Tracker tracker(camera, detector, settings);
  TickTimes ticks(std::chrono::milliseconds(10), std::chrono::seconds(1));
  console::ProgressBar progress(o.quiet);
  std::optional<Timestamp> begin;
  Timestamp end = 0;
  for (auto batch = recording.next_batch(); !batch.empty() && !interruption::requested;
       batch = recording.next_batch()) {
    recording_checks::require_sane(recording, o.recording, o.camera.path, false);
    if (!begin) begin = batch.front().t;
    end = batch.back().t;
    push_with_ticks(
        ticks, tracker, batch, [](const PoseEstimate&) {},
        [&](Timestamp, std::span<const PoseEstimate> poses) { calibrator.add(poses); });
    progress.update(recording.bytes_read(), recording.bytes_total());
  }
  if (!interruption::requested) recording_checks::require_sane(recording, o.recording, o.camera.path, true);
  return begin && end > *begin ? 1e-6 * static_cast<double>(elapsed_us(*begin, end)) : 0;
}

void print(const BoardCalibration& calibration) {
  std::puts("marker  instants   sigma mm    deg");
  for (const CalibratedMarker& marker : calibration.markers)
    std::printf("%6d  %8zu  %9.3f  %5.3f\n", marker.id, marker.views, 1e3 * marker.sigma_m,
                180 / std::numbers::pi * marker.sigma_rad);
  std::printf("%zu instants, corners within %.2f px (root mean square)\n", calibration.views, calibration.residual_px);
}

Board make(const Options& o, const BoardCalibration& calibration) {
  const cv::aruco::Dictionary dictionary = opencv::make_dictionary(o.dictionary);
  Board board{o.board_id, {}};
  for (const CalibratedMarker& marker : calibration.markers)
    board.markers.push_back(
        {marker.id, o.marker_length, opencv::marker_bits(dictionary, marker.id, o.dictionary), marker.T_board_marker});
  return board;
}

// Longer motion, as the calibrator advises, shows no marker that is not there.
std::string advice_on(const std::vector<MarkerId>& never_tracked) {
  std::string ids;
  for (const MarkerId id : never_tracked) ids += (ids.empty() ? "" : ", ") + std::to_string(id);
  if (ids.empty()) return ids;
  return "; never tracked: " + ids + ": on the body, in --dictionary and as large as --marker-length says?";
}

void make_board(const Options& o) {
  const std::vector<MarkerId> ids = o.ordered_ids();
  require_distinct({{"the recording", o.recording}, {"--camera", o.camera.path}}, {{"--output", o.output}});
  require_ending({"--output", o.output}, kBoardEndings);
  interruption::watch();
  const PinholeCamera camera = o.camera.load();
  BoardCalibrator calibrator(ids, o.marker_length, camera.focal_length());
  const double recorded_s = track(o, camera, {}, calibrator);
  // A pipe can be read only once. What is interrupted the second time is better as it was known the first time.
  if (!interruption::requested && std::filesystem::is_regular_file(o.recording)) {
    TrackerSettings<> settings;
    settings.marker.update.initial_trail_px = calibrator.trail_px();
    settings.marker.update.initial_sigma_trail_px = 1e-4;
    BoardCalibrator with_trail(ids, o.marker_length, camera.focal_length());
    track(o, camera, settings, with_trail);
    if (!interruption::requested) calibrator = std::move(with_trail);
  }
  const bool interrupted = interruption::requested;
  BoardCalibration calibration;
  try {
    calibration = calibrator.solve();
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(o.recording + ": " + error.what() + advice_on(calibrator.never_tracked()));
  }
  io::save_board(o.output, make(o, calibration), o.dictionary);
  print(calibration);
  std::printf("written to %s\n", o.output.c_str());
  if (interrupted)
    interruption::end(recorded_s, {"a board of " + std::to_string(ids.size()) + " markers in " + o.output});
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("make_board", "Measures where markers are on a body, and writes them as a board.", argc,
                               argv, make_board);
}
