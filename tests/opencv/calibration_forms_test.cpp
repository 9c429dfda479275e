// Files as the documentation of each form and its own programs have them.
#include "evmarker/opencv/calibration_forms.hpp"

#include <doctest/doctest.h>

#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "evmarker/opencv/calibration.hpp"
#include "settings_text.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;
using opencv::CalibrationOptions;

namespace {

// `ros2 topic echo`: lists of one element in a line, a message after the other.
const std::string kRos2Message = R"(header:
  stamp:
    sec: 1616693284
    nanosec: 2390000
  frame_id: event_camera
height: 480
width: 640
distortion_model: plumb_bob
d:
- -0.28
- 0.07
- 0.0015
- -0.00025
- 0.01
k:
- 533.5
- 0.0
- 319.25
- 0.0
- 534.5
- 239.75
- 0.0
- 0.0
- 1.0
r:
- 1.0
- 0.0
- 0.0
- 0.0
- 1.0
- 0.0
- 0.0
- 0.0
- 1.0
p:
- 500.0
- 0.0
- 310.0
- 0.0
- 0.0
- 501.0
- 230.0
- 0.0
- 0.0
- 0.0
- 1.0
- 0.0
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
)";

// `rostopic echo`
const std::string kRos1Message = R"(header: 
  seq: 7
  stamp: 
    secs: 1473347265
    nsecs: 904213000
  frame_id: ''
height: 260
width: 346
distortion_model: "equidistant"
D: [-0.048, 0.011, -0.055, 0.021]
K: [226.38, 0.0, 173.64, 0.0, 226.15, 133.73, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [199.65, 0.0, 177.43, 0.0, 0.0, 199.65, 126.81, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: 
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
)";

const std::string kKalibr = R"(cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0015, -0.00025]
  distortion_model: radtan
  intrinsics: [533.5, 534.5, 319.25, 239.75]
  resolution: [640, 480]
  rostopic: /dvs/left/image_raw
cam1:
  T_cn_cnm1:
  - [0.9999, -0.0074, 0.0011, -0.0497]
  - [0.0074, 0.9999, -0.0014, 0.0001]
  - [-0.0010, 0.0014, 0.9999, 0.0003]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.048, 0.011, -0.055, 0.021]
  distortion_model: equidistant
  intrinsics: [226.38, 226.15, 173.64, 133.73]
  resolution: [346, 260]
  rostopic: /dvs/right/image_raw
)";

// As PyYAML writes it; camRect0 is what remains after rectification.
const std::string kDsec = R"(disparity_to_depth:
  cams_03:
  - - 1.0
    - 0.0
  - - 0.0
    - 1.0
extrinsics:
  R_rect0:
  - - 0.9998
    - -0.0155
  - - 0.0155
    - 0.9998
intrinsics:
  cam0:
    camera_matrix:
    - 553.4686
    - 553.3994
    - 346.6527
    - 216.5213
    camera_model: pinhole
    distortion_coeffs:
    - -0.0935
    - 0.1945
    - 0.0001
    - 0.0019
    distortion_model: radtan
    resolution:
    - 640
    - 480
  cam1:
    camera_matrix:
    - 1164.62
    - 1164.33
    - 713.57
    - 574.98
    camera_model: pinhole
    distortion_coeffs:
    - -0.0749
    - 0.1204
    - 0.0002
    - 0.0001
    distortion_model: radtan
    resolution:
    - 1440
    - 1080
  camRect0:
    camera_matrix:
    - 569.7633
    - 569.7633
    - 335.0999
    - 221.2367
    resolution:
    - 640
    - 480
)";

const std::string kMetavisionGeometry = R"({
    "type": "pinhole",
    "width": 1280,
    "height": 720,
    "K": [1711.5, 0, 644.25, 0, 1710.5, 340.75, 0, 0, 1],
    "D": [-0.08, -0.0315, -0.00027, 0.0015, 0.25]
})";

// What metavision_mono_calibration writes with OpenCV's FileStorage.
const std::string kMetavisionCalibration = R"({
    "n_kept_views": 50,
    "image_size": [ 1280, 720 ],
    "pattern": { "n_rows": 6, "n_cols": 9, "square_height": 0.02, "square_width": 0.02 },
    "camera_matrix": {
        "type_id": "opencv-matrix",
        "rows": 3,
        "cols": 3,
        "dt": "d",
        "data": [ 1711.5, 0.0, 644.25, 0.0, 1710.5, 340.75, 0.0, 0.0, 1.0 ]
    },
    "distortion_coefficients": {
        "type_id": "opencv-matrix",
        "rows": 1,
        "cols": 5,
        "dt": "d",
        "data": [ -0.08, -0.0315, -0.00027, 0.0015, 0.25 ]
    },
    "overall_rms_reprojection_error": 0.73
})";

