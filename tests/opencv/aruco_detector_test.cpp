#include "evmarker/opencv/aruco_detector.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <concepts>
#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <random>
#include <string>
#include <vector>

#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "message_of.hpp"
#include "opencv/pose_distance.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;
using opencv::ArucoDetector;

static_assert(MarkerDetector<ArucoDetector<PinholeCamera>>);
static_assert(GuidedDetector<ArucoDetector<PinholeCamera>>);
static_assert(EnumeratingDetector<ArucoDetector<PinholeCamera>>);
static_assert(std::copyable<ArucoDetector<PinholeCamera>>);
static_assert(!MarkerDetector<PinholeCamera>);

namespace {

constexpr SensorSize kSize{640, 480};
const PinholeCamera kCamera{kSize, 533, 533, 319.5, 239.5};

// Marker 0 of DICT_4X4_50 with its border, as it is printed; '#' black.
constexpr std::array kMarker0{"######", "# #  #", "## # #", "###  #", "### ##", "######"};

CodeBits marker0() {
  CodeBits bits(4, 4);
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column)
      bits(row, column) = kMarker0[static_cast<std::size_t>(row + 1)][column + 1] == ' ';
  return bits;
}

Eigen::Isometry3d pose(double x, double y, double z, double turn_x, double turn_y, double turn_z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << x, y, z;
  T.linear() =
      (Eigen::AngleAxisd(turn_y, Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(turn_x, Eigen::Vector3d::UnitX()) *
       Eigen::AngleAxisd(turn_z, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix() *
      Eigen::Vector3d(1, -1, -1).asDiagonal();
  return T;
}

// The lens by OpenCV's formulas, not by ours.
struct Lens {
  cv::Matx33d K = {533, 0, 319.5, 0, 533, 239.5, 0, 0, 1};
  cv::Mat coefficients = cv::Mat::zeros(1, 5, CV_64F);
  bool fisheye = false;

  std::vector<cv::Point2d> sight(const std::vector<cv::Point2d>& pixels) const {
    std::vector<cv::Point2d> m;
    if (fisheye)
      cv::fisheye::undistortPoints(pixels, m, K, coefficients);
    else
      cv::undistortPoints(pixels, m, K, coefficients);
    return m;
  }

  Eigen::Vector2d project(const Eigen::Vector3d& point) const {
    const std::vector<cv::Point3d> points{{point.x(), point.y(), point.z()}};
    std::vector<cv::Point2d> pixels;
    if (fisheye)
      cv::fisheye::projectPoints(points, pixels, cv::Affine3d::Identity(), K, coefficients);
    else
      cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, coefficients, pixels);
    return {pixels[0].x, pixels[0].y};
  }
};

// What the frame frames like once every edge of a marker on a white card has swept the whole of it; the surroundings
// have seen nothing. `band_px` > 0: swept only so near to an edge.
void print(PolarityFrame& frame, const Lens& lens, const CodeBits& bits, double length, const Eigen::Isometry3d& T,
           double band_px = 0) {
  const int cells = static_cast<int>(bits.rows()) + 2;
  const double cell = length / cells;
  std::vector<cv::Point2d> pixels;
  for (int y = 0; y < frame.sensor_size().height; ++y)
    for (int x = 0; x < frame.sensor_size().width; ++x) pixels.emplace_back(x, y);
  const std::vector<cv::Point2d> sight = lens.sight(pixels);
  const auto white = [&](double column, double row) {
    const int c = static_cast<int>(std::floor(column)), r = static_cast<int>(std::floor(row));
    if (c < 0 || r < 0 || c >= cells || r >= cells) return true;
    return c > 0 && r > 0 && c < cells - 1 && r < cells - 1 && bits(r - 1, c - 1) != 0;
  };
  const double band = band_px * T.translation().z() / (lens.K(0, 0) * cell);  // in cells
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    // Ray and plane: n . (s m) = n . origin.
    const Eigen::Vector3d m(sight[i].x, sight[i].y, 1), n = T.linear().col(2);
    const Eigen::Vector3d point = T.inverse() * (m * (n.dot(T.translation()) / n.dot(m)));
    const double column = (point.x() + length / 2) / cell, row = (length / 2 - point.y()) / cell;
    if (!(column > -1 && row > -1 && column < cells + 1 && row < cells + 1)) continue;
    bool near = band_px <= 0;
    for (const double dx : {-band, 0.0, band})
      for (const double dy : {-band, 0.0, band}) near |= white(column + dx, row + dy) != white(column, row);
    if (near)
      frame.update({static_cast<std::uint16_t>(pixels[i].x), static_cast<std::uint16_t>(pixels[i].y),
                    static_cast<std::int16_t>(white(column, row)), 1234});
  }
}

}  // namespace

