#pragma once
// Reading of camera calibrations from files, in the forms that people have, and writing in that of OpenCV.
#include <cerrno>
#include <fstream>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/calibration_forms.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

namespace detail {

inline PinholeCamera read_calibration(const SettingsFile& file, const CalibrationOptions& options) {
  if (file.has("intrinsics") && file.required("intrinsics").isMap()) {
    const std::vector<cv::FileNode> cameras = find_cameras(file.required("intrinsics"), "camera_matrix");
    if (cameras.empty()) file.fail("intrinsics has no camera with a field camera_matrix");
    return read_named_camera(file, choose_camera(file, cameras, options.camera), "camera_matrix");
  }
  if (const std::vector<cv::FileNode> cameras = find_cameras(file.root(), "intrinsics"); !cameras.empty())
    return read_named_camera(file, choose_camera(file, cameras, options.camera), "intrinsics");
  if (!options.camera.empty() && !(file.has("camera_name") && file.text("camera_name") == options.camera))
    file.fail("has no camera of the name " + options.camera + ", but a single camera, which needs none");
  if (file.has("numbers")) return read_numbers(file, "numbers", options);
  if (file.has("K") || file.has("k")) return read_lists(file, options);
  for (const char* field : {"image_width", "image_size", "camera_matrix", "distortion_coefficients"})
    if (file.has(field)) return read_matrices(file, options);
  file.fail(
      "is no calibration: it has no field camera_matrix (OpenCV, ROS), K (ROS message, Metavision) or intrinsics "
      "(Kalibr, DSEC)");
}

}  // namespace detail

/// Reads a calibration. Its form is recognised by its fields:
/// - OpenCV's FileStorage (YAML, XML, JSON) and ROS's camera_info (YAML): `image_width`, `image_height`,
///   `camera_matrix`, `distortion_coefficients` and, optionally, `fisheye` or `fisheye_model`, or else
///   `distortion_model` or `camera_model`; of Metavision's calibration (JSON) `image_size` in place of the first two;
/// - ROS's camera_info as printed (`ros2 topic echo`: k, d; `rostopic echo`: K, D), the first of several messages, and
///   Metavision's camera geometry (JSON): `width`, `height`, `K`, `D`, `distortion_model` or `type`;
/// - Kalibr's camchain: for each camera a map of `camera_model`, `intrinsics`, `distortion_model`,
///   `distortion_coeffs` and `resolution`; DSEC's cam_to_cam.yaml: the same with `camera_matrix` under `intrinsics`;
/// - RPG's calib.txt: fx fy cx cy k1 k2 p1 p2 k3, without the sensor's size.
/// @throws std::runtime_error naming file, field and value, also where camera or size must be given and are not
inline PinholeCamera load_calibration(const std::string& path, const CalibrationOptions& options = {}) {
  const detail::SettingsFile file("calibration", path, {.numbers = "numbers", .first_document = true});
  const PinholeCamera camera = detail::read_calibration(file, options);
  if (const SensorSize size = camera.sensor_size(); options.sensor_size && *options.sensor_size != size)
    file.fail("is of a sensor of " + std::to_string(size.width) + " x " + std::to_string(size.height) + " px, not " +
              std::to_string(options.sensor_size->width) + " x " + std::to_string(options.sensor_size->height) + " px");
  return camera;
}

/// Writes a calibration that `load_calibration` and OpenCV read: as XML or JSON if the path ends in .xml or .json, else
/// as YAML.
/// @throws std::runtime_error naming the path that cannot be written
inline void save_calibration(const std::string& path, const PinholeCamera& camera) {
  const auto ends_with = [&](const char* ending) { return path.ends_with(ending); };
  const std::string format = ends_with(".xml") ? ".xml" : ends_with(".json") ? ".json" : ".yml";
  cv::FileStorage storage(format, cv::FileStorage::WRITE | cv::FileStorage::MEMORY);
  cv::Mat coefficients = cv::Mat::zeros(1, 5, CV_64F);
  std::string model = "plumb_bob";
  if (const auto* d = std::get_if<BrownConradyDistortion>(&camera.distortion())) {
    coefficients = (cv::Mat_<double>(1, 5) << d->k1, d->k2, d->p1, d->p2, d->k3);
  } else if (const auto* f = std::get_if<EquidistantDistortion>(&camera.distortion())) {
    coefficients = (cv::Mat_<double>(1, 4) << f->k1, f->k2, f->k3, f->k4);
    model = "fisheye";
  }
  const cv::Mat matrix = (cv::Mat_<double>(3, 3) << camera.fx(), 0, camera.cx(), 0, camera.fy(), camera.cy(), 0, 0, 1);
  storage << "image_width" << camera.sensor_size().width << "image_height" << camera.sensor_size().height;
  storage << "camera_matrix" << matrix << "distortion_model" << model << "distortion_coefficients" << coefficients;
  errno = 0;
  std::ofstream file(path, std::ios::binary);
  if (!(file << storage.releaseAndGetString() << std::flush))
    throw std::runtime_error("calibration " + path + ": cannot be written: " + std::generic_category().message(errno));
}

}  // namespace evmarker::opencv