// Of the Event Camera Dataset.
const std::string kRpg = "199.092 198.828 132.192 110.712 -0.368 0.150 -0.0002 -0.0007 0.5\n";

PinholeCamera camera_of(const std::string& text, const CalibrationOptions& options = {}) {
  return opencv::load_calibration(write("camera.txt", text), options);
}

// fx, fy, cx, cy
void check_pinhole(const PinholeCamera& camera, SensorSize size, const std::vector<double>& expected) {
  CHECK(camera.sensor_size() == size);
  CHECK(std::vector{camera.fx(), camera.fy(), camera.cx(), camera.cy()} == expected);
}

// k1, k2, p1, p2, k3 of a radial-tangential lens, k1 to k4 of a fisheye lens
void check_lens(const PinholeCamera& camera, const std::vector<double>& expected) {
  std::vector<double> k;
  if (const auto* d = std::get_if<BrownConradyDistortion>(&camera.distortion()))
    k = {d->k1, d->k2, d->p1, d->p2, d->k3};
  if (const auto* d = std::get_if<EquidistantDistortion>(&camera.distortion())) k = {d->k1, d->k2, d->k3, d->k4};
  CHECK(k == expected);
}

// One line that names the file and all that must be in it.
void check_error(const std::string& text, const std::vector<std::string>& words,
                 const CalibrationOptions& options = {}) {
  const std::string path = write("refused.txt", text);
  std::string message = "nothing thrown";
  try {
    opencv::load_calibration(path, options);
  } catch (const std::runtime_error& error) {
    message = error.what();
  }
  CAPTURE(message);
  CHECK(message.starts_with("calibration " + path + ": "));
  CHECK(message.find('\n') == std::string::npos);
  for (const std::string& word : words) {
    CAPTURE(word);
    CHECK(message.find(word) != std::string::npos);
  }
}

}  // namespace

TEST_CASE("a message of ROS 2, the first of those that were printed") {
  const std::string other = replaced(kRos2Message, "533.5", "100.0");
  for (const std::string& text : {kRos2Message, kRos2Message + other, replaced(kRos2Message, "---\n", "")}) {
    const PinholeCamera camera = camera_of(text);
    check_pinhole(camera, {640, 480}, {533.5, 534.5, 319.25, 239.75});
    check_lens(camera, {-0.28, 0.07, 0.0015, -0.00025, 0.01});
  }
  const PinholeCamera plain =
      camera_of(replaced(kRos2Message, "d:\n- -0.28\n- 0.07\n- 0.0015\n- -0.00025\n- 0.01", "d: []"));
  CHECK(std::holds_alternative<NoDistortion>(plain.distortion()));
}

TEST_CASE("a message of ROS 1") {
  const PinholeCamera camera = camera_of(kRos1Message + kRos1Message);
  check_pinhole(camera, {346, 260}, {226.38, 226.15, 173.64, 133.73});
  check_lens(camera, {-0.048, 0.011, -0.055, 0.021});
}

TEST_CASE("messages that are no calibration name what is wrong") {
  check_error(replaced(kRos2Message, "- 533.5", "- 0.0"), {"k fx is 0, not positive"});
  check_error("height: 48\nwidth: 64\ndistortion_model: ''\nd: []\nk: [0.0, 0, 0, 0, 0, 0, 0, 0, 0]\n",
              {"k is all 0", "not calibrated"});
  check_error(replaced(kRos2Message, "- 533.5", "- .nan"), {"k[0]", "nan"});
  check_error(replaced(kRos2Message, "- 533.5\n", ""), {"k has 8 elements, not 3 x 3"});
  check_error(replaced(kRos2Message, "- 0.01\nk:", "- 0.01\n- 1\nk:"), {"d has 6 numbers"});
  check_error(replaced(kRos2Message, "- 0.01\nk:", "- 0.01\n- 1.5\n- 0\n- 0\nk:"), {"d[5] is 1.5", "5 coefficients"});
  check_error(replaced(kRos2Message, "width: 640", "wide: 640"), {"no field width"});
  check_error(replaced(kRos2Message, "d:\n", "e:\n"), {"no field d"});
  check_error(replaced(kRos2Message, "k:\n", "l:\n"), {"no field camera_matrix (OpenCV, ROS), K (ROS"});
  check_error(replaced(kRos1Message, ", 0.021]", "]"), {"D has 3 numbers", "4"});
  check_error(replaced(kRos1Message, "equidistant", "thin_prism"),
              {"distortion_model is \"thin_prism\"", "calibrate with"});
}