TEST_CASE("a swept marker is found: pose, corner order, time") {
  ArucoDetector detector(kCamera, {.dictionary = "DICT_4X4_50", .marker_length = 0.10});
  const Lens lens;
  for (const Eigen::Isometry3d& T :
       {pose(0, 0, 0.5, 0, 0, 0), pose(0.1, -0.05, 0.6, 0.4, -0.3, 0.2), pose(-0.12, 0.08, 0.7, -0.5, 0.2, 1.7),
        pose(0.02, 0.1, 0.6, 0.2, 0.6, 3.1), pose(-0.1, -0.1, 0.5, -0.6, -0.5, -1.4)}) {
    PolarityFrame frame(kSize);
    print(frame, lens, marker0(), 0.10, T);
    const auto detections = detector.detect(frame);
    REQUIRE(detections.size() == 1);
    const MarkerDetection& found = detections[0];
    CHECK(found.id == 0);
    CHECK(found.t == 1234);
    CHECK(distance_mm(found.T_camera_marker, T) < 4);
    CHECK(angle_deg(found.T_camera_marker, T) < 1);
    // From the marker's top left clockwise, each where a pinhole images it.
    const double h = 0.05;
    const std::array<Eigen::Vector3d, 4> square{{{-h, h, 0}, {h, h, 0}, {h, -h, 0}, {-h, -h, 0}}};
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector3d P = T * square[i];
      const Eigen::Vector2d p(533 * P.x() / P.z() + 319.5, 533 * P.y() / P.z() + 239.5);
      CHECK((found.corners_px[i] - p).norm() < 1);
    }
  }
}

TEST_CASE("lens distortion is undone") {
  Lens brown, fisheye;
  brown.coefficients = (cv::Mat_<double>(1, 5) << -0.35, 0.15, 0.001, -0.002, -0.03);
  fisheye.coefficients = (cv::Mat_<double>(1, 4) << -0.05, 0.01, -0.003, 0.001);
  fisheye.fisheye = true;
  fisheye.K = {300, 0, 319.5, 0, 300, 239.5, 0, 0, 1};
  const PinholeCamera brown_camera(kSize, 533, 533, 319.5, 239.5,
                                   BrownConradyDistortion{-0.35, 0.15, 0.001, -0.002, -0.03});
  const PinholeCamera fisheye_camera(kSize, 300, 300, 319.5, 239.5, EquidistantDistortion{-0.05, 0.01, -0.003, 0.001});
  for (const auto& [lens, camera, z] :
       {std::tuple(brown, brown_camera, 0.5), std::tuple(fisheye, fisheye_camera, 0.3)}) {
    ArucoDetector detector(camera, {.marker_length = 0.10});
    const Eigen::Isometry3d T = pose(0.42 * z, -0.26 * z, z, 0.3, -0.4, 0.5);  // near the corner of the image
    PolarityFrame frame(kSize);
    print(frame, lens, marker0(), 0.10, T);
    const auto detections = detector.detect(frame);
    REQUIRE(detections.size() == 1);
    CHECK(distance_mm(detections[0].T_camera_marker, T) < 3);
    CHECK(angle_deg(detections[0].T_camera_marker, T) < 1.5);
    CHECK((detections[0].corners_px[0] - lens.project(T * Eigen::Vector3d(-0.05, 0.05, 0))).norm() < 1);
  }
}

