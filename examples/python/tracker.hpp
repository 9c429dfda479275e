#pragma once
// A tracker of markers and boards for Python.
#include <pybind11/pybind11.h>

#include <chrono>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/board.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "event_arrays.hpp"
#include "pose_arrays.hpp"

namespace python {

/// That of all markers [m], or of some by their ids.
using MarkerLength = std::variant<double, std::map<int, double>>;

struct TrackerOptions {
  std::optional<std::string> dictionary;
  std::optional<MarkerLength> marker_length;
  std::optional<std::string> boards;
  std::optional<std::vector<int>> ids;
  std::optional<int> events_per_update, filter_window_us;
  std::optional<double> latency_us, latency_sigma_us;
};

/// Sets the lengths of markers, and which to find where they are told by id.
inline void set_lengths(const MarkerLength& given, evmarker::opencv::ArucoDetectorSettings& settings) {
  if (const auto* common = std::get_if<double>(&given)) {
    settings.marker_length = *common;
    return;
  }
  settings.lengths = std::get<1>(given);
  if (settings.lengths.empty()) throw std::invalid_argument("tracker: marker_length names no marker");
  for (const auto& [id, length] : settings.lengths) settings.ids.push_back(id);
}

/// Sets which markers to find.
inline void choose(const std::vector<int>& ids, evmarker::opencv::ArucoDetectorSettings& settings) {
  for (const int id : ids)
    if (!settings.lengths.empty() && !settings.lengths.contains(id))
      throw std::invalid_argument("tracker: marker " + std::to_string(id) + " of ids has no marker_length");
  settings.ids = ids;
}

/// Tracks the markers and boards that are seen. Calls from several threads wait for each other.
class Tracker {
 public:
  /// @throws std::invalid_argument or std::runtime_error naming the option, or the file and its field
  Tracker(const evmarker::PinholeCamera& camera, const TrackerOptions& options)
      : tracker_(camera, make_detector(camera, options, refused_), settings(options)) {}

  /// @param events an EventArray or EventColumns
  template <typename Events>
  py::array push(const Events& events) {
    std::vector<PoseRow> rows;
    std::vector<std::string> refused;
    {
      const py::gil_scoped_release unlocked;
      const std::scoped_lock lock(mutex_);
      events.for_each_block([&](std::span<const evmarker::Event> block) {
        tracker_.push(block, [&](const evmarker::PoseEstimate& pose) { rows.push_back(pose_row(pose)); });
      });
      refused.swap(*refused_);
    }
    for (const std::string& why : refused)
      if (PyErr_WarnEx(PyExc_UserWarning, why.c_str(), 1) != 0) throw py::error_already_set();
    return pose_array(pose_dtype_, rows);
  }

  /// The poses of all tracked markers, moved on to a time. All events before it must have been pushed.
  py::array poses_at(evmarker::Timestamp t) {
    std::vector<PoseRow> rows;
    {
      const py::gil_scoped_release unlocked;
      const std::scoped_lock lock(mutex_);
      for (const auto& marker : tracker_.markers())
        rows.push_back(pose_row(t > marker.estimate().t ? marker.pose_at(t, t) : marker.estimate()));
    }
    return pose_array(pose_dtype_, rows);
  }

  evmarker::TrackerStatistics statistics() {
    const py::gil_scoped_release unlocked;
    const std::scoped_lock lock(mutex_);
    return tracker_.statistics();
  }

 private:
  using Aruco = evmarker::opencv::ArucoDetector<evmarker::PinholeCamera>;
  using Detector = evmarker::BoardDetector<Aruco>;

  static Detector make_detector(const evmarker::PinholeCamera& camera, const TrackerOptions& options,
                                const std::shared_ptr<std::vector<std::string>>& refused) {
    if (!options.marker_length && !options.boards)
      throw std::invalid_argument("tracker: marker_length is missing; only boards need none");
    if (!options.marker_length && options.ids)
      throw std::invalid_argument("tracker: ids are of markers that need a marker_length");
    evmarker::opencv::BoardFile file{{},
                                     options.dictionary.value_or(std::string(evmarker::opencv::kDefaultDictionary))};
    if (options.boards) file = evmarker::opencv::load_boards(*options.boards, options.dictionary.value_or(""));
    evmarker::opencv::ArucoDetectorSettings settings{.dictionary = file.dictionary, .border_cells = file.border_cells};
    if (options.marker_length) set_lengths(*options.marker_length, settings);
    if (options.ids) choose(*options.ids, settings);
    if (!options.marker_length || !settings.ids.empty())
      for (const evmarker::Board& board : file.boards)
        for (const evmarker::BoardMarker& marker : board.markers) settings.ids.push_back(marker.id);
    return {
        camera, Aruco(camera, settings), std::move(file.boards),
        [refused](const evmarker::BoardContradiction& contradiction) { refused->push_back(contradiction.message()); }};
  }

  static evmarker::TrackerSettings<> settings(const TrackerOptions& options) {
    evmarker::TrackerSettings<> settings;
    if (options.events_per_update) settings.marker.events_per_update = *options.events_per_update;
    if (options.filter_window_us) settings.filter_window = std::chrono::microseconds(*options.filter_window_us);
    if (options.latency_us) settings.marker.update.latency_s = 1e-6 * *options.latency_us;
    if (options.latency_sigma_us) settings.marker.update.latency_sigma_s = 1e-6 * *options.latency_sigma_us;
    return settings;
  }

  py::dtype pose_dtype_ = pose_dtype();
  std::mutex mutex_;
  std::shared_ptr<std::vector<std::string>> refused_ =
      std::make_shared<std::vector<std::string>>();  // what is to warn of
  evmarker::Tracker<Detector> tracker_;
};

}  // namespace python