TEST_CASE("Kalibr's camchain: the camera that is named, or the only one") {
  const PinholeCamera left = camera_of(kKalibr, {.camera = "cam0"}), right = camera_of(kKalibr, {.camera = "cam1"});
  check_pinhole(left, {640, 480}, {533.5, 534.5, 319.25, 239.75});
  check_lens(left, {-0.28, 0.07, 0.0015, -0.00025, 0});
  check_pinhole(right, {346, 260}, {226.38, 226.15, 173.64, 133.73});
  check_lens(right, {-0.048, 0.011, -0.055, 0.021});

  const std::string one = kKalibr.substr(0, kKalibr.find("cam1:"));
  check_pinhole(camera_of(one), {640, 480}, {533.5, 534.5, 319.25, 239.75});
  const std::string none = replaced(replaced(one, "radtan", "none"), "[-0.28, 0.07, 0.0015, -0.00025]", "[]");
  CHECK(std::holds_alternative<NoDistortion>(camera_of(none).distortion()));
  check_error(replaced(one, "radtan", "none"), {"cam0 distortion_coeffs[0] is -0.28", "none"});

  check_error(kKalibr, {"several cameras, cam0, cam1", "--camera-name cam0"});
  check_error(kKalibr, {"no camera cam2, but cam0, cam1"}, {.camera = "cam2"});
  check_error(one, {"no camera cam1, but cam0"}, {.camera = "cam1"});
  check_pinhole(camera_of("cam0:\n  a: 1\n" + one, {.camera = "cam0"}), {640, 480}, {533.5, 534.5, 319.25, 239.75});
}

TEST_CASE("Kalibr's cameras that cannot be represented, or are wrong, are refused by field and value") {
  const std::string one = kKalibr.substr(0, kKalibr.find("cam1:"));
  const auto refused = [&](const std::string& from, const std::string& to, const std::vector<std::string>& words) {
    check_error(replaced(one, from, to), words);
  };
  for (const char* model : {"omni", "ds", "eucm"})
    refused("camera_model: pinhole", std::string("camera_model: ") + model,
            {"cam0 camera_model is \"" + std::string(model) + "\"", "calibrate with pinhole and radtan"});
  refused("radtan", "fov", {"cam0 distortion_model is \"fov\"", "calibrate with plumb_bob (radtan)"});
  refused("intrinsics: [533.5, ", "intrinsics: [", {"cam0 intrinsics has 3 numbers, not 4: fx fy cx cy"});
  refused("[533.5, ", "[1.2, 533.5, ", {"cam0 intrinsics has 5 numbers"});
  refused("[533.5, ", "[-533.5, ", {"cam0 intrinsics fx is -533.5, not positive"});
  refused("534.5", ".nan", {"cam0 intrinsics[1]", "nan"});
  refused("-0.28, ", "", {"cam0 distortion_coeffs has 3 numbers"});
  refused("[640, 480]", "[640]", {"cam0 resolution has 1 numbers, not 2: width and height"});
  refused("[640, 480]", "[640, -480]", {"cam0 resolution[1] is -480"});
  refused("[640, 480]", "640", {"cam0 resolution is not a list"});
  refused("resolution", "size", {"cam0 has no field resolution"});
  refused("distortion_coeffs", "coeffs", {"cam0 has no field distortion_coeffs"});
  refused("distortion_model", "model", {"cam0 has no field distortion_model"});
  refused("intrinsics", "extrinsics", {"is no calibration"});
}

TEST_CASE("DSEC's cam_to_cam.yaml") {
  const PinholeCamera camera = camera_of(kDsec, {.camera = "cam0"});
  check_pinhole(camera, {640, 480}, {553.4686, 553.3994, 346.6527, 216.5213});
  check_lens(camera, {-0.0935, 0.1945, 0.0001, 0.0019, 0});
  CHECK(camera_of(kDsec, {.camera = "cam1"}).sensor_size() == SensorSize{1440, 1080});
  check_error(kDsec, {"several cameras, cam0, cam1, camRect0"});
  check_error(kDsec, {"no camera cam3, but cam0"}, {.camera = "cam3"});
  check_error(kDsec, {"camRect0 has no field distortion_model"}, {.camera = "camRect0"});
  check_error("intrinsics:\n  cam0:\n    resolution: [640, 480]\n",
              {"intrinsics has no camera with a field camera_matrix"});
  check_error(replaced(kDsec, "- 553.4686", "- -1"), {"cam0 camera_matrix fx is -1"}, {.camera = "cam0"});
}