TEST_CASE("a marker that was just lost is searched near where it should be, and shown only where it is") {
  const Eigen::Isometry3d T = pose(0.03, -0.02, 0.5, 0.35, -0.3, 0.4);
  PolarityFrame frame(kSize), other(kSize);
  print(frame, {}, marker0(), 0.1, T);
  CodeBits other_bits = marker0();
  for (auto& bit : other_bits.reshaped()) bit = !bit;
  print(other, {}, other_bits, 0.1, T);
  ArucoDetector detector(kCamera, {.marker_length = 0.1});
  for (const double off_m : {0.0, 0.002, -0.003}) {
    CAPTURE(off_m);
    Eigen::Isometry3d predicted = T;
    predicted.translation() += Eigen::Vector3d(off_m, -off_m, 3 * off_m);
    detector.detect(frame);
    const auto found = detector.search(0, predicted);
    REQUIRE(found);
    CHECK(found->id == 0);
    CHECK(found->t == frame.t());
    CHECK((found->T_camera_marker.translation() - T.translation()).norm() < 0.002);
    CHECK(angle_deg(found->T_camera_marker, T) < 1);
    CHECK(detector.shows(0, T));
    CHECK_FALSE(detector.shows(1, T));

    detector.detect(other);  // another marker at the same place
    CHECK_FALSE(detector.search(0, predicted));
    CHECK_FALSE(detector.shows(0, T));
    detector.detect(PolarityFrame(kSize));
    CHECK_FALSE(detector.search(0, predicted));
    CHECK_FALSE(detector.shows(0, T));
  }
}

TEST_CASE("a small marker seen nearly head on has two poses, a large tilted one has one") {
  ArucoDetector detector(kCamera, {.marker_length = 0.10});
  int small = 0, two = 0;
  double worst_of_better = 0;
  for (const double tilt : {-0.25, -0.15, 0.15, 0.25})
    for (const double x : {-0.05, 0.0, 0.07}) {
      const Eigen::Isometry3d T = pose(x, 0.03, 1.4, 0.1, tilt, 0.3);
      PolarityFrame frame(kSize);
      print(frame, {}, marker0(), 0.10, T);
      for (const auto& found : detector.detect(frame)) {
        ++small;
        double better = angle_deg(found.T_camera_marker, T);
        if (found.T_camera_marker_alternative) {
          ++two;
          better = std::min(better, angle_deg(*found.T_camera_marker_alternative, T));
          CHECK(angle_deg(*found.T_camera_marker_alternative, found.T_camera_marker) > 1);
        }
        worst_of_better = std::max(worst_of_better, better);
      }
    }
  CHECK(small >= 10);
  CHECK(two >= 3);
  CHECK(worst_of_better < 8);

  PolarityFrame frame(kSize);
  print(frame, {}, marker0(), 0.10, pose(0, 0, 0.35, 0.7, 0.3, 0));
  const auto detections = detector.detect(frame);
  REQUIRE(detections.size() == 1);
  CHECK_FALSE(detections[0].T_camera_marker_alternative);
}

