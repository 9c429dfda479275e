// Boards in the forms of other programs, against numbers worked out by hand, OpenCV's own boards and AprilTag's codes.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/detection/board_detector.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/opencv/board.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "opencv/pose_distance.hpp"
#include "settings_text.hpp"

#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
#include <opencv2/aruco/charuco.hpp>
#endif

using namespace evmarker;
using namespace evmarker::opencv::test;
using Eigen::Vector3d;

namespace {

// As in Kalibr's wiki.
const std::string kAprilgrid = R"(target_type: 'aprilgrid' #gridtype
tagCols: 6               #number of apriltags
tagRows: 4               #number of apriltags
tagSize: 0.088           #size of apriltag, edge to edge [m]
tagSpacing: 0.25         #ratio of space between tags to tagSize
                         #example: tagSize=2m, spacing=0.5m --> tagSpacing=0.25[-]
)";

// As in the file that comes with apriltag_ros, and as its calibration of bundles prints it.
const std::string kBundles = R"(standalone_tags:
  [
    {id: 10, size: 0.05},
  ]
tag_bundles:
  [
    {
      name: 'my_bundle',
      layout:
        [
          {id: 0, size: 0.05, x: 0.0000, y: 0.0000, z: 0.0000, qw: 1.0000, qx: 0.0000, qy: 0.0000, qz: 0.0000},
          {id: 4, size: 0.08, x: 0.1, y: -0.2, z: 0.3, qw: 0.7071, qx: 0.0000, qy: 0.7071, qz: 0.0000},
        ]
    },
    {
      layout:
        [
          {id: 7, size: 0.02}
        ]
    }
  ]
)";

// As the file that comes with aruco_opencv.
const std::string kArucoOpencv = R"(- name: '1'
  first_id: 0
  markers_x: 2
  markers_y: 3
  marker_size: 0.0742
  separation: 0.0248
  frame_at_center: true
- name: '2'
  first_id: 6
  markers_x: 2
  markers_y: 1
  marker_size: 0.05
  separation: 0.01
  frame_at_center: false
)";

const std::string kGrid =
    "markersX: 3\nmarkersY: 2\nmarkerLength: 0.04\nmarkerSeparation: 0.01\ndictionary: DICT_5X5_100\n";
const std::string kCharuco = "squaresX: 4\nsquaresY: 3\nsquareLength: 0.04\nmarkerLength: 0.03\ndictionary: 6X6_250\n";

opencv::BoardFile load(const std::string& content, const std::string& dictionary = "") {
  return opencv::load_boards(write("form.yml", content), dictionary);
}

std::string refusal(const std::string& content, const std::string& dictionary = "") {
  std::string message = "accepted";
  try {
    load(content, dictionary);
  } catch (const std::runtime_error& error) {
    message = error.what();
  }
  const std::string path = temporary("form.yml");
  if (const auto at = message.find(path); at != std::string::npos) message.replace(at, path.size(), "FILE");
  return message;
}

// The marker's top left, top right, bottom right and bottom left corners in the board's frame.
std::array<Vector3d, 4> corners_of(const BoardMarker& marker) {
  const double h = marker.length / 2;
  const Eigen::Isometry3d& T = marker.T_board_marker;
  return {T * Vector3d(-h, h, 0), T * Vector3d(h, h, 0), T * Vector3d(h, -h, 0), T * Vector3d(-h, -h, 0)};
}

// The 6 x 6 cells in the middle of a marker as somebody reads them who sees it with `right` and `down` in the board's
// frame.
std::uint64_t code_seen(const BoardMarker& marker, const Vector3d& right, const Vector3d& down) {
  std::uint64_t code = 0;
  const auto rows = static_cast<double>(marker.bits.rows());
  const double cell = marker.length / (rows + 2), middle = 0.5 * (rows - 1);
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column < 6; ++column) {
      const Vector3d place = marker.T_board_marker.translation() + cell * ((column - 2.5) * right + (row - 2.5) * down);
      const Vector3d at = marker.T_board_marker.inverse() * place / cell;
      CHECK(std::abs(at.z()) < 1e-9);
      const int bit =
          marker.bits(static_cast<int>(std::lround(middle - at.y())), static_cast<int>(std::lround(at.x() + middle)));
      code = code << 1 | static_cast<std::uint64_t>(bit);
    }
  return code;
}

