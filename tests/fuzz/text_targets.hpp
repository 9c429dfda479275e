#pragma once
// Fuzzed: text recordings, pose files, and files of settings.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/io/event_reader.hpp"
#include "evmarker/io/pose_reader.hpp"
#include "evmarker/opencv/board.hpp"
#include "evmarker/opencv/calibration.hpp"
#include "evmarker/opencv/marker_lengths.hpp"
#include "evmarker/opencv/wireframe.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/target.hpp"

namespace evmarker::fuzz {

namespace detail {

inline std::string one_of(Random& random, const std::vector<std::string>& words) {
  return words[below(random, words.size())];
}

inline std::string make_number(Random& random) {
  static const std::vector<std::string> unusual{"0",
                                                "-1",
                                                "1e9",
                                                "1e-320",
                                                "1e999",
                                                "nan",
                                                "inf",
                                                "-inf",
                                                "0x10",
                                                "+1",
                                                "1.",
                                                ".5",
                                                "65535",
                                                "65536",
                                                "4294967296",
                                                "9223372036854775807",
                                                "-9223372036854775808",
                                                "99999999999999999999999",
                                                "0.0000001",
                                                "1_000",
                                                "1,5"};
  if (below(random, 3) == 0) return one_of(random, unusual);
  const std::string whole = std::to_string(below(random, std::size_t{1} << below(random, 40)));
  return below(random, 2) == 0 ? whole : whole + "." + std::to_string(below(random, 1000000));
}

inline std::string make_event_text(Random& random) {
  static const std::vector<std::string> words{"x",           "y",
                                              "p",           "t",
                                              "t_ns",        "time [ms]",
                                              "time_usec",   "polarity",
                                              ",",           " ",
                                              "\t",          ";",
                                              "\n",          "\r\n",
                                              "\"",          "True",
                                              "#",           "%geometry:64,48",
                                              "%geometry:",  "\xEF\xBB\xBF",
                                              "x,y,p,t\n",   "-",
                                              "timestamp",   "False",
                                              "1,2,1,100\n", "0.000100 1 2 1\n",
                                              "% ",          std::string("\0", 1)};
  return below(random, 2) == 0 ? one_of(random, words) : make_number(random);
}

inline std::string make_pose_text(Random& random) {
  static const std::vector<std::string> words{"t_us",
                                              "marker_id",
                                              "tx",
                                              "qx,qy,qz,qw",
                                              "state",
                                              "matched",
                                              "loss_reason",
                                              "tracking",
                                              "lost",
                                              "hidden",
                                              ",",
                                              " ",
                                              "\n",
                                              "#",
                                              "0.100000 0 0 1 0 0 0 1\n",
                                              "5,0,0,0,1,0,0,0,1\n",
                                              "t_us,marker_id,tx,ty,tz,qx,qy,qz,qw\n",
                                              "\r\n",
                                              "\xEF\xBB\xBF"};
  return below(random, 2) == 0 ? one_of(random, words) : make_number(random);
}

inline std::string make_settings_text(Random& random) {
  static const std::vector<std::string> words{"%YAML:1.0\n",
                                              "---\n",
                                              "image_width: ",
                                              "image_height: ",
                                              "camera_matrix: ",
                                              "distortion_coefficients: ",
                                              "!!opencv-matrix",
                                              "rows: ",
                                              "cols: ",
                                              "dt: d\n",
                                              "data: [",
                                              "]",
                                              "{",
                                              "}",
                                              "[",
                                              ":",
                                              "\n",
                                              "\n   ",
                                              "-",
                                              " - ",
                                              ", ",
                                              "fisheye: 1\n",
                                              "distortion_model: plumb_bob\n",
                                              "cam0:\n  ",
                                              "camera_model: pinhole\n",
                                              "intrinsics: ",
                                              "distortion_coeffs: ",
                                              "resolution: ",
                                              "k: ",
                                              "D: ",
                                              "width: ",
                                              "image_size: ",
                                              "type: ",
                                              "board: ",
                                              "markers:\n",
                                              "id: ",
                                              "length: ",
                                              "rotation: ",
                                              "translation: ",
                                              "target_type: aprilgrid\n",
                                              "tagCols: ",
                                              "tagSize: ",
                                              "tagSpacing: ",
                                              "squaresX: ",
                                              "markersX: ",
                                              "markers_y: ",
                                              "markerLength: ",
                                              "ids: ",
                                              "dictionary: ",
                                              "border: 2\n",
                                              "tag_bundles: ",
                                              "layout: ",
                                              "qw: ",
                                              "frame_at_center: true\n",
                                              "wireframe: ",
                                              "vertices: ",
                                              "edges: ",
                                              "from: ",
                                              "to: ",
                                              "dark_side: ",
                                              "face_normal: ",
                                              "start: ",
                                              "\"",
                                              "'",
                                              "#",
                                              "<",
                                              "</",
                                              ">",
                                              "<?xml version=\"1.0\"?>\n<opencv_storage>\n",
                                              "</opencv_storage>",
                                              ".Nan",
                                              "-.Inf",
                                              "!!binary |",
                                              "&a ",
                                              "*a",
                                              "\t",
                                              "? ",
                                              "|\n"};
  return below(random, 3) != 0 ? one_of(random, words) : make_number(random);
}

inline std::vector<std::string> event_text_seeds() {
  const std::string rows = "10,20,1,1000\n11,20,0,1040\n12,21,1,1100\n13,21,1,1170\n";
  return {"%geometry:64,48\n" + rows,
          "x,y,p,t\n" + rows,
          ",x,y,polarity,time_usec\n0,10,20,1,1000\n1,11,20,0,1040\n",
          "0.001000 10 20 1\n0.001040 11 20 0\n0.001100 12 21 1\n0.001170 13 21 1\n",
          "\"t_ns\";\"x\";\"y\";\"p\"\n1000000;10;20;True\n1040000;11;20;False\n",
          "# x y p t\n1.0e+01 2.0e+01 1.0e+00 1.000e+03\n1.1e+01 2.0e+01 0.0e+00 1.040e+03\n",
          "time [ms],x,y,p\r\n1.000,10,20,1\r\n1.040,11,20,-1\r\n",
          "\xEF\xBB\xBFt,x,y,p\n1000,10,20,1\n1040,11,20,0"};
}

inline std::vector<std::string> pose_text_seeds() {
  return {"# t tx ty tz qx qy qz qw\n0.000000 0 0 0.5 0 0 0 1\n0.010000 0.01 0 0.5 0 0 0.1 0.995\n",
          "t_us,marker_id,tx,ty,tz,qx,qy,qz,qw,state,matched\n0,3,0,0,0.5,0,0,0,1,tracking,10\n10,3,0,0,0.5,0,0,0,1,"
          "lost,2\n",
          "t_us,marker_id,tx,ty,tz,qx,qy,qz,qw,state,matched,residual_px,backtrack_px,backtrack_rad,health,loss_reason"
          "\n0,3,0,0,0.5,1,0,0,0,converging,10,0.5,nan,nan,0.9,none\n"};
}

inline std::vector<std::string> settings_seeds() {
  return {
      "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   "
      "dt: d\n   data: [ 60., 0., 31.5, 0., 60., 23.5, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   "
      "rows: 1\n   cols: 5\n   dt: d\n   data: [ 0.1, 0., 0., 0., 0. ]\n",
      "image_width: 64\nimage_height: 48\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [60, 0, 31.5, 0, 60, 23.5, "
      "0, 0, 1]\ndistortion_model: equidistant\ndistortion_coefficients:\n  rows: 1\n  cols: 4\n  data: [0.1, 0, "
      "0, 0]\n",
      "{\"image_width\": 64, \"image_height\": 48, \"fisheye\": true}\n",
      "board: 7\nmarkers:\n  - { id: 0, length: 0.1, rotation: [0, 0, 0], translation: [0, 0, 0] }\n  - { id: 1, "
      "length: 0.1, rotation: [0, 0, 1.5], translation: [0.2, 0, 0] }\n",
      "wireframe: 3\nvertices:\n  - [0, 0, 0]\n  - [0.1, 0, 0]\n  - [0, 0.1, 0]\nedges:\n  - { from: 0, to: 1, "
      "dark_side: [0, 1, 0] }\n  - { from: 1, to: 2, face_normal: [0, 0, 1] }\nstart:\n  rotation: [3, 0, 0]\n  "
      "translation: [0, 0, 0.5]\n",
      "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>64</image_width>\n<image_height>48</image_height>\n"
      "</opencv_storage>\n",
      "target_type: 'aprilgrid' # a\ntagCols: 3\ntagRows: 2\ntagSize: 0.088\ntagSpacing: 0.3\n",
      "markersX: 2\nmarkersY: 2\nmarkerLength: 0.04\nmarkerSeparation: 0.01\nfirstMarker: 3\ndictionary: 0\n",
      "squares_x: 3\nsquares_y: 4\nsquare_length: 0.04\nmarker_length: 0.03\nlegacy_pattern: true\ndictionary: "
      "4X4_50\n",
      "tag_bundles:\n  [\n    {\n      name: 'a',\n      layout:\n        [\n          {id: 0, size: 0.05, x: 0.1, y: "
      "0, "
      "z: 0, qw: 1, qx: 0, qy: 0, qz: 0},\n        ]\n    },\n  ]\n",
      "- name: '1'\n  first_id: 0\n  markers_x: 2\n  markers_y: 1\n  marker_size: 0.07\n  separation: 0.02\n  "
      "frame_at_center: true\n- name: b\n  first_id: 2\n  markers_x: 1\n  markers_y: 1\n  marker_size: 0.07\n  "
      "separation: 0.02\n  frame_at_center: false\n",
      "header:\n  stamp:\n    sec: 1\n  frame_id: a\nheight: 48\nwidth: 64\ndistortion_model: plumb_bob\nd:\n- 0.1\n- "
      "0.0\n"
      "- 0.0\n- 0.0\n- 0.0\nk:\n- 60.0\n- 0.0\n- 31.5\n- 0.0\n- 60.0\n- 23.5\n- 0.0\n- 0.0\n- 1.0\nbinning_x: 0\n---\n",
      "height: 48\nwidth: 64\ndistortion_model: \"equidistant\"\nD: [0.1, 0.0, 0.0, 0.0]\nK: [60.0, 0.0, 31.5, 0.0, "
      "60.0, "
      "23.5, 0.0, 0.0, 1.0]\nroi: \n  do_rectify: False\n---\n",
      "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.1, 0, 0, 0]\n  distortion_model: radtan\n  intrinsics: "
      "[60, 60, 31.5, 23.5]\n  resolution: [64, 48]\ncam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, 0.1]\n  camera_model: "
      "omni\n  intrinsics: [1.1, 60, 60, 31.5, 23.5]\n",
      "extrinsics:\n  R_rect0:\n  - - 1.0\n    - 0.0\nintrinsics:\n  cam0:\n    camera_matrix:\n    - 60.0\n    - "
      "60.0\n    "
      "- 31.5\n    - 23.5\n    distortion_coeffs:\n    - 0.1\n    - 0.0\n    - 0.0\n    - 0.0\n    distortion_model: "
      "radtan\n    resolution:\n    - 64\n    - 48\n",
      "{\"type\": \"pinhole\", \"width\": 64, \"height\": 48, \"K\": [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1], \"D\": [0.1, "
      "0, "
      "0, 0, 0]}\n",
      "{\"n_kept_views\": 9, \"image_size\": [64, 48], \"camera_matrix\": {\"type_id\": \"opencv-matrix\", \"rows\": "
      "3, "
      "\"cols\": 3, \"dt\": \"d\", \"data\": [60, 0, 31.5, 0, 60, 23.5, 0, 0, 1]}, \"distortion_coefficients\": "
      "{\"rows\": "
      "1, \"cols\": 4, \"data\": [0.1, 0, 0, 0]}}\n",
      "60 60 31.5 23.5 0.1 0 0 0 0\n"};
}

struct ReadText {
  std::vector<Event> events;
  io::RecordingStatistics statistics;
  std::string error;
  bool operator==(const ReadText&) const = default;
};

inline ReadText read_text(const MemoryFile& file, std::size_t block_bytes, const io::CsvReaderOptions& options) {
  ReadText result;
  io::CsvReader reader(io::BlockReader(file.path(), block_bytes), options);
  try {
    for (auto batch = reader.next_batch(); !batch.empty(); batch = reader.next_batch())
      result.events.insert(result.events.end(), batch.begin(), batch.end());
  } catch (const io::RecordingError& error) {
    result.error = error.what();
  }
  result.statistics = reader.statistics();
  arrived += result.events.size();
  require_that(result.statistics.events == result.events.size(), "every event is counted");
  for (const Event& event : result.events)
    require_that(reader.sensor_size().contains(event.x, event.y) && (event.p == 0 || event.p == 1),
                 "every event is one on the sensor");
  return result;
}

inline void check_one_line(const std::exception& error) {
  require_that(std::string_view(error.what()).find('\n') == std::string_view::npos, "errors are one line");
}

inline void require_rigid(const Eigen::Isometry3d& T) {
  ++arrived;
  require_that(
      T.matrix().allFinite() && (T.linear() * T.linear().transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-9,
      "poses are rigid motions");
}

}  // namespace detail

inline void fuzz_event_text(std::string_view input) {
  const MemoryFile file(input);
  // The layout is fixed, so that what is recognised does not depend on how much of the file is seen.
  const io::CsvReaderOptions fixed{SensorSize{64, 48}, false, {',', "t,x,y,p", io::TimeUnit::microseconds}};
  try {
    io::EventReader reader(file.path(), {SensorSize{64, 48}, input.size() % 2 == 1});
    while (!reader.next_batch().empty())
      ;
  } catch (const io::RecordingError&) {
  } catch (const std::invalid_argument&) {  // a size in the file that no sensor has
  }
  try {
    const auto whole = detail::read_text(file, io::BlockReader::kBlockBytes, fixed);
    if (input.size() < 200) return;  // the head must be in the first block
    require_that(detail::read_text(file, 150 + input.size() % 50, fixed) == whole,
                 "blocks of any length give the same events");
  } catch (const io::RecordingError&) {
  } catch (const std::invalid_argument&) {
  }
}

inline void fuzz_pose_text(std::string_view input) {
  const MemoryFile file(input);
  try {
    for (const auto& pose : io::read_tum(file.path())) detail::require_rigid(pose.T_camera_marker);
  } catch (const io::RecordingError&) {
  }
  try {
    for (const auto& pose : io::read_pose_csv(file.path())) detail::require_rigid(pose.T_camera_marker);
  } catch (const io::RecordingError&) {
  }
  try {
    const auto truth = io::GroundTruth::read(file.path());
    for (const Timestamp t : {Timestamp{0}, Timestamp{5}, Timestamp{10000}})
      if (const auto T = truth.at(3, t)) detail::require_rigid(*T);
  } catch (const io::RecordingError&) {
  }
}

inline void fuzz_settings(std::string_view input) {
  const MemoryFile file(input);
  for (const auto& options : {opencv::CalibrationOptions{}, {.camera = "cam0"}, {.sensor_size = SensorSize{64, 48}}})
    try {
      const PinholeCamera camera = opencv::load_calibration(file.path().string(), options);
      ++arrived;
      require_that(std::isfinite(camera.fx()) && camera.fx() > 0, "a camera that is loaded has a focal length");
    } catch (const std::runtime_error& error) {
      detail::check_one_line(error);
    }
  try {
    const opencv::BoardFile boards = opencv::load_boards(file.path().string());
    require_that(!boards.boards.empty(), "a file of boards has one");
    for (const Board& board : boards.boards) validate(board);
    ++arrived;
  } catch (const std::runtime_error& error) {
    detail::check_one_line(error);
  }
  try {
    for (const auto& [id, length] : opencv::load_marker_lengths(file.path().string()))
      require_that(id >= 0 && length > 0 && std::isfinite(length), "lengths that are loaded are those of markers");
    ++arrived;
  } catch (const std::runtime_error& error) {
    detail::check_one_line(error);
  }
  try {
    validate(opencv::load_wireframe(file.path().string()).model);
    ++arrived;
  } catch (const std::runtime_error& error) {
    detail::check_one_line(error);
  }
}

inline std::vector<Target> text_targets() {
  using namespace detail;
  return {
      {"event_text", fuzz_event_text, event_text_seeds, {0, 1, make_event_text}, 512, 50'000, 0.1},
      {"pose_text", fuzz_pose_text, pose_text_seeds, {0, 1, make_pose_text}, 512, 50'000, 0.4},
      {"settings", fuzz_settings, settings_seeds, {0, 1, make_settings_text}, 768, 20'000, 0.03},
  };
}

}  // namespace evmarker::fuzz