TEST_CASE("by a frame in part wrong, one of the two poses of a tilted marker is still the true one") {
  const double focal_px = 2500;  // 42 px at 6 m: the poses differ by less than a pixel
  constexpr SensorSize size{120, 120};
  const PinholeCamera camera(size, focal_px, focal_px, 59.5, 59.5);
  const Lens lens{.K = {focal_px, 0, 59.5, 0, focal_px, 59.5, 0, 0, 1}};
  ArucoDetector detector(camera, {.marker_length = 0.10});
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0, 1);
  int found = 0, wrong = 0;
  for (int i = 0; i < 400; ++i) {
    const Eigen::Isometry3d T = pose(0, 0, 6, 0.8 * unit(random), 0.5 + 0.4 * unit(random), 6.3 * unit(random));
    PolarityFrame frame(size);
    print(frame, lens, marker0(), 0.10, T);
    for (int k = 0; k < 120; ++k) {  // ragged edges: some rows of four pixels say the last polarity of another edge
      const int x = 30 + static_cast<int>(60 * unit(random)), y = 30 + static_cast<int>(60 * unit(random));
      const auto polarity = static_cast<std::int16_t>(unit(random) < 0.5);
      for (int dx = 0; dx < 4; ++dx)
        frame.update({static_cast<std::uint16_t>(x + dx), static_cast<std::uint16_t>(y), polarity, 1234});
    }
    for (const auto& detection : detector.detect(frame)) {
      ++found;
      const auto is_true = [&](const Eigen::Isometry3d& any) { return angle_deg(any, T) < 20; };
      const auto& other = detection.T_camera_marker_alternative;
      wrong += !is_true(detection.T_camera_marker) && !(other && is_true(*other));
    }
  }
  MESSAGE(found << " found, of which " << wrong << " at neither of two poses");
  CHECK(found > 300);
  CHECK(wrong == 0);
}

TEST_CASE("several markers, other dictionaries, a choice of ids") {
  for (const auto& markers : {std::tuple("DICT_4X4_50", 3, 17), std::tuple("DICT_6X6_250", 200, 4),
                              std::tuple("DICT_APRILTAG_36h11", 10, 586)}) {
    CAPTURE(std::get<0>(markers));
    const auto& [dictionary, a, b] = markers;
    ArucoDetector all(kCamera, {.dictionary = dictionary, .marker_length = 0.08});
    ArucoDetector only_b(kCamera, {.dictionary = dictionary, .marker_length = 0.08, .ids = {b}});
    PolarityFrame frame(kSize);
    print(frame, {}, all.bits(a), 0.08, pose(-0.1, 0, 0.5, 0.2, 0.1, 0.5));
    print(frame, {}, all.bits(b), 0.08, pose(0.1, 0.02, 0.5, -0.2, 0.3, -0.5));
    auto found = all.detect(frame);
    REQUIRE(found.size() == 2);
    CHECK(found[0].id == std::min(a, b));
    CHECK(found[1].id == std::max(a, b));
    const auto copy_found = ArucoDetector(only_b).detect(frame);
    REQUIRE(copy_found.size() == 1);
    CHECK(copy_found[0].id == b);
    CHECK(distance_mm(copy_found[0].T_camera_marker, pose(0.1, 0.02, 0.5, 0, 0, 0)) < 3);
  }
}

TEST_CASE("the model's edges lie between the cells of the printed marker") {
  const ArucoDetector detector(kCamera, {.marker_length = 0.06});
  CHECK(detector.bits(0) == marker0());
  const MarkerModel model = detector.model(0);
  REQUIRE(model.segments.size() > 4);
  const auto black = [](const Eigen::Vector3d& p) {  // cells of 1 cm
    const int column = static_cast<int>(std::floor(p.x() * 100 + 3)),
              row = static_cast<int>(std::floor(3 - p.y() * 100));
    return column >= 0 && row >= 0 && column < 6 && row < 6 && kMarker0[static_cast<std::size_t>(row)][column] == '#';
  };
  for (const auto& segment : model.segments) {
    const Eigen::Vector3d from = model.vertices[static_cast<std::size_t>(segment.from)],
                          to = model.vertices[static_cast<std::size_t>(segment.to)];
    const Eigen::Vector3d at = from + 0.002 * (to - from).normalized();
    CHECK(black(at + 0.002 * segment.dark_side));
    CHECK_FALSE(black(at - 0.002 * segment.dark_side));
  }
}

