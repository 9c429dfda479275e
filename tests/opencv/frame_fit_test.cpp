#include "evmarker/opencv/frame_fit.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "opencv/pose_distance.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;
using opencv::fit_to_frame;
using opencv::read_code;

namespace {

constexpr double kF = 533, kCx = 159.5, kCy = 119.5, kLength = 0.10;
constexpr int kImageWidth = 320, kImageHeight = 240;
const PinholeCamera kSmallCamera{{kImageWidth, kImageHeight}, kF, kF, kCx, kCy};

// Codes with their border, as they would be printed; '#' black.
using Print = std::array<std::string_view, 6>;
constexpr Print kCode{"######", "# #  #", "## # #", "###  #", "### ##", "######"};
constexpr Print kOtherCode{"######", "#    #", "#### #", "# ## #", "#  # #", "######"};

CodeBits bits(const Print& print) {
  CodeBits code(4, 4);
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column)
      code(row, column) = print[static_cast<std::size_t>(row + 1)][static_cast<std::size_t>(column + 1)] == ' ';
  return code;
}

const MarkerModel kModel = make_code_marker(kLength, bits(kCode));

Eigen::Matrix3d turn(double angle_deg, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(angle_deg * std::numbers::pi / 180, axis.normalized()).toRotationMatrix();
}

// A marker that faces the camera, then turned.
Eigen::Isometry3d turned_pose(double x, double y, double z, double angle_deg, const Eigen::Vector3d& axis) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << x, y, z;
  T.linear() = turn(angle_deg, axis) * Eigen::Vector3d(1, -1, -1).asDiagonal();
  return T;
}

Eigen::Isometry3d moved(Eigen::Isometry3d T, const Eigen::Vector3d& by_mm, double by_deg, const Eigen::Vector3d& axis) {
  T.translation() += by_mm / 1000;
  T.linear() = turn(by_deg, axis) * T.linear();
  return T;
}

// The print on a white card, one cell wider than the marker on each side, photographed by OpenCV: 255 white, 0 black,
// 128 beside the card. `erode_px`: all black areas are so much smaller at each of their edges (less than 0: larger).
cv::Mat photograph(const Print& print, const Eigen::Isometry3d& T, double erode_px = 0) {
  constexpr int kCell = 60, kSide = 8 * kCell,
                kFine = 5;  // [texture pixels]; each pixel of the frame is 5 x 5 fine ones
  cv::Mat texture(kSide, kSide, CV_8U, cv::Scalar(255));
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column < 6; ++column)
      if (print[static_cast<std::size_t>(row)][static_cast<std::size_t>(column)] == '#')
        texture(cv::Rect((column + 1) * kCell, (row + 1) * kCell, kCell, kCell)) = 0;

  // Texture pixel -> marker [m] -> fine pixel of the image.
  const double m = kLength / (6 * kCell), corner = kLength * 4 / 6;
  const cv::Matx33d marker_texture(m, 0, m / 2 - corner, 0, -m, corner - m / 2, 0, 0, 1);
  const auto& R = T.linear();
  const auto& t = T.translation();
  const cv::Matx33d camera_marker(R(0, 0), R(0, 1), t(0), R(1, 0), R(1, 1), t(1), R(2, 0), R(2, 1), t(2));
  const cv::Matx33d K(kFine * kF, 0, kFine * kCx + 2, 0, kFine * kF, kFine * kCy + 2, 0, 0, 1);
  const cv::Matx33d H = K * camera_marker * marker_texture;
  const cv::Size fine(kFine * kImageWidth, kFine * kImageHeight);
  cv::Mat image, card;
  cv::warpPerspective(texture, image, H, fine, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(255));
  cv::warpPerspective(cv::Mat(kSide, kSide, CV_8U, cv::Scalar(255)), card, H, fine);

  // An edge lies half a fine pixel before the first fine pixel behind it.
  const cv::Mat white = image >= 128;
  cv::Mat distance;
  cv::distanceTransform(erode_px > 0 ? cv::Mat(~white) : white, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::Mat black = ~white;
  if (erode_px > 0) black = distance > kFine * erode_px + 0.5;
  if (erode_px < 0) black |= distance < -kFine * erode_px + 0.5;

  cv::Mat frame(kImageHeight, kImageWidth, CV_8U, cv::Scalar(128));
  for (int y = 0; y < kImageHeight; ++y)
    for (int x = 0; x < kImageWidth; ++x) {
      const cv::Point at(kFine * x + 2, kFine * y + 2);
      if (card.at<uchar>(at) > 128) frame.at<uchar>(y, x) = black.at<uchar>(at) != 0 ? 0 : 255;
    }
  return frame;
}

