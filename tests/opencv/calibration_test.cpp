#include "evmarker/opencv/calibration.hpp"

#include <doctest/doctest.h>

#include <cstdio>
#include <filesystem>
#include <string>

#include "settings_text.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;

namespace {

const std::string kOpenCv = R"(%YAML:1.0
---
calibration_time: "Mon 01 Jan 2024"
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 533.5, 0., 319.25, 0., 534.5, 239.75, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28, 0.07, 1.5e-3, -2.5e-4, 0.01 ]
avg_reprojection_error: 0.2
)";

const std::string kRos = R"(image_width: 346
image_height: 260
camera_name: davis
camera_matrix:
  rows: 3
  cols: 3
  data: [226.38, 0, 173.64, 0, 226.15, 133.73, 0, 0, 1]
distortion_model: equidistant
distortion_coefficients:
  rows: 1
  cols: 4
  data: [-0.048, 0.011, -0.055, 0.021]
)";

// The one line of the error; it names the file.
std::string error_of(const std::string& path) {
  try {
    opencv::load_calibration(path);
  } catch (const std::runtime_error& error) {
    const std::string message = error.what();
    CHECK(message.find(path) != std::string::npos);
    CHECK(message.find('\n') == std::string::npos);
    return message;
  }
  FAIL("no error from " << path);
  return {};
}

void check_refused(const std::string& from, const std::string& to, const std::string& field, const std::string& value) {
  CAPTURE(to);
  const std::string message = error_of(write("bad.yml", replaced(kOpenCv, from, to)));
  CAPTURE(message);
  CHECK(message.find(field) != std::string::npos);
  CHECK(message.find(value) != std::string::npos);
}

}  // namespace

TEST_CASE("a calibration as OpenCV's own program writes it") {
  const PinholeCamera camera = opencv::load_calibration(write("opencv.yml", kOpenCv));
  CHECK(camera.sensor_size() == SensorSize{640, 480});
  CHECK(camera.fx() == 533.5);
  CHECK(camera.fy() == 534.5);
  CHECK(camera.cx() == 319.25);
  CHECK(camera.cy() == 239.75);
  const auto* lens = std::get_if<BrownConradyDistortion>(&camera.distortion());
  REQUIRE(lens != nullptr);
  CHECK(lens->k1 == -0.28);
  CHECK(lens->k2 == 0.07);
  CHECK(lens->p1 == 1.5e-3);
  CHECK(lens->p2 == -2.5e-4);
  CHECK(lens->k3 == 0.01);
}

TEST_CASE("ROS's camera_info: plain YAML, no tags, fisheye by its model") {
  for (const std::string& text : {kRos, "---\n" + kRos, "\n" + kRos}) {
    const PinholeCamera camera = opencv::load_calibration(write("ros.yaml", text));
    CHECK(camera.sensor_size() == SensorSize{346, 260});
    const auto* lens = std::get_if<EquidistantDistortion>(&camera.distortion());
    REQUIRE(lens != nullptr);
    CHECK(lens->k1 == -0.048);
    CHECK(lens->k4 == 0.021);
  }
}

TEST_CASE("which lens model is meant") {
  const auto load = [](const std::string& coefficients, const std::string& more) {
    const std::string text = replaced(replaced(kOpenCv, "[ -0.28, 0.07, 1.5e-3, -2.5e-4, 0.01 ]", coefficients),
                                      "rows: 5", "rows: " + std::to_string(std::ranges::count(coefficients, ',') + 1));
    return opencv::load_calibration(write("lens.yml", text + more)).distortion();
  };
  CHECK(std::holds_alternative<BrownConradyDistortion>(load("[ .1, .2, .3, .4 ]", "")));
  CHECK(std::holds_alternative<EquidistantDistortion>(load("[ .1, .2, .3, .4 ]", "fisheye: 1\n")));
  CHECK(std::holds_alternative<BrownConradyDistortion>(load("[ .1, .2, .3, .4 ]", "fisheye: 0\n")));
  CHECK(std::holds_alternative<EquidistantDistortion>(load("[ .1, .2, .3, .4 ]", "camera_model: fisheye\n")));
  CHECK(
      std::holds_alternative<BrownConradyDistortion>(load("[ .1, .2, .3, .4, .5 ]", "distortion_model: plumb_bob\n")));
  CHECK(std::holds_alternative<BrownConradyDistortion>(load("[ .1, 0, 0, 0, 0, 0, 0, 0 ]", "")));
  CHECK(std::holds_alternative<NoDistortion>(load("[ 0, 0., 0, 0, 0 ]", "")));
  CHECK_THROWS_AS(load("[ .1, .2, .3, .4, .5 ]", "fisheye: 1\n"), std::runtime_error);
  CHECK_THROWS_AS(load("[ .1, .2, .3 ]", ""), std::runtime_error);
}

