#pragma once
// The options of every program that tracks markers.
#include <CLI/CLI.hpp>
#include <chrono>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/board.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "console.hpp"
#include "distinct_files.hpp"
#include "pose_output.hpp"

struct TrackOptions : PoseOutputOptions {
  std::string recording, camera, dictionary = "DICT_4X4_50", update = "kalman";
  double marker_length = 0;
  std::vector<std::string> boards;
  std::vector<int> ids;
  // Automatic or not, as the library has them.
  int events_per_update = evmarker::TrackerSettings<>{}.marker.events_per_update;
  int filter_window_us = static_cast<int>(evmarker::TrackerSettings<>{}.filter_window.count());
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("recording", recording, "Prophesee RAW (EVT2, EVT2.1, EVT3) or text (x, y, p and t in columns)")
        ->required();
    app.add_option("--camera", camera, "calibration: OpenCV or ROS YAML")->required();
    app.add_option("--dictionary", dictionary, "OpenCV's name of the ArUco or AprilTag dictionary")
        ->capture_default_str();
    app.add_option("--marker-length", marker_length, "side of the black square [m]; not needed to track boards alone")
        ->check(console::marker_length());
    app.add_option("--board", boards, "board of markers to track as one, a YAML file; may be given again");
    app.add_option("--ids", ids, "track only these markers, as 3,7")->delimiter(',');
    app.add_option("--update", update,
                   "update rule: kalman, decoupled (the paper's, tuned) or paper (with its own numbers)")
        ->check(CLI::IsMember({"kalman", "decoupled", "paper"}))
        ->capture_default_str();
    app.add_option("--events-per-update", events_per_update, "matched events per pose; auto: by the marker's size")
        ->transform(console::automatic_or_up_to(1000000))
        ->default_str(console::automatic_or(events_per_update));
    app.add_option("--filter-window-us", filter_window_us,
                   "noise filter: age of a supporting event; auto: by the noise that there is")
        ->transform(console::automatic_or_up_to(480000000))
        ->default_str(console::automatic_or(filter_window_us));
    PoseOutputOptions::add_to(app);
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes());
  }

  std::vector<FileOption> files_read() const {
    std::vector<FileOption> files{{"the recording", recording}, {"--camera", camera}};
    for (const std::string& board : boards) files.push_back({"--board", board});
    return files;
  }

  template <evmarker::PoseUpdateRule Rule>
  evmarker::TrackerSettings<Rule> settings(const typename Rule::Settings& rule) const {
    return {.filter_window = std::chrono::microseconds(filter_window_us),
            .marker = {.events_per_update = events_per_update, .update = rule}};
  }

  /// Calls `use.operator()<Rule>(settings, columns)` for the rule that was chosen, with the columns that its poses
  /// fill.
  template <typename Use>
  void with_rule(const Use& use) const {
    using namespace evmarker;
    if (update == "kalman")
      return use.template operator()<KalmanUpdate>(KalmanUpdate::Settings{}, io::PoseColumns::pose_and_motion);
    const auto rule = update == "paper" ? DecoupledSettings::paper() : DecoupledSettings{};
    use.template operator()<DecoupledUpdate>(rule, io::PoseColumns::pose);
  }

  /// Finds the boards, and single markers if their length is given.
  auto detector(const evmarker::PinholeCamera& of_camera) const {
    std::vector<evmarker::Board> loaded;
    for (const std::string& path : boards) loaded.push_back(evmarker::opencv::load_board(path, dictionary));
    return evmarker::BoardDetector(of_camera, evmarker::opencv::ArucoDetector(of_camera, aruco_settings(loaded)),
                                   loaded);
  }

  /// True if the options name a single marker or board.
  bool track_one() const {
    const std::size_t markers = marker_length == 0 ? 0 : ids.empty() ? 2 : ids.size();
    return boards.size() + markers == 1;
  }

 private:
  evmarker::opencv::ArucoDetectorSettings aruco_settings(const std::vector<evmarker::Board>& loaded) const {
    if (marker_length == 0 && loaded.empty()) throw std::invalid_argument("--marker-length is required (see --help)");
    if (marker_length == 0 && !ids.empty())
      throw std::invalid_argument("--ids: the markers need --marker-length, the board's do not");
    evmarker::opencv::ArucoDetectorSettings settings{.dictionary = dictionary, .ids = ids};
    settings.marker_length = marker_length > 0 ? marker_length : loaded[0].markers[0].length;
    if (marker_length > 0 && ids.empty()) return settings;
    for (const evmarker::Board& board : loaded)
      for (const evmarker::BoardMarker& marker : board.markers) settings.ids.push_back(marker.id);
    return settings;
  }
};