TEST_CASE("nothing is found where no marker is") {
  const int frames = 20;
  std::mt19937 random(5);
  for (const char* dictionary : {"DICT_4X4_1000", "DICT_APRILTAG_16h5"}) {
    ArucoDetector detector(kCamera, {.dictionary = dictionary, .marker_length = 0.10});
    CHECK(detector.detect(PolarityFrame(kSize)).empty());
    for (int i = 0; i < frames; ++i) {
      // Blocks of all sizes: thousands of dark quadrilaterals, some with a pattern inside.
      PolarityFrame frame(kSize);
      const int block = 3 + 2 * i;
      std::vector<int> polarity(static_cast<std::size_t>((640 / block + 1) * (480 / block + 1)));
      for (int& p : polarity) p = static_cast<int>(random() % 5) - 2;
      for (int y = 0; y < 480; ++y)
        for (int x = 0; x < 640; ++x)
          if (const int p = polarity[static_cast<std::size_t>(y / block * (640 / block + 1) + x / block)]; p != 0)
            frame.update(
                {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(p > 0), i});
      CHECK(detector.detect(frame).empty());
    }
  }
}

TEST_CASE("a marker of which only the edges were swept is never mistaken for another") {
  ArucoDetector detector(kCamera, {.dictionary = "DICT_4X4_1000", .marker_length = 0.10});
  int found_wide = 0;
  for (int id = 0; id < 20; ++id)
    for (const double band_px : {1.5, 3.0, 6.0, 12.0, 20.0}) {
      PolarityFrame frame(kSize);
      const Eigen::Isometry3d T = pose(0.02, -0.03, 0.45, 0.2, -0.2, 0.3 * id);
      print(frame, {}, detector.bits(id), 0.10, T, band_px);
      for (const auto& found : detector.detect(frame)) {
        CHECK(found.id == id);
        CHECK(angle_deg(found.T_camera_marker, T) < 3);
        found_wide += band_px > 15;
      }
    }
  CHECK(found_wide > 10);
}

TEST_CASE("no pose is fitted to a marker that is seen where it is tracked, but to one that is seen elsewhere") {
  ArucoDetector detector(kCamera, {.marker_length = 0.10});
  const Eigen::Isometry3d T = pose(0.1, -0.05, 0.6, 0.4, -0.3, 0.2);
  PolarityFrame frame(kSize);
  print(frame, {}, marker0(), 0.10, T);
  const auto detected_if_tracked_at = [&](MarkerId id, double dx) {
    PlacedMarker tracked{id, T};
    tracked.T_camera_marker.translation().x() += dx;
    const auto found = detector.detect(frame, {&tracked, 1});
    REQUIRE(found.size() == 1);
    CHECK(found[0].id == 0);
    return found[0].T_camera_marker;
  };
  constexpr double kPixel = 0.6 / 533;  // at the marker's distance [m]
  const Eigen::Isometry3d fitted = detector.detect(frame).at(0).T_camera_marker;
  CHECK(distance_mm(fitted, T) < 2);
  CHECK(distance_mm(detected_if_tracked_at(0, kPixel), T) == doctest::Approx(1e3 * kPixel));  // that of the tracker
  CHECK(detected_if_tracked_at(0, 6 * kPixel).isApprox(fitted, 1e-12));
  CHECK(detected_if_tracked_at(1, 0).isApprox(fitted, 1e-12));  // another marker is tracked there
}