// OpenCV's corners of its boards' markers.
std::vector<std::vector<cv::Point3f>> opencv_grid(int columns, int rows, float length, float separation) {
  const auto dictionary = opencv::make_dictionary("DICT_4X4_50");
#if CV_VERSION_MAJOR > 4 || CV_VERSION_MINOR >= 7
  return cv::aruco::GridBoard({columns, rows}, length, separation, dictionary).getObjPoints();
#else
  return cv::aruco::GridBoard::create(columns, rows, length, separation, cv::makePtr<cv::aruco::Dictionary>(dictionary))
      ->objPoints;
#endif
}

std::vector<std::vector<cv::Point3f>> opencv_charuco(int columns, int rows, float square, float length) {
  const auto dictionary = opencv::make_dictionary("DICT_6X6_250");
#if CV_VERSION_MAJOR > 4 || CV_VERSION_MINOR >= 7
  return cv::aruco::CharucoBoard({columns, rows}, square, length, dictionary).getObjPoints();
#else
  return cv::aruco::CharucoBoard::create(columns, rows, square, length, cv::makePtr<cv::aruco::Dictionary>(dictionary))
      ->objPoints;
#endif
}

// OpenCV up to 4.5 had y up and the legacy pattern; the frame that we read is that of later versions.
constexpr bool kSameFrame = CV_VERSION_MAJOR > 4 || CV_VERSION_MINOR >= 6;

void check_corners(const Board& board, const std::vector<std::vector<cv::Point3f>>& expected,
                   const Vector3d& origin = Vector3d::Zero()) {
  if (!kSameFrame) return;
  REQUIRE(board.markers.size() == expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i)
    for (std::size_t k = 0; k < 4; ++k) {
      const cv::Point3f p = expected[i][k];
      CHECK((corners_of(board.markers[i])[k] + origin - Vector3d(p.x, p.y, p.z)).norm() < 1e-7);
    }
}

}  // namespace

TEST_CASE("an aprilgrid of Kalibr's is read: from the bottom left tag on, upright as AprilTag prints it") {
  const opencv::BoardFile file = load(kAprilgrid);
  CHECK(file.dictionary == "DICT_APRILTAG_36h11");
  REQUIRE(file.boards.size() == 1);
  const Board& board = file.boards[0];
  CHECK(board.id == 600);  // the dictionary has the ids 0 to 586
  REQUIRE(board.markers.size() == 24);
  for (std::size_t i = 0; i < 24; ++i) {
    const BoardMarker& tag = board.markers[i];
    CHECK(tag.id == static_cast<int>(i));
    CHECK(tag.length == 0.088);
    // Kalibr: the corners of column c and row r lie at c * (1 + spacing) * size and one size more.
    const double x = static_cast<double>(i % 6) * 0.11, y = static_cast<double>(i / 6) * 0.11;
    CHECK((tag.T_board_marker.translation() - Vector3d(x + 0.044, y + 0.044, 0)).norm() < 1e-12);
    CHECK((tag.T_board_marker.linear() * Vector3d::UnitZ() - Vector3d::UnitZ()).norm() < 1e-12);
  }
  // The first codes of tag36h11, in AprilTag's and in Kalibr's source.
  const std::uint64_t codes[] = {0xd5d628584, 0xd97f18b49, 0xdd280910e};
  for (std::size_t i = 0; i < 3; ++i)
    CHECK(code_seen(board.markers[i], Vector3d::UnitX(), -Vector3d::UnitY()) == codes[i]);
  CHECK(opencv::load_board(write("form.yml", "board: 7\n" + kAprilgrid), "DICT_APRILTAG_36h11").id == 7);

  CHECK(load(kAprilgrid + "tag_family: tag25h9\n").dictionary == "DICT_APRILTAG_25h9");

  // Kalibr prints a border of two cells, other programs one.
  CHECK(file.border_cells == 2);
  CHECK(board.markers[0].bits.rows() == 8);
  CHECK(board.markers[0].bits.row(0).isZero());
  const opencv::BoardFile usual = load(kAprilgrid + "border: 1\n");
  CHECK(usual.border_cells == 1);
  REQUIRE(usual.boards[0].markers[0].bits.rows() == 6);
  CHECK(code_seen(usual.boards[0].markers[0], Vector3d::UnitX(), -Vector3d::UnitY()) == codes[0]);
  CHECK(board.markers[0].bits.block(1, 1, 6, 6) == usual.boards[0].markers[0].bits);
}