TEST_CASE("Metavision's camera geometry") {
  const PinholeCamera camera = camera_of(kMetavisionGeometry);
  check_pinhole(camera, {1280, 720}, {1711.5, 1710.5, 644.25, 340.75});
  check_lens(camera, {-0.08, -0.0315, -0.00027, 0.0015, 0.25});
  const std::string fisheye = replaced(replaced(kMetavisionGeometry, "pinhole", "fisheye"), ", 0.25]", "]");
  check_lens(camera_of(fisheye), {-0.08, -0.0315, -0.00027, 0.0015});
  check_error(replaced(kMetavisionGeometry, "pinhole", "ocam"), {"type is \"ocam\"", "calibrate with"});
  check_error(replaced(kMetavisionGeometry, "pinhole", "fisheye"), {"D has 5 numbers; a fisheye lens has 4"});
  check_error(replaced(kMetavisionGeometry, "\"K\": [1711.5, 0,", "\"K\": [1711.5, 2,"), {"K skew is 2"});
  check_error(replaced(kMetavisionGeometry, "\"width\": 1280,", ""), {"no field width"});
}

TEST_CASE("what Metavision's calibration writes") {
  const PinholeCamera camera = camera_of(kMetavisionCalibration);
  check_pinhole(camera, {1280, 720}, {1711.5, 1710.5, 644.25, 340.75});
  check_lens(camera, {-0.08, -0.0315, -0.00027, 0.0015, 0.25});
  const std::string fisheye =
      replaced(replaced(kMetavisionCalibration, "\"cols\": 5", "\"cols\": 4"), ", 0.25 ]", " ]");
  check_lens(camera_of(fisheye), {-0.08, -0.0315, -0.00027, 0.0015});
  check_error(replaced(kMetavisionCalibration, "[ 1280, 720 ]", "[ 1280 ]"), {"image_size has 1 numbers"});
  check_error(replaced(kMetavisionCalibration, "[ 1280, 720 ]", "[ 1280, 0 ]"), {"image_size[1] is 0"});
}

TEST_CASE("RPG's calib.txt, with the sensor's size beside it") {
  const CalibrationOptions davis240{.sensor_size = SensorSize{240, 180}};
  for (const std::string& text : {kRpg, kRpg.substr(0, kRpg.size() - 1), "\n" + replaced(kRpg, " 132", "\n132")}) {
    const PinholeCamera camera = camera_of(text, davis240);
    check_pinhole(camera, {240, 180}, {199.092, 198.828, 132.192, 110.712});
    check_lens(camera, {-0.368, 0.150, -0.0002, -0.0007, 0.5});
  }
  check_error(kRpg, {"states no sensor size", "--size 240,180"});
  check_error(replaced(kRpg, " 0.5", ""), {"numbers has 8 numbers, not 9: fx fy cx cy k1 k2 p1 p2 k3"}, davis240);
  check_error(replaced(kRpg, "198.828", "-198.828"), {"numbers fy is -198.828, not positive"}, davis240);
  check_error(replaced(kRpg, "198.828", "nan"), {"numbers[1] is \"nan\", not a number"}, davis240);
  check_error(replaced(kRpg, "198.828", "1e999"), {"numbers[1] is inf"}, davis240);
}

TEST_CASE("what is asked for must not contradict the file") {
  const CalibrationOptions same{.sensor_size = SensorSize{346, 260}}, other{.sensor_size = SensorSize{640, 480}};
  CHECK(camera_of(kRos1Message, same).sensor_size() == SensorSize{346, 260});
  check_error(kRos1Message, {"sensor of 346 x 260 px, not 640 x 480 px"}, other);
  check_error(kRos1Message, {"no camera of the name cam0"}, {.camera = "cam0"});
  const std::string without_size = replaced(replaced(kRos1Message, "height: 260\n", ""), "width: 346\n", "");
  CHECK(camera_of(without_size, same).sensor_size() == SensorSize{346, 260});
}