TEST_CASE("what is saved is loaded again, digit for digit") {
  const double third = 1.0 / 3;
  for (const Distortion& lens :
       {Distortion(NoDistortion{}), Distortion(BrownConradyDistortion{-third, 0.1, 1e-7, 2e-3, third}),
        Distortion(EquidistantDistortion{third, -0.01, 0.002, 1e-9})})
    for (const char* ending : {"yml", "yaml", "xml", "json"}) {
      CAPTURE(ending);
      const PinholeCamera camera({1280, 720}, 1000 * third, 900 * third, 639.5 + third, 359.5 - third, lens);
      const std::string path = temporary(std::string("saved.") + ending);
      opencv::save_calibration(path, camera);
      const PinholeCamera loaded = opencv::load_calibration(path);
      CHECK(loaded.sensor_size() == camera.sensor_size());
      CHECK(loaded.fx() == camera.fx());
      CHECK(loaded.fy() == camera.fy());
      CHECK(loaded.cx() == camera.cx());
      CHECK(loaded.cy() == camera.cy());
      CHECK(loaded.distortion().index() == lens.index());
      for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1), Eigen::Vector3d(-0.5, 0.4, 1)})
        CHECK(loaded.project(point) == camera.project(point));
      std::remove(path.c_str());
    }
  CHECK_THROWS_AS(opencv::save_calibration(temporary("no/such/folder.yml"), PinholeCamera({4, 3}, 1, 1, 1, 1)),
                  std::runtime_error);
}

TEST_CASE("OpenCV reads what is saved") {
  const std::string path = temporary("for_opencv.yml");
  opencv::save_calibration(path,
                           PinholeCamera({640, 480}, 533, 534, 319.5, 239.5, BrownConradyDistortion{1, 2, 3, 4, 5}));
  cv::FileStorage storage(path, cv::FileStorage::READ);
  cv::Mat matrix, coefficients;
  storage["camera_matrix"] >> matrix;
  storage["distortion_coefficients"] >> coefficients;
  REQUIRE(matrix.size() == cv::Size(3, 3));
  CHECK(matrix.at<double>(0, 0) == 533);
  CHECK(matrix.at<double>(1, 2) == 239.5);
  REQUIRE(coefficients.total() == 5);
  CHECK(coefficients.at<double>(4) == 5);
}

TEST_CASE("each field that is missing is named") {
  for (const std::string field : {"image_width", "image_height", "camera_matrix", "distortion_coefficients"})
    check_refused(field + ":", "other_" + field + ":", "no field " + field, "");
}

TEST_CASE("each value that makes no sense is named with its field") {
  check_refused("image_width: 640", "image_width: 0", "image_width", "0");
  check_refused("image_width: 640", "image_width: -640", "image_width", "-640");
  check_refused("image_width: 640", "image_width: 640.5", "image_width", "640.5");
  check_refused("image_width: 640", "image_width: wide", "image_width", "wide");
  check_refused("image_height: 480", "image_height: [ 480 ]", "image_height", "not a number");
  check_refused("533.5", ".Nan", "camera_matrix[0]", "nan");
  check_refused("534.5", ".Inf", "camera_matrix[4]", "inf");
  check_refused("533.5", "-533.5", "fx", "-533.5");
  check_refused("534.5", "0.", "fy", "0");
  check_refused("319.25", ".Nan", "camera_matrix[2]", "nan");
  check_refused("533.5, 0.", "533.5, 0.7", "skew", "0.7");
  check_refused("0., 0., 1. ]", "0., 0., 2. ]", "camera_matrix", "2");
  check_refused("0., 0., 1. ]", "0., 0. ]", "camera_matrix", "8 elements");
  check_refused("533.5", "abc", "camera_matrix[0]", "abc");
  check_refused("-0.28", ".Nan", "distortion_coefficients[0]", "nan");
  check_refused("-0.28", "-.Inf", "distortion_coefficients[0]", "-inf");
  check_refused(
      "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 533.5, 0., 319.25, 0., 534.5, 239.75, 0., 0., 1. "
      "]",
      "17", "camera_matrix", "not a matrix");
  check_refused("rows: 5", "rows: 6", "distortion_coefficients", "6 x 1");
  check_refused("avg_reprojection_error: 0.2", "distortion_model: cubic", "distortion_model", "cubic");
  check_refused("avg_reprojection_error: 0.2", "distortion_model: 3", "distortion_model", "not a text");
  check_refused("rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.28, 0.07, 1.5e-3, -2.5e-4, 0.01 ]",
                "rows: 8\n   cols: 1\n   dt: d\n   data: [ -0.28, 0.07, 1.5e-3, -2.5e-4, 0.01, 0.125, 0., 0. ]",
                "distortion_coefficients[5]", "0.125");
}