const Eigen::Isometry3d kPose = turned_pose(0.03, -0.02, 0.5, 25, {1, 0.7, 0.3});

// Starts around a pose, each off by this much along and about a direction of its own.
std::vector<Eigen::Isometry3d> starts(const Eigen::Isometry3d& T, double by_mm, double by_deg) {
  std::vector<Eigen::Isometry3d> poses;
  for (const auto& [direction, axis] : {std::pair(Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 1)),
                                        std::pair(Eigen::Vector3d(0, -1, 0), Eigen::Vector3d(1, 0, 0)),
                                        std::pair(Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0, 1, 0)),
                                        std::pair(Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(-1, 1, 0)),
                                        std::pair(Eigen::Vector3d(-1, 1, 1), Eigen::Vector3d(1, 1, -1))})
    poses.push_back(moved(T, by_mm * direction.normalized(), by_deg, axis));
  return poses;
}

// Unsorted patches of black, white and nothing.
cv::Mat texture(int patch_px, unsigned seed) {
  std::mt19937 random(seed);
  cv::Mat frame(kImageHeight, kImageWidth, CV_8U);
  for (int y = 0; y < kImageHeight; y += patch_px)
    for (int x = 0; x < kImageWidth; x += patch_px) {
      const cv::Rect patch = cv::Rect(x, y, patch_px, patch_px) & cv::Rect(0, 0, kImageWidth, kImageHeight);
      frame(patch) = std::array{0, 128, 255}[random() % 3];
    }
  return frame;
}

}  // namespace

TEST_CASE("a start 10 mm and 3 deg off comes back, if the steps are within reach") {
  const double reach_px = 12;  // 10 mm are 11 px here
  for (const Eigen::Isometry3d& truth :
       {kPose, turned_pose(0, 0, 0.5, 35, {0, 1, 0}), turned_pose(-0.02, 0.01, 0.45, 30, {-1, 0.5, 1})}) {
    const cv::Mat frame = photograph(kCode, truth);
    for (const Eigen::Isometry3d& start : starts(truth, 10, 3)) {
      REQUIRE(distance_mm(start, truth) == doctest::Approx(10));
      REQUIRE(angle_deg(start, truth) == doctest::Approx(3));
      const auto fit = fit_to_frame(kSmallCamera, frame, kModel, start, reach_px, 10);
      REQUIRE(fit);
      CHECK(distance_mm(fit->T_camera_marker, truth) < 1);
      CHECK(angle_deg(fit->T_camera_marker, truth) < 1.5);
      CHECK(fit->support > 0.95);
      CHECK(fit->cost_px < 0.7);
      CHECK(fit->T_camera_marker.linear().determinant() == doctest::Approx(1));
    }
  }
}

TEST_CASE("a start as a detector gives it needs few iterations and little reach") {
  const cv::Mat frame = photograph(kCode, kPose);
  for (const Eigen::Isometry3d& start : starts(kPose, 2, 1.5)) {
    const auto before = fit_to_frame(kSmallCamera, frame, kModel, start, 4, 0);
    const auto fit = fit_to_frame(kSmallCamera, frame, kModel, start, 4);
    REQUIRE(before);
    REQUIRE(fit);
    CHECK(before->T_camera_marker.isApprox(start));
    CHECK(fit->cost_px < 0.7 * before->cost_px);
    CHECK(distance_mm(fit->T_camera_marker, kPose) < 0.3);
    CHECK(angle_deg(fit->T_camera_marker, kPose) < 0.2);
  }
}