TEST_CASE("a real aprilgrid, measured by its events, has its tags where Kalibr's form says") {
  const std::string measured = std::string(EVMARKER_SHARED_DATA) + "/tags/board.yml";
  if (!std::filesystem::exists(measured)) {
    MESSAGE("skipped: ", measured, " is not there");
    return;
  }
  const Board truth = opencv::load_board(measured, "DICT_APRILTAG_36h11");
  const Board grid =
      load("target_type: aprilgrid\ntagCols: 4\ntagRows: 3\ntagSize: 0.07\ntagSpacing: 0.25\n").boards[0];
  REQUIRE(grid.markers.size() == truth.markers.size());
  const Eigen::Isometry3d T_truth_grid = truth.markers[0].T_board_marker * grid.markers[0].T_board_marker.inverse();
  for (std::size_t i = 0; i < grid.markers.size(); ++i) {
    CHECK(grid.markers[i].id == truth.markers[i].id);
    CHECK((T_truth_grid * grid.markers[i].T_board_marker).isApprox(truth.markers[i].T_board_marker, 1e-6));
  }
}

TEST_CASE("an aprilgrid as Kalibr prints it, with black squares between the tags, is found where it is") {
  const Board board =
      load("target_type: aprilgrid\ntagCols: 3\ntagRows: 2\ntagSize: 0.06\ntagSpacing: 0.3\n").boards[0];
  const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  const auto hand = trajectory::handheld({.T_centre = facing_pose({0, 0, 0.5}), .frequency_hz = 2});
  const Trajectory T_camera_board = [&](double t) { return hand(t) * Eigen::Translation3d(-0.108, -0.069, 0); };
  std::vector<SimulatedMarker> scene;
  for (int column = 0; column <= 3; ++column)  // the squares are as wide as the spaces
    for (int row = 0; row <= 2; ++row) {
      const Eigen::Translation3d middle(0.078 * column - 0.009, 0.078 * row - 0.009, 0);
      scene.push_back({.id = 1000 + 10 * column + row,
                       .length = 0.018,
                       .bits = CodeBits::Zero(1, 1),
                       .T_camera_marker = [&, middle](double t) { return T_camera_board(t) * middle; },
                       .quiet_zone_cells = 0});
    }
  for (const SimulatedMarker& tag : simulated_markers(board, T_camera_board)) scene.push_back(tag);
  BoardDetector detector(
      camera,
      opencv::ArucoDetector(camera, {.dictionary = "DICT_APRILTAG_36h11", .marker_length = 0.06, .border_cells = 2}),
      {board});
  Simulator events(camera, scene, {.duration_s = 0.2});
  PolarityFrame frame(camera.sensor_size());
  int found = 0;
  Timestamp next_frame = 40000;
  for_each_event(events, [&](const Event& event) {
    if (event.t >= next_frame) {
      next_frame += 40000;
      for (const MarkerDetection& detection : detector.detect(frame)) {
        CHECK(detection.id == 600);
        CHECK(distance_mm(detection.T_camera_marker, T_camera_board(1e-6 * static_cast<double>(detection.t))) < 6);
        CHECK(angle_deg(detection.T_camera_marker, T_camera_board(1e-6 * static_cast<double>(detection.t))) < 2);
        ++found;
      }
    }
    frame.update(event);
  });
  CHECK(found >= 3);  // of 4
}