TEST_CASE("a file that is nested deeper than settings are is refused before OpenCV's parsers overflow the stack") {
  const auto many = [](const std::string& part) {
    std::string text;
    for (int i = 0; i < 300000; ++i) text += part;
    return text;
  };
  for (const std::string& text :
       {"a: " + many("[") + many("]"), "a: " + many("{ a: ") + "1" + many("}"), "a:\n  " + many("- ") + "1",
        many("a: ") + "1", "{\"a\":" + many("[") + many("]") + "}", "{\"a\":" + many("{\"a\":") + "1" + many("}") + "}",
        "<?xml version=\"1.0\"?>\n<opencv_storage>" + many("<a>") + many("</a>") + "</opencv_storage>"})
    CHECK(error_of(write("deep.yml", text)).find("nested more than 1000 levels deep") != std::string::npos);

  // Long is not deep.
  const std::string markers = many("{ id: 1, place: [1, 2] }, "), elements = many("<_><id>1</id><b>2</b></_>\n");
  CHECK(error_of(write("long.yml", "markers: [" + markers + "1]\n")).find("no field") != std::string::npos);
  CHECK(error_of(write("long.xml", "<?xml version=\"1.0\"?>\n<opencv_storage><a>" + elements + "</a></opencv_storage>"))
            .find("no field") != std::string::npos);
}

TEST_CASE("what OpenCV's parsers hang or crash on is refused before, or by name") {
  const auto message = [](const std::string& name, const std::string& text) { return error_of(write(name, text)); };
  for (const char* binary : {"- a: 1\n-!!binary | { id: 1 }\n", "{\"a\": \"$base64$AAAA\"}",
                             "<?xml version=\"1.0\"?>\n<opencv_storage><a type_id=\"binary\">AA</a></opencv_storage>"})
    CHECK(message("binary.yml", binary).find("has binary data") != std::string::npos);
  for (const char* cut : {"<?xml version=", "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>64</"})
    CHECK(message("cut.xml", cut).find("is cut off") != std::string::npos);
  CHECK(message("zero.xml", std::string("<?xml version=") + '\0' + "?></opencv_storage>").find("byte 0") !=
        std::string::npos);
  for (const char* roots : {"[0, 0, 0] }\na: 1\n", "%YAML:1.0\n---\n{ a: 1 } b: 2\n", "%YAML:1.0\n---\n   a: 1\nb: 2\n",
                            "%YAML:1.0\n---a: 1\nb: 2\n"})
    CHECK(message("roots.yml", roots).find("with named fields") != std::string::npos);
  CHECK(message("empty_name.yml", "image_width: 64\ncamera_matrix:\n   : d\n").find("neither YAML") !=
        std::string::npos);
}

TEST_CASE("a file that is no calibration is named") {
  CHECK(error_of(temporary("does_not_exist.yml")).find("cannot be read") != std::string::npos);
  error_of(std::filesystem::temp_directory_path().string());
  error_of(write("empty.yml", ""));
  error_of(write("blank.yml", " \n\n"));
  error_of(write("prose.yml", "Dear reader,\nthis is not a calibration.\n"));
  error_of(write("binary.yml", std::string("\x00\xff\x13\x37garbage\x01", 12)));
  error_of(write("list.yml", "%YAML:1.0\n---\n- 1\n- 2\n"));
  error_of(write("cut.yml", kOpenCv.substr(0, 200)));
  error_of(write("cut.json", R"({"image_width": 640, "image_height": )"));
  error_of(write("cut.xml", "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>640</image_w"));
}