TEST_CASE("dark areas that look too small or too large give the offset and leave the pose alone") {
  for (const double erode_px : {-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0}) {
    CAPTURE(erode_px);
    const cv::Mat frame = photograph(kCode, kPose, erode_px);
    const auto fit = fit_to_frame(kSmallCamera, frame, kModel, moved(kPose, {1, -1, 1}, 1, {1, 2, 3}), 4);
    REQUIRE(fit);
    CHECK(std::abs(fit->offset_px - erode_px) < 0.15);
    CHECK(distance_mm(fit->T_camera_marker, kPose) < 0.6);
    CHECK(angle_deg(fit->T_camera_marker, kPose) < 0.4);
  }
}

TEST_CASE("an outline alone does not tell offset from distance: the offset stays near zero") {
  const Eigen::Isometry3d truth = turned_pose(0, 0, 0.5, 10, {0, 0, 1});
  const double side_px = kF * kLength / 0.5;
  const auto fit = fit_to_frame(kSmallCamera, photograph(kCode, truth, 1), make_square_marker(kLength), truth, 4);
  REQUIRE(fit);
  CHECK(fit->support > 0.9);
  CHECK(std::abs(fit->offset_px) < 0.1);
  CHECK(std::abs(fit->T_camera_marker.translation().z() - 0.5 * side_px / (side_px - 2)) < 0.002);
}

TEST_CASE("a frame without the marker's steps has no support and does not move the pose") {
  const auto blank =
      fit_to_frame(kSmallCamera, cv::Mat(kImageHeight, kImageWidth, CV_8U, cv::Scalar(128)), kModel, kPose, 4);
  REQUIRE(blank);
  CHECK(blank->support == 0);
  CHECK(blank->cost_px == 2);
  CHECK(blank->T_camera_marker.isApprox(kPose, 0));
  for (const int uniform : {0, 255}) {
    const auto fit =
        fit_to_frame(kSmallCamera, cv::Mat(kImageHeight, kImageWidth, CV_8U, cv::Scalar(uniform)), kModel, kPose, 4);
    REQUIRE(fit);
    CHECK(fit->support == 0);
  }

  // Steps at the same places, but from dark to bright.
  const cv::Mat frame = photograph(kCode, kPose);
  REQUIRE(fit_to_frame(kSmallCamera, frame, kModel, kPose, 4, 0)->support > 0.95);
  const auto inverted = fit_to_frame(kSmallCamera, 255 - frame, kModel, kPose, 4, 0);
  REQUIRE(inverted);
  CHECK(inverted->support < 0.1);

  // Where the camera looks past the frame.
  const auto outside = fit_to_frame(kSmallCamera, frame, kModel, turned_pose(0.5, 0, 0.5, 0, {0, 0, 1}), 4);
  REQUIRE(outside);
  CHECK(outside->support == 0);
}

TEST_CASE("edges that lie within areas of one brightness are counted, those that nobody has seen are not") {
  const auto contradicted = [](const cv::Mat& frame, const Eigen::Isometry3d& T) {
    const auto fit = fit_to_frame(kSmallCamera, frame, kModel, T, 4, 0);
    REQUIRE(fit);
    return fit->contradicted_edges;
  };
  const cv::Mat frame = photograph(kCode, kPose);
  const int edges = static_cast<int>(kModel.segments.size());
  CHECK(contradicted(frame, kPose) == 0);
  CHECK(contradicted(0 * frame + 128, kPose) == 0);
  CHECK(contradicted(0 * frame, kPose) == edges);
  CHECK(contradicted(0 * frame + 255, kPose) == edges);

  // Something dark over a corner of the code.
  cv::Mat hidden = frame.clone();
  const Eigen::Vector3d corner = kPose * Eigen::Vector3d(kLength / 6, kLength / 3, 0);
  const Eigen::Vector2d at = kSmallCamera.project(corner);
  cv::circle(hidden, {static_cast<int>(at.x()), static_cast<int>(at.y())}, 14, cv::Scalar(0), cv::FILLED);
  CHECK(contradicted(hidden, kPose) > 0);
  CHECK(contradicted(hidden, kPose) < edges / 2);
}