TEST_CASE("a target of Kalibr's that is no aprilgrid, or wrong, is refused") {
  CHECK(refusal(replaced(kAprilgrid, "'aprilgrid'", "'checkerboard'"))
            .starts_with("board FILE: target_type is \"checkerboard\", not \"aprilgrid\""));
  CHECK(refusal(replaced(kAprilgrid, "tagCols: 6", "tagCols: 0")) ==
        "board FILE: tagCols is 0, not a positive whole number");
  CHECK(refusal(replaced(kAprilgrid, "tagCols: 6", "tagCols: 60000")) ==
        "board FILE: tagCols x tagRows are 240000 markers, but DICT_APRILTAG_36h11 has 587");
  CHECK(refusal(replaced(kAprilgrid, "tagRows", "tagLines")) == "board FILE: no field tagRows");
  CHECK(refusal(replaced(kAprilgrid, "0.088", "88")) ==
        "board FILE: tagSize is 88, taken as metres, which must be up to 10; for 88 mm write 0.088");
  CHECK(refusal(replaced(kAprilgrid, "0.25", "0")).starts_with("board FILE: tagSpacing is 0, not a ratio"));
  CHECK(refusal(kAprilgrid + "border: 3\n") == "board FILE: border is 3, not 1 or 2 cells");
  CHECK(refusal(kAprilgrid + "border: 0\n") == "board FILE: border is 0, not a positive whole number");
  CHECK(refusal(kAprilgrid, "DICT_4X4_50") ==
        "board FILE: dictionary is DICT_4X4_50, but the tags are AprilTags: it must be one of DICT_APRILTAG_...");
  CHECK(refusal(kAprilgrid + "dictionary: DICT_APRILTAG_25h9\n", "DICT_APRILTAG_36h11") ==
        "board FILE: dictionary is DICT_APRILTAG_25h9 there, but DICT_APRILTAG_36h11 is asked for");
}

TEST_CASE("the tag bundles of apriltag_ros are read, each as a board") {
  const opencv::BoardFile file = load(kBundles);
  CHECK(file.dictionary == "DICT_APRILTAG_36h11");
  REQUIRE(file.boards.size() == 2);
  CHECK(file.boards[0].id == 600);
  CHECK(file.boards[1].id == 601);
  REQUIRE(file.boards[0].markers.size() == 2);
  const BoardMarker &first = file.boards[0].markers[0], &turned = file.boards[0].markers[1];
  CHECK(first.id == 0);
  CHECK(first.length == 0.05);
  CHECK(first.T_board_marker.translation() == Vector3d::Zero());
  CHECK(code_seen(first, Vector3d::UnitX(), -Vector3d::UnitY()) == 0xd5d628584);
  // A quarter turn about y: the tag's z along the bundle's x, its x along -z, its y along y.
  CHECK(turned.id == 4);
  CHECK(turned.length == 0.08);
  CHECK(turned.T_board_marker.translation() == Vector3d(0.1, -0.2, 0.3));
  CHECK((turned.T_board_marker.linear() * Vector3d::UnitZ() - Vector3d::UnitX()).norm() < 1e-9);
  CHECK(code_seen(turned, -Vector3d::UnitZ(), -Vector3d::UnitY()) == 0xebcbca822);
  CHECK(file.boards[1].markers[0].T_board_marker.translation() == Vector3d::Zero());

  CHECK(load(kBundles + "tag_family: 'tag25h9'\n").dictionary == "DICT_APRILTAG_25h9");
  CHECK(load(kBundles, "DICT_APRILTAG_16h5").dictionary == "DICT_APRILTAG_16h5");
  CHECK(load(replaced(kBundles, "layout:\n        [\n          {id: 7",
                      "board: 33, layout:\n        [\n          {id: 7"))
            .boards[1]
            .id == 33);
  CHECK_THROWS_WITH(opencv::load_board(write("form.yml", kBundles)),
                    ("board " + temporary("form.yml") + ": has 2 boards, not one").c_str());
}