TEST_CASE("markers of several lengths are each found where they are, and fitted with their own length") {
  const Eigen::Isometry3d small = pose(-0.1, 0.02, 0.5, 0.2, -0.3, 0.1), large = pose(0.14, -0.03, 0.9, -0.3, 0.2, 0.4);
  ArucoDetector detector(kCamera, {.marker_length = 0.05, .lengths = {{7, 0.15}}});
  PolarityFrame frame(kSize);
  print(frame, {}, marker0(), 0.05, small);
  print(frame, {}, detector.bits(7), 0.15, large);
  const auto found = detector.detect(frame);
  REQUIRE(found.size() == 2);
  for (const auto& expected : {std::pair(0, small), std::pair(7, large)}) {
    CAPTURE(expected.first);
    const auto& [id, T] = expected;
    const MarkerDetection& detection = found[id == 0 ? 0 : 1];
    CHECK(detection.id == id);
    CHECK(distance_mm(detection.T_camera_marker, T) < 3);
    CHECK(angle_deg(detection.T_camera_marker, T) < 2);
    CHECK(detector.shows(id, T));
    const auto searched = detector.search(id, T);
    REQUIRE(searched);
    CHECK(distance_mm(searched->T_camera_marker, T) < 3);
    const double half = id == 0 ? 0.025 : 0.075;
    const Eigen::Vector2d corner = Lens().project(detection.T_camera_marker * Eigen::Vector3d(-half, half, 0));
    CHECK((detection.corners_px[0] - corner).norm() < 1e-6);
    CHECK(detector.model(id).vertices[0].x() == doctest::Approx(-half));
  }
}

TEST_CASE("a detector names the markers that it may find") {
  CHECK(ArucoDetector(kCamera, {.ids = {7, 3}}).ids() == std::vector<MarkerId>{7, 3});
  const auto all = ArucoDetector(kCamera, {}).ids();
  REQUIRE(all.size() == 50);
  for (std::size_t i = 0; i < all.size(); ++i) CHECK(all[i] == static_cast<MarkerId>(i));
}

TEST_CASE("a marker cut by the border of the image or half swept is not found, and nothing breaks") {
  ArucoDetector detector(kCamera, {.marker_length = 0.10});
  for (const double x : {-0.32, 0.32}) {
    PolarityFrame frame(kSize);
    print(frame, {}, marker0(), 0.10, pose(x, 0, 0.5, 0.1, 0.1, 0));
    CHECK(detector.detect(frame).empty());
  }
}

TEST_CASE("settings that make no sense are named with their value") {
  const auto make = [](opencv::ArucoDetectorSettings settings) {
    return message_of([&] { ArucoDetector(kCamera, settings); });
  };
  CHECK(make({.dictionary = "DICT_1X1"}).find("DICT_1X1") != std::string::npos);
  for (const auto& [length, text] : {std::pair(0.0, "not 0"), std::pair(-0.1, "-0.1"), std::pair(std::nan(""), "nan"),
                                     std::pair(std::numeric_limits<double>::infinity(), "inf")}) {
    const std::string message = make({.marker_length = length});
    CHECK(message.find("marker length") != std::string::npos);
    CHECK(message.find(text) != std::string::npos);
  }
  const std::string id = make({.ids = {3, 50}});
  CHECK(id.find("50 markers") != std::string::npos);
  CHECK(id.find("id 50") != std::string::npos);
  CHECK(make({.lengths = {{50, 0.1}}}).find("id 50") != std::string::npos);
  CHECK(make({.lengths = {{7, 0}}}) == "marker 7 length must be a positive number of metres, not 0");
  CHECK(make({.min_side_px = -1}).find("min_side_px is -1") != std::string::npos);
  CHECK(make({.min_agreement = 1.5}).find("min_agreement is 1.5") != std::string::npos);
  CHECK(make({.min_edge_support = std::nan("")}).find("min_edge_support is nan") != std::string::npos);
  CHECK(make({.max_alternative_ratio = -2}).find("max_alternative_ratio is -2") != std::string::npos);
  ArucoDetector detector(kCamera, {});
  CHECK(message_of([&] { detector.model(50); }).find("id 50") != std::string::npos);
  CHECK(message_of([&] { detector.detect(PolarityFrame({320, 240})); }).find("320 x 240") != std::string::npos);
}

