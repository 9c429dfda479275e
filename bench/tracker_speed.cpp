// Seconds in which the tracker takes a recording from memory, array by array: what python_speed.py compares with.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <exception>
#include <span>
#include <string>
#include <vector>

using namespace evmarker;

namespace {

double seconds_to_track(std::span<const Event> events, const PinholeCamera& camera, double marker_length,
                        std::size_t array_events) {
  using Detector = BoardDetector<opencv::ArucoDetector<PinholeCamera>>;  // as in Python
  const opencv::ArucoDetector aruco(camera, {.marker_length = marker_length});
  Tracker tracker(camera, Detector(camera, aruco, {}));
  std::vector<PoseEstimate> poses;
  const auto begin = std::chrono::steady_clock::now();
  while (!events.empty()) {
    const auto array = events.first(std::min(array_events, events.size()));
    poses.clear();
    tracker.push(array, [&](const PoseEstimate& pose) { poses.push_back(pose); });
    events = events.subspan(array.size());
  }
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Prints the seconds in which a recording is tracked from memory.", "tracker_speed");
  std::string path, calibration;
  double marker_length = 0.1;
  std::size_t array_events = 10000;
  app.add_option("recording", path, "of any kind that track_file reads")->required();
  app.add_option("--camera", calibration, "calibration: OpenCV or ROS YAML")->required();
  app.add_option("--marker-length", marker_length, "side of the black square [m]")->capture_default_str();
  app.add_option("--array-events", array_events, "events that are pushed at once")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    std::vector<Event> events;
    io::EventReader recording(path);
    for_each_event(recording, [&](const Event& event) { events.push_back(event); });
    const PinholeCamera camera = opencv::load_calibration(calibration);
    std::printf("%.6f\n", seconds_to_track(events, camera, marker_length, array_events));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "tracker_speed: %s\n", error.what());
    return 1;
  }
}