TEST_CASE("bundles that are none are refused") {
  CHECK(refusal("tag_bundles:\n  [\n  ]\n") == "board FILE: tag_bundles is not a list of bundles");
  CHECK(refusal("tag_bundles: [ 5 ]\n") == "board FILE: tag_bundles[0] is not a map of name and layout");
  CHECK(refusal("tag_bundles: [ {name: a} ]\n") == "board FILE: tag_bundles[0] has no field layout");
  CHECK(refusal(replaced(kBundles, "id: 4, size: 0.08", "id: 4, size: -1")) ==
        "board FILE: tag_bundles[0] layout[1] size is -1, not positive");
  CHECK(refusal(replaced(kBundles, "id: 4,", "id: 0,")) == "board FILE: board 600: marker 0 is there twice");
  CHECK(refusal(replaced(kBundles, "qw: 0.7071", "qw: 0.1")) ==
        "board FILE: tag_bundles[0] layout[1]: the quaternion (qw, qx, qy, qz) has length 0.714136, not 1");
  CHECK(refusal(kBundles, "DICT_4X4_50") ==
        "board FILE: dictionary is DICT_4X4_50, but the tags are AprilTags: it must be one of DICT_APRILTAG_...");
  CHECK(refusal(kBundles + "tag_family: tagCircle21h7\n") ==
        "board FILE: tag_family is \"tagCircle21h7\", which OpenCV does not have");
  CHECK(refusal(kBundles + "tag_family: tag16h5\n", "DICT_APRILTAG_36h11") ==
        "board FILE: dictionary is DICT_APRILTAG_16h5 there, but DICT_APRILTAG_36h11 is asked for");
}

TEST_CASE("a GridBoard of OpenCV's is read, by the names of C++ and with underscores") {
  for (const std::string& text :
       {kGrid,
        std::string("markers_x: 3\nmarkers_y: 2\nmarker_length: 0.04\nmarker_separation: 0.01\ndictionary: 5\n")}) {
    const opencv::BoardFile file = load(text);
    CHECK(file.dictionary == "DICT_5X5_100");
    REQUIRE(file.boards.size() == 1);
    CHECK(file.boards[0].id == 100);
    check_corners(file.boards[0], opencv_grid(3, 2, 0.04F, 0.01F));
    // By hand: the second marker of the second row.
    const std::array<Vector3d, 4> corners = corners_of(file.boards[0].markers[4]);
    CHECK((corners[0] - Vector3d(0.05, 0.05, 0)).norm() < 1e-12);
    CHECK((corners[2] - Vector3d(0.09, 0.09, 0)).norm() < 1e-12);
  }
  const Board shifted = load(kGrid + "firstMarker: 10\n").boards[0];
  CHECK(shifted.markers[0].id == 10);
  CHECK(shifted.markers[5].id == 15);
  CHECK(shifted.markers[5].bits == opencv::marker_bits(opencv::make_dictionary("DICT_5X5_100"), 15));
  CHECK(load(kGrid + "ids: [9, 8, 7, 6, 5, 4]\n").boards[0].markers[1].id == 8);
}

TEST_CASE("a CharucoBoard of OpenCV's is read, also in the pattern of old versions") {
  for (const auto& [columns, rows] : {std::pair(4, 3), {3, 4}, {5, 5}, {4, 4}}) {
    const std::string sized = replaced(replaced(kCharuco, "squaresX: 4", "squaresX: " + std::to_string(columns)),
                                       "squaresY: 3", "squaresY: " + std::to_string(rows));
    CAPTURE(sized);
    check_corners(load(sized).boards[0], opencv_charuco(columns, rows, 0.04F, 0.03F));
    // With an odd number of rows the old pattern is the new one.
    const Board old = load(sized + "legacy_pattern: 1\n").boards[0];
    REQUIRE(old.markers.size() == static_cast<std::size_t>(columns * rows / 2));
    const Vector3d first = (rows % 2 == 0 ? Vector3d(0.02, 0.02, 0) : Vector3d(0.06, 0.02, 0));
    CHECK((old.markers[0].T_board_marker.translation() - first).norm() < 1e-12);
    // The squares of markers touch only at corners.
    for (const BoardMarker& a : old.markers)
      for (const BoardMarker& b : old.markers)
        CHECK((a.id == b.id || (a.T_board_marker.translation() - b.T_board_marker.translation()).norm() > 0.04 * 1.41));
  }
  CHECK(load(kCharuco).dictionary == "DICT_6X6_250");
  CHECK(load(kCharuco).boards[0].id == 300);
  CHECK(load(kCharuco).border_cells == 1);
}

