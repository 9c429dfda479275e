#pragma once
// Reading and writing of camera calibrations in the formats of OpenCV and ROS.
#include <cerrno>
#include <fstream>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

namespace detail {

// True if the file says that its distortion is a fisheye lens's; by default it is not.
inline bool is_fisheye(const SettingsFile& file) {
  for (const char* field : {"fisheye", "fisheye_model"})
    if (file.has(field)) return file.flag(field);
  for (const char* field : {"distortion_model", "camera_model"}) {
    if (!file.has(field)) continue;
    const std::string name = file.text(field);
    for (const char* fisheye : {"fisheye", "equidistant", "equi", "kannala_brandt"})
      if (name == fisheye) return true;
    for (const char* radial : {"plumb_bob", "radtan", "brown_conrady", "rational_polynomial", "pinhole", "none", ""})
      if (name == radial) return false;
    file.fail(std::string(field) + " is \"" + name + "\", not plumb_bob, rational_polynomial or fisheye");
  }
  return false;
}

// Fails for more than the coefficients that the library has.
inline Distortion read_distortion(const SettingsFile& file) {
  const std::string field = "distortion_coefficients";
  std::vector<double> k = file.matrix(field);
  const std::size_t given = k.size();
  if (is_fisheye(file)) {
    if (given != 4) file.fail(field + " has " + std::to_string(given) + " numbers; a fisheye lens has 4");
    return EquidistantDistortion{k[0], k[1], k[2], k[3]};
  }
  if (given != 4 && given != 5 && given != 8 && given != 12 && given != 14)
    file.fail(field + " has " + std::to_string(given) + " numbers, not 4 or 5 (k1 k2 p1 p2 k3)");
  for (std::size_t i = 5; i < given; ++i)
    if (k[i] != 0)
      file.fail(field + "[" + std::to_string(i) + "] is " + SettingsFile::show(k[i]) +
                ": rational, thin prism and tilted lenses are not supported, calibrate with 5 coefficients");
  k.resize(5);
  if (k == std::vector<double>(5)) return NoDistortion{};
  return BrownConradyDistortion{k[0], k[1], k[2], k[3], k[4]};
}

}  // namespace detail

/// Reads a calibration as OpenCV's FileStorage (YAML, XML, JSON) or ROS's camera_info (YAML) write it: the fields
/// `image_width`, `image_height`, `camera_matrix`, `distortion_coefficients` and, optionally, `fisheye` or
/// `fisheye_model`, or else `distortion_model` or `camera_model`.
/// @throws std::runtime_error naming file, field and value
inline PinholeCamera load_calibration(const std::string& path) {
  const detail::SettingsFile file("calibration", path);
  const SensorSize size{file.positive_integer("image_width"), file.positive_integer("image_height")};
  const std::vector<double> k = file.matrix("camera_matrix");
  if (k.size() != 9) file.fail("camera_matrix has " + std::to_string(k.size()) + " elements, not 3 x 3");
  const char* const names[] = {"fx", "skew", "cx", "[1][0]", "fy", "cy", "[2][0]", "[2][1]", "[2][2]"};
  const double expected[] = {1, 0, 1, 0, 1, 1, 0, 0, 1};
  for (const std::size_t i : {std::size_t{1}, std::size_t{3}, std::size_t{6}, std::size_t{7}, std::size_t{8}})
    if (k[i] != expected[i])
      file.fail(std::string("camera_matrix ") + names[i] + " is " + detail::SettingsFile::show(k[i]) + ", not " +
                detail::SettingsFile::show(expected[i]));
  for (const std::size_t i : {std::size_t{0}, std::size_t{4}})
    if (!(k[i] > 0))
      file.fail(std::string("camera_matrix ") + names[i] + " is " + detail::SettingsFile::show(k[i]) +
                ", not positive");
  return PinholeCamera(size, k[0], k[4], k[2], k[5], detail::read_distortion(file));
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