TEST_CASE("no fit of what is not in front of the camera, not finite or empty") {
  const cv::Mat frame = photograph(kCode, kPose);
  const auto fits = [&](const Eigen::Isometry3d& T, const MarkerModel& model) {
    return fit_to_frame(kSmallCamera, frame, model, T, 4).has_value();
  };
  REQUIRE(fits(kPose, kModel));
  CHECK_FALSE(fits(turned_pose(0.03, -0.02, -0.5, 25, {1, 0.7, 0.3}), kModel));
  CHECK_FALSE(fits(turned_pose(0, 0, 0.01, 60, {1, 0, 0}), kModel));  // one half of it behind the camera
  CHECK_FALSE(fits(turned_pose(0, 0, 0, 0, {1, 0, 0}), kModel));
  CHECK_FALSE(fits(kPose, MarkerModel{}));
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column) {
        CAPTURE(bad);
        CAPTURE(row);
        CAPTURE(column);
        Eigen::Isometry3d T = kPose;
        T.matrix()(row, column) = bad;
        CHECK_FALSE(fits(T, kModel));
      }
}

TEST_CASE("code agreement is the share of the cells that look right") {
  const cv::Mat frame = photograph(kCode, kPose);
  const auto agreement = [](const cv::Mat& seen, const Print& print, const Eigen::Isometry3d& T) {
    return read_code(kSmallCamera, seen, bits(print), kLength, T).agreement;
  };
  CHECK(agreement(frame, kCode, kPose) == 1);
  CHECK(agreement(photograph(kCode, kPose, 1), kCode, kPose) == 1);

  int differ = 0;
  for (std::size_t row = 0; row < 6; ++row)
    for (std::size_t column = 0; column < 6; ++column) differ += kCode[row][column] != kOtherCode[row][column];
  REQUIRE(differ >= 4);
  CHECK(agreement(frame, kOtherCode, kPose) == doctest::Approx(1 - differ / 36.0));
  CHECK(agreement(photograph(kOtherCode, kPose), kOtherCode, kPose) == 1);

  // A quarter turn makes another code of it: compare the cells with those of the turned print.
  const Eigen::Isometry3d turned = kPose * Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ());
  int differ_turned = 0;
  for (std::size_t row = 0; row < 6; ++row)
    for (std::size_t column = 0; column < 6; ++column) differ_turned += kCode[row][column] != kCode[5 - column][row];
  REQUIRE(differ_turned > 0);
  CHECK(agreement(frame, kCode, turned) == doctest::Approx(1 - differ_turned / 36.0));
}

TEST_CASE("code agreement counts what was not seen against the marker") {
  const Eigen::Isometry3d frontal = turned_pose(0, 0, 0.5, 0, {0, 0, 1});
  cv::Mat frame = photograph(kCode, frontal);
  const auto agreement = [&](const Eigen::Isometry3d& T) {
    return read_code(kSmallCamera, frame, bits(kCode), kLength, T).agreement;
  };
  REQUIRE(agreement(frontal) == 1);
  CHECK(agreement(turned_pose(0.5, 0, 0.5, 0, {0, 0, 1})) == 0);  // beside the image
  // Behind the camera, where each point has the image that it had in front.
  Eigen::Isometry3d behind = frontal * Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ());
  behind.translation() = -frontal.translation();
  CHECK(agreement(behind) == 0);
  CHECK(agreement(turned_pose(std::nan(""), 0, 0.5, 0, {0, 0, 1})) == 0);

  frame.colRange(0, kImageWidth / 2) = 128;  // the left half was not seen
  CHECK(agreement(frontal) == doctest::Approx(0.5));
  frame = 128;
  CHECK(agreement(frontal) == 0);
}

TEST_CASE("a texture has neither a marker's cells nor its edges") {
  double best_agreement = 0, best_support = 0;
  for (const int patch_px : {1, 4, 9, 18, 40})
    for (unsigned seed = 0; seed < 10; ++seed) {
      const cv::Mat frame = texture(patch_px, seed);
      const auto fit = fit_to_frame(kSmallCamera, frame, kModel, kPose, 4);
      if (fit) best_support = std::max(best_support, fit->support);
      const Eigen::Isometry3d T = fit ? fit->T_camera_marker : kPose;
      best_agreement = std::max(best_agreement, read_code(kSmallCamera, frame, bits(kCode), kLength, T).agreement);
    }
  CHECK(best_agreement > 0.2);  // it was compared
  CHECK(best_agreement < 0.7);
  CHECK(best_support < 0.7);
}