TEST_CASE("boards of OpenCV's that are none are refused") {
  CHECK(refusal(replaced(kGrid, "markersY", "markersZ")) == "board FILE: no field markersY");
  CHECK(refusal(replaced(kGrid, "markerLength: 0.04", "marker_length: 40")) ==
        "board FILE: marker_length is 40, taken as metres, which must be up to 10; for 40 mm write 0.04");
  CHECK(refusal(replaced(kGrid, "markersX: 3", "markersX: 51")) ==
        "board FILE: markersX x markersY are 102 markers, but DICT_5X5_100 has 100");
  CHECK(refusal(kGrid + "firstMarker: 95\n").starts_with("board FILE: ids: marker id 100 is not in DICT_5X5_100"));
  CHECK(refusal(kGrid + "ids: [1, 2]\n") == "board FILE: ids is not a list of 6 numbers, one for each marker");
  CHECK(refusal(replaced(kCharuco, "0.03", "0.04")) ==
        "board FILE: markerLength is 0.04, not less than the squares' 0.04");
  CHECK(refusal(replaced(kCharuco, "squaresX: 4\nsquaresY: 3", "squaresX: 1\nsquaresY: 1")) ==
        "board FILE: board 300 has no markers");
  CHECK(refusal(replaced(kCharuco, "6X6_250", "9X9_50")).starts_with("board FILE: dictionary: no \"9X9_50\"; there"));
  CHECK(refusal(replaced(kCharuco, "6X6_250", "77")) == "board FILE: dictionary is 77, which is not the number of one");
  CHECK(refusal(kCharuco, "DICT_6X6_100") ==
        "board FILE: dictionary is DICT_6X6_250 there, but DICT_6X6_100 is asked for");
  CHECK(load(kCharuco, "DICT_6X6_250").boards.size() == 1);
}

TEST_CASE("a list of boards of aruco_opencv is read") {
  const opencv::BoardFile file = load(kArucoOpencv);
  CHECK(file.dictionary == "DICT_4X4_50");
  REQUIRE(file.boards.size() == 2);
  CHECK(file.boards[0].id == 100);
  CHECK(file.boards[1].id == 101);
  const double width = 2 * 0.0742 + 0.0248, height = 3 * 0.0742 + 2 * 0.0248;
  check_corners(file.boards[0], opencv_grid(2, 3, 0.0742F, 0.0248F), Vector3d(width / 2, height / 2, 0));
  check_corners(file.boards[1], opencv_grid(2, 1, 0.05F, 0.01F));
  CHECK(file.boards[1].markers[1].id == 7);
  CHECK(load(kArucoOpencv, "DICT_5X5_50").dictionary == "DICT_5X5_50");
  CHECK(refusal(replaced(kArucoOpencv, "marker_size: 0.05", "marker_size: big")) ==
        "board FILE: boards[1] marker_size is \"big\", not a number");
  CHECK(refusal(replaced(kArucoOpencv, "  frame_at_center: false\n", "")) ==
        "board FILE: boards[1] has no field frame_at_center");
  CHECK(refusal("- 1\n- 2\n").starts_with("board FILE: boards[0] is not a map of name, first_id"));
}

TEST_CASE("a file of our form may name its dictionary, and one of no form is refused with all that there are") {
  const std::string ours =
      "board: 9\nmarkers:\n- id: 60\n  length: 0.1\n  rotation: [0, 0, 0]\n  translation: [0, 0, 0]\n";
  CHECK(load("dictionary: DICT_4X4_100\n" + ours).dictionary == "DICT_4X4_100");
  CHECK(load("dictionary: DICT_4X4_100\n" + ours).boards[0].id == 9);
  CHECK(refusal(ours).starts_with("board FILE: markers[0]: marker id 60 is not in DICT_4X4_50"));
  CHECK(
      refusal("image_width: 640\n").starts_with("board FILE: is no board: it has none of the fields markers, target"));
}
