#pragma once
// A camera's calibration as a command line names it.
#include <CLI/CLI.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <optional>
#include <string>
#include <vector>

struct CameraOption {
  std::string path, name;
  std::vector<int> size;

  /// Adds --camera and --camera-name.
  /// @param what --camera is in this program
  /// @param option in place of --camera
  CLI::Option* add_to(CLI::App& app, const std::string& what = "calibration", const std::string& option = "--camera") {
    CLI::Option* camera =
        app.add_option(option, path, what + " in the form of OpenCV, ROS, Kalibr, Metavision, DSEC or RPG");
    app.add_option("--camera-name", name, "of the camera in a calibration of several, as cam0")->needs(camera);
    return camera;
  }

  /// Adds --size, which not all calibrations state.
  void add_size_to(CLI::App& app) {
    app.add_option("--size", size, "sensor of a calibration that does not state it, as RPG's: 240,180 [px]")
        ->delimiter(',')
        ->expected(2)
        ->allow_extra_args(false)  // which would be the recording
        ->check(CLI::Range(1, evmarker::SensorSize::kMaxSide));
  }

  /// @throws std::runtime_error naming file, field and value
  evmarker::PinholeCamera load() const {
    std::optional<evmarker::SensorSize> given;
    if (!size.empty()) given = {size[0], size[1]};
    return evmarker::opencv::load_calibration(path, {.camera = name, .sensor_size = given});
  }
};