TEST_CASE("simulated hand-held recordings: found early, in the right place, and no other id") {
  int frames = 0, found = 0;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    ArucoDetector detector(kCamera, {.marker_length = 0.10});
    const MarkerId id = static_cast<MarkerId>(7 * seed);
    SimulatedMarker marker;
    marker.id = id;
    marker.bits = detector.bits(id);
    marker.T_camera_marker = trajectory::handheld({.frequency_hz = 2, .seed = seed});
    Simulator simulator(kCamera, {marker}, {.duration_s = 0.6, .seed = seed});
    SpatiotemporalFilter filter(kSize, std::chrono::microseconds(2000));
    PolarityFrame frame(kSize);
    Timestamp next_frame = 20000, first = -1;
    std::vector<double> errors_mm, errors_deg;
    for_each_event(simulator, [&](const Event& event) {
      if (event.t >= next_frame) {
        next_frame += 20000;
        const auto detections = detector.detect(frame);
        if (first >= 0) ++frames, found += !detections.empty();
        for (const auto& detection : detections) {
          CHECK(detection.id == id);
          if (first < 0) first = event.t;
          const Eigen::Isometry3d truth = simulator.T_camera_marker(0, detection.t);
          errors_mm.push_back(distance_mm(detection.T_camera_marker, truth));
          errors_deg.push_back(angle_deg(detection.T_camera_marker, truth));
        }
      }
      if (filter.accept(event)) frame.update(event);
    });
    CAPTURE(seed);
    REQUIRE(errors_mm.size() > 5);
    CHECK(first < 500000);
    std::ranges::sort(errors_mm);
    std::ranges::sort(errors_deg);
    CHECK(errors_mm[errors_mm.size() / 2] < 6);
    CHECK(errors_deg[errors_deg.size() / 2] < 2.5);
  }
  REQUIRE(frames > 30);
  CHECK(found > 0.8 * frames);
}

// The rim's outer edge has more contrast than the marker's own. The quadrilateral of both together can be read as the
// same marker, 80 mm and 25 deg off.
TEST_CASE("a dark rim beside a marker is not taken for a part of it") {
  int right = 0;
  for (const std::uint64_t seed : {1u, 4u}) {
    ArucoDetector detector(kCamera, {.marker_length = 0.10});
    SimulatedMarker marker;
    marker.id = 17;
    marker.bits = detector.bits(17);
    const Eigen::Index cells = marker.bits.rows() + 4;
    marker.shades.setConstant(cells, cells, marker.black);
    for (Eigen::Index row = 0; row < marker.bits.rows(); ++row)
      for (Eigen::Index column = 0; column < marker.bits.cols(); ++column)
        if (marker.bits(row, column) != 0) marker.shades(row + 2, column + 2) = 0.6;
    marker.shades.row(0).setConstant(0.5);
    marker.shades.row(cells - 1).setConstant(0.5);
    marker.shades.col(cells - 1).setConstant(0.85);
    marker.shades.col(0).setConstant(0.15);
    marker.T_camera_marker = trajectory::handheld({.T_centre = facing_pose({0, 0, 0.6}),
                                                   .amplitude_m = {0.10, 0.08, 0.10},
                                                   .amplitude_rad = {0.25, 0.25, 0.35},
                                                   .frequency_hz = 1.3,
                                                   .seed = seed});
    Simulator simulator(kCamera, {marker}, {.duration_s = 1, .seed = seed});
    PolarityFrame frame(kSize);
    Timestamp next_frame = 20000;
    for_each_event(simulator, [&](const Event& event) {
      frame.update(event);
      if (event.t < next_frame) return;
      next_frame += 10000;
      for (const auto& found : detector.detect(frame)) {
        CAPTURE(seed);
        CAPTURE(event.t);
        CHECK(found.id == 17);
        CHECK(distance_mm(found.T_camera_marker, simulator.T_camera_marker(0, found.t)) < 30);
        ++right;
      }
    });
  }
  CHECK(right > 10);
}
