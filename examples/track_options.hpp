#pragma once
// The options of every program that tracks markers.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/board.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "camera_option.hpp"
#include "console.hpp"
#include "distinct_files.hpp"
#include "marker_lengths.hpp"
#include "pose_output.hpp"

/// Exit code of a program that found nothing to track, and what it says then.
inline constexpr int kNothingFound = 2;
inline constexpr const char* kNoMarkerHint =
    "no marker was tracked: it must move to be seen; is it in --dictionary and --ids, its border as wide as in "
    "--board?";

struct TrackOptions : PoseOutputOptions {
  std::string recording, dictionary, update = "kalman";
  CameraOption camera;
  MarkerLengths lengths;
  std::vector<std::string> boards;
  std::vector<int> ids;
  // Automatic or not, as the library has them.
  int events_per_update = evmarker::TrackerSettings<>{}.marker.events_per_update;
  int filter_window_us = static_cast<int>(evmarker::TrackerSettings<>{}.filter_window.count());
  double latency_us = 0, latency_sigma_us = 1e6 * evmarker::KalmanSettings{}.latency_sigma_s;
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("recording", recording, "Prophesee RAW or DAT, AEDAT, ROS, HDF5 or text (x, y, p and t in columns)")
        ->required();
    camera.add_to(app)->required();
    camera.add_size_to(app);
    app.add_option("--dictionary", dictionary, "OpenCV's name of the ArUco or AprilTag dictionary")
        ->default_str("that of --board, or " + std::string(evmarker::opencv::kDefaultDictionary));
    lengths.add_to(app, "side of the black square [m], not needed to track boards alone");
    app.add_option("--board", boards, "boards of markers to track as one each, a YAML file; may be given again");
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
    app.add_option("--latency-us", latency_us,
                   "known delay of the camera's events, beside the one that they show: poses are moved forward by it")
        ->check(CLI::Range(0.0, 1e6))
        ->capture_default_str();
    app.add_option("--latency-sigma-us", latency_sigma_us,
                   "standard deviation of that delay: it widens the covariance along the motion")
        ->check(CLI::Range(1.0, 1e6))
        ->capture_default_str();
    PoseOutputOptions::add_to(app);
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes());
  }

  std::vector<FileOption> files_read() const {
    std::vector<FileOption> files{
        {"the recording", recording}, {"--camera", camera.path}, {"--markers", lengths.file()}};
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
      return use.template operator()<KalmanUpdate>(
          KalmanUpdate::Settings{.latency_s = 1e-6 * latency_us, .latency_sigma_s = 1e-6 * latency_sigma_us},
          io::PoseColumns::pose_and_motion);
    if (latency_us > 0 || latency_sigma_us != TrackOptions{}.latency_sigma_us)
      throw std::invalid_argument(
          "--latency-us, --latency-sigma-us: only --update kalman estimates the motion they need");
    const auto rule = update == "paper" ? DecoupledSettings::paper() : DecoupledSettings{};
    use.template operator()<DecoupledUpdate>(rule, io::PoseColumns::pose);
  }

  /// Finds the boards, and single markers if their length is given. Says why a board is refused.
  auto detector(const evmarker::PinholeCamera& of_camera) const {
    const evmarker::opencv::BoardFile loaded = load_boards();
    const evmarker::opencv::ArucoDetectorSettings settings = aruco_settings(loaded);
    for (const int id : relative) require_tracked(id, loaded, settings.ids);
    return evmarker::BoardDetector(of_camera, evmarker::opencv::ArucoDetector(of_camera, settings), loaded.boards,
                                   [](const evmarker::BoardContradiction& contradiction) {
                                     console::say(contradiction.message() + " (or --camera is of another camera)");
                                   });
  }

  /// The markers that are looked for, those of the boards, too.
  evmarker::opencv::ArucoDetectorSettings looked_for() const { return aruco_settings(load_boards()); }

  /// True if the options name a single marker or board.
  bool track_one() const {
    const std::size_t several = 2, of_known_length = lengths.file().empty() ? lengths.own().size() : several;
    const std::size_t markers = !ids.empty() ? ids.size() : lengths.common() > 0 ? several : of_known_length;
    return boards.size() + markers == 1;
  }

 private:
  // The boards of all files, and the dictionary of all markers.
  evmarker::opencv::BoardFile load_boards() const {
    evmarker::opencv::BoardFile all{{}, dictionary};
    for (const std::string& path : boards) {
      evmarker::opencv::BoardFile file = evmarker::opencv::load_boards(path, dictionary);
      if (all.boards.empty()) all = {{}, file.dictionary, file.border_cells};
      if (file.dictionary != all.dictionary)
        throw std::invalid_argument("--board " + path + ": its markers are from " + file.dictionary + ", those of " +
                                    boards.front() + " from " + all.dictionary + ": they are not found together");
      if (file.border_cells != all.border_cells)
        throw std::invalid_argument("--board " + path + ": the border of its markers is " +
                                    std::to_string(file.border_cells) + " cells wide, that of " + boards.front() + " " +
                                    std::to_string(all.border_cells) + ": they are not found together");
      all.boards.insert(all.boards.end(), file.boards.begin(), file.boards.end());
    }
    if (all.dictionary.empty()) all.dictionary = evmarker::opencv::kDefaultDictionary;
    return all;
  }

  // @param found ids of the markers that are found, of boards or alone; empty for all
  static void require_tracked(int id, const evmarker::opencv::BoardFile& loaded, const std::vector<int>& found) {
    const std::string option = "--relative: " + std::to_string(id);
    for (const evmarker::Board& board : loaded.boards) {
      if (board.id == id) return;
      if (std::ranges::count(board.markers, id, &evmarker::BoardMarker::id) > 0)
        throw std::invalid_argument(option + " is a marker of board " + std::to_string(board.id) +
                                    ", which is tracked as a whole: name the board");
    }
    if (!found.empty() && std::ranges::count(found, id) == 0)
      throw std::invalid_argument(option + " is not tracked: it is neither a board nor a marker that is looked for");
  }

  // What to find: the boards' markers, and of the single ones those of --ids, or those whose length is known.
  evmarker::opencv::ArucoDetectorSettings aruco_settings(const evmarker::opencv::BoardFile& loaded) const {
    MarkerLengths single = lengths;
    single.load();
    if (single.empty() && boards.empty()) throw std::invalid_argument("--marker-length is required (see --help)");
    if (single.empty() && !ids.empty())
      throw std::invalid_argument("--ids: the markers need --marker-length, the board's do not");
    evmarker::opencv::ArucoDetectorSettings settings{
        .dictionary = loaded.dictionary, .lengths = single.own(), .border_cells = loaded.border_cells};
    if (single.common() > 0) settings.marker_length = single.common();
    if (single.common() > 0 && ids.empty()) return settings;
    settings.ids = ids.empty() ? single.ids() : ids;
    for (const int id : settings.ids) single.of(id);
    for (const evmarker::Board& board : loaded.boards)
      for (const evmarker::BoardMarker& marker : board.markers) settings.ids.push_back(marker.id);
    return settings;
  }
};
