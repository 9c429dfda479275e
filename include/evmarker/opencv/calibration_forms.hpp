#pragma once
// The forms of calibration files: OpenCV's and ROS's matrices, printed ROS messages and Metavision's geometries,
// the cameras of Kalibr and DSEC, RPG's calib.txt.
#include <array>
#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/lens_models.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv {

/// What a calibration file leaves open.
struct CalibrationOptions {
  std::string camera{};                     ///< name of the camera to use where the file has several, as Kalibr's cam0
  std::optional<SensorSize> sensor_size{};  ///< for files that do not state it, as RPG's calib.txt
};

namespace detail {

// fx, fy, cx and cy [px], and their name in errors.
struct Intrinsics {
  std::array<double, 4> values;
  std::string field;
};

inline PinholeCamera make_camera(const SettingsFile& file, SensorSize size, const Intrinsics& intrinsics,
                                 const Distortion& distortion) {
  const auto& [fx, fy, cx, cy] = intrinsics.values;
  for (const auto& [name, focal] : {std::pair("fx", fx), std::pair("fy", fy)})
    if (!(focal > 0)) file.fail(intrinsics.field + " " + name + " is " + SettingsFile::show(focal) + ", not positive");
  return PinholeCamera(size, fx, fy, cx, cy, distortion);
}

// The focal lengths and the principal point of a camera matrix, row by row.
inline Intrinsics from_matrix(const SettingsFile& file, const std::vector<double>& k, const std::string& field) {
  if (k.size() != 9) file.fail(field + " has " + std::to_string(k.size()) + " elements, not 3 x 3");
  if (k == std::vector<double>(9))
    file.fail(field + " is all 0: the camera was not calibrated");  // as ROS publishes it
  const char* const names[] = {"fx", "skew", "cx", "[1][0]", "fy", "cy", "[2][0]", "[2][1]", "[2][2]"};
  for (const std::size_t i : {std::size_t{1}, std::size_t{3}, std::size_t{6}, std::size_t{7}, std::size_t{8}}) {
    const double expected = i == 8 ? 1 : 0;
    if (k[i] != expected)
      file.fail(field + " " + names[i] + " is " + SettingsFile::show(k[i]) + ", not " + SettingsFile::show(expected));
  }
  return {{k[0], k[4], k[2], k[5]}, field};
}

// A list of so many numbers; `what` says which.
inline std::vector<double> read_list(const SettingsFile& file, const cv::FileNode& node, const std::string& field,
                                     std::size_t size, const std::string& what) {
  std::vector<double> numbers = file.numbers(node, field);
  if (numbers.size() != size)
    file.fail(field + " has " + std::to_string(numbers.size()) + " numbers, not " + std::to_string(size) + ": " + what);
  return numbers;
}

// The size in a list of width and height.
inline SensorSize read_size(const SettingsFile& file, const cv::FileNode& node, const std::string& field) {
  read_list(file, node, field, 2, "width and height");
  return {file.positive_integer(node[0], field + "[0]"), file.positive_integer(node[1], field + "[1]")};
}

// The size in two fields, or the one that is given where the file has neither.
inline SensorSize read_size(const SettingsFile& file, const std::string& width, const std::string& height,
                            const CalibrationOptions& options) {
  if (!file.has(width) && !file.has(height) && options.sensor_size) return *options.sensor_size;
  return {file.positive_integer(width), file.positive_integer(height)};
}

// The lens of a file whose coefficients may be of any model: by default a radial-tangential one.
inline LensModel read_lens_model(const SettingsFile& file) {
  for (const char* field : {"fisheye", "fisheye_model"})
    if (file.has(field)) return file.flag(field) ? LensModel::fisheye : LensModel::radial_tangential;
  for (const char* field : {"distortion_model", "camera_model", "type"})
    if (file.has(field)) return read_lens_model(file, file.required(field), field);
  return LensModel::radial_tangential;
}

// OpenCV's FileStorage, ROS's camera_info as calibration file, and what Metavision's mono calibration writes (with
// `image_size`), which does not name its model: its pinhole lens has 5 coefficients, its fisheye lens 4.
inline PinholeCamera read_matrices(const SettingsFile& file, const CalibrationOptions& options) {
  const SensorSize size = file.has("image_size") ? read_size(file, file.required("image_size"), "image_size")
                                                 : read_size(file, "image_width", "image_height", options);
  const Intrinsics intrinsics = from_matrix(file, file.matrix("camera_matrix"), "camera_matrix");
  const std::vector<double> coefficients = file.matrix("distortion_coefficients");
  const bool metavision_fisheye = file.has("n_kept_views") && coefficients.size() == 4;
  const LensModel lens = metavision_fisheye ? LensModel::fisheye : read_lens_model(file);
  return make_camera(file, size, intrinsics, make_distortion(file, lens, coefficients, "distortion_coefficients"));
}

// Lists `K` and `D`, or `k` and `d`: a printed message of ROS 1 or 2 (`distortion_model`), or a camera geometry of
// Metavision (`type`).
inline PinholeCamera read_lists(const SettingsFile& file, const CalibrationOptions& options) {
  const std::string matrix = file.has("K") ? "K" : "k", coefficients = file.has("K") ? "D" : "d";
  const SensorSize size = read_size(file, "width", "height", options);
  const Intrinsics intrinsics = from_matrix(file, file.numbers(file.required(matrix), matrix), matrix);
  const std::vector<double> k = file.numbers(file.required(coefficients), coefficients);
  return make_camera(file, size, intrinsics, make_distortion(file, read_lens_model(file), k, coefficients));
}

// One of the cameras of Kalibr or DSEC, which have their focal lengths and principal point in the list `intrinsics` or
// `camera_matrix`.
inline PinholeCamera read_named_camera(const SettingsFile& file, const cv::FileNode& node, const char* intrinsics) {
  const std::string name = node.name();
  const auto field = [&](const char* of_camera) { return file.field(node, name, of_camera); };
  if (const cv::FileNode model = node["camera_model"]; !model.empty())
    if (const std::string text = file.text(model, name + " camera_model"); text != "pinhole")
      file.fail(name + " camera_model is \"" + text +
                "\", which is not supported: calibrate with pinhole and radtan or, a wide lens, equidistant");
  const std::string place = name + " " + intrinsics, coefficients = name + " distortion_coeffs";
  const std::vector<double> f = read_list(file, field(intrinsics), place, 4, "fx fy cx cy");
  const LensModel lens = read_lens_model(file, field("distortion_model"), name + " distortion_model");
  const std::vector<double> k = file.numbers(field("distortion_coeffs"), coefficients);
  return make_camera(file, read_size(file, field("resolution"), name + " resolution"),
                     {{f[0], f[1], f[2], f[3]}, place}, make_distortion(file, lens, k, coefficients));
}

// The maps in a map that have a field, which is what a camera has.
inline std::vector<cv::FileNode> find_cameras(const cv::FileNode& map, const char* field) {
  std::vector<cv::FileNode> cameras;
  for (const cv::FileNode& node : map)
    if (node.isMap() && !node[field].empty()) cameras.push_back(node);
  return cameras;
}

// The camera that is asked for, or the only one.
inline cv::FileNode choose_camera(const SettingsFile& file, const std::vector<cv::FileNode>& cameras,
                                  const std::string& asked) {
  std::string names;
  for (const cv::FileNode& node : cameras) {
    if (node.name() == asked || (cameras.size() == 1 && asked.empty())) return node;
    names += (names.empty() ? "" : ", ") + node.name();
  }
  if (!asked.empty()) file.fail("has no camera " + asked + ", but " + names);
  file.fail("has several cameras, " + names + ": choose one, --camera-name " + cameras.front().name() +
            " (in the options: camera)");
}

// RPG's calib.txt: one line.
inline PinholeCamera read_numbers(const SettingsFile& file, const std::string& field,
                                  const CalibrationOptions& options) {
  const std::vector<double> k =
      read_list(file, file.required(field), field, 9, "fx fy cx cy k1 k2 p1 p2 k3, as RPG's calib.txt");
  if (!options.sensor_size) file.fail("states no sensor size: give it, --size 240,180 (in the options: sensor_size)");
  return make_camera(file, *options.sensor_size, {{k[0], k[1], k[2], k[3]}, field},
                     make_distortion(file, LensModel::radial_tangential, {k.begin() + 4, k.end()}, field));
}

}  // namespace detail

}  // namespace evmarker::opencv
