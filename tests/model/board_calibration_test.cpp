#include "evmarker/model/board_calibration.hpp"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "boards.hpp"
#include "message_of.hpp"
#include "simulated.hpp"

using namespace evmarker;
using namespace evmarker::boards;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

BoardCalibrator calibrator(std::vector<MarkerId> ids = {1, 2, 3, 4, 5}) {
  return {std::move(ids), kCubeMarkerLength, simulated::camera.focal_length()};
}

// The poses of a cube's visible markers at one time, with errors as far as their covariance says, or mirrored.
class NoisyCube {
 public:
  explicit NoisyCube(unsigned seed) : random_(seed) {}

  std::vector<PoseEstimate> poses(const Eigen::Isometry3d& T_camera_board, double share_mirrored) {
    std::vector<PoseEstimate> poses;
    for (const BoardMarker& marker : cube().markers) {
      PoseEstimate pose{.id = marker.id, .T_camera_marker = T_camera_board * marker.T_board_marker, .quality = {}};
      const Eigen::Vector3d sight = pose.T_camera_marker.translation().normalized(),
                            normal = pose.T_camera_marker.linear().col(2);
      if (normal.dot(sight) > -std::cos(70 * kDegree)) continue;
      if (std::uniform_real_distribution<double>()(random_) < share_mirrored)
        pose.T_camera_marker.linear() =
            Eigen::Quaterniond::FromTwoVectors(normal, 2 * normal.dot(sight) * sight - normal).toRotationMatrix() *
            pose.T_camera_marker.linear();
      // Depth is 20 times as uncertain as the place in the image, tilt 5 times as uncertain as the turn in it.
      const Vector6d sigma = 1e-3 * Vector6d(0.05, 0.05, 1, 10, 10, 2);
      pose.covariance = sigma.cwiseAbs2().asDiagonal();
      for (int i = 0; i < 3; ++i) pose.T_camera_marker.translation()(i) += sigma(i) * normal_(random_);
      turn(pose.T_camera_marker,
           {sigma(3) * normal_(random_), sigma(4) * normal_(random_), sigma(5) * normal_(random_)});
      pose.quality.state = TrackingState::tracking;
      poses.push_back(pose);
    }
    return poses;
  }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

// Why a calibration of poses from these times of a turning cube is refused.
std::string refused(BoardCalibrator calibrator, const std::function<std::vector<PoseEstimate>(double)>& poses) {
  for (double s = 0; s < 12; s += 0.02) calibrator.add(poses(s));
  try {
    calibrator.solve();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("a board is calibrated as well as the errors of the poses allow, also where a fifth has a mirrored tilt") {
  for (const double mirrored : {0.0, 0.2}) {
    double squares = 0;
    constexpr unsigned kSeeds = 5;
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
      NoisyCube noisy(seed);
      const Trajectory motion = turning(seed);
      BoardCalibrator calibrator = ::calibrator();
      for (double s = 0; s < 12; s += 0.02) calibrator.add(noisy.poses(motion(s), mirrored));
      const BoardCalibration calibration = calibrator.solve();
      const CalibrationError error = worst_error(calibration, cube());
      CAPTURE(mirrored);
      CHECK(error.mm < 0.15);
      CHECK(error.deg < 0.25);  // these errors do not grow with the tilt, as the weights assume
      CHECK(calibration.markers[0].sigma_m == 0);
      CHECK(calibration.markers[0].T_board_marker.isApprox(Eigen::Isometry3d::Identity(), 1e-15));
      CHECK(calibration.residual_px == doctest::Approx(0.2).epsilon(0.5).scale(0));
      squares += error.sigmas * error.sigmas / kSeeds;
    }
    // The worst of eight numbers of 3 degrees of freedom: about 1.5 standard deviations (the roots of the traces).
    CHECK(std::sqrt(squares) > 0.7);
    CHECK(std::sqrt(squares) < 2.5);
  }
}

TEST_CASE("the board's frame is that of the first marker that is named, whichever it is") {
  const Trajectory motion = turning(3);
  BoardCalibrator by_top = calibrator({4, 1, 2, 3, 5});
  NoisyCube noisy(3);
  for (double s = 0; s < 12; s += 0.02) by_top.add(noisy.poses(motion(s), 0));
  const BoardCalibration calibration = by_top.solve();
  const Board board = cube();
  CHECK(calibration.markers[0].T_board_marker.isApprox(Eigen::Isometry3d::Identity(), 1e-15));
  const Eigen::Isometry3d T_4_1 = board.markers[3].T_board_marker.inverse();
  CHECK(pose_error(calibration.markers[1].T_board_marker, T_4_1).translation_mm < 0.15);
  CHECK(pose_error(calibration.markers[1].T_board_marker, T_4_1).rotation_deg < 0.2);
}

TEST_CASE("markers that were never tracked are named, those that were tracked alone are not") {
  BoardCalibrator calibrator = ::calibrator({8, 1, 3, 9});
  CHECK(calibrator.never_tracked() == std::vector<MarkerId>{8, 1, 3, 9});
  NoisyCube noisy(1);
  auto poses = noisy.poses(turning(1)(0), 0);
  REQUIRE(!poses.empty());
  poses.erase(poses.begin() + 1, poses.end());
  poses[0].id = 1;
  calibrator.add(poses);
  CHECK(calibrator.never_tracked() == std::vector<MarkerId>{8, 3, 9});
  poses[0].id = 3;
  poses[0].quality.state = TrackingState::converging;
  calibrator.add(poses);
  CHECK(calibrator.never_tracked() == std::vector<MarkerId>{8, 3, 9});
}

TEST_CASE("what does not determine a board is refused in a sentence that says what to do") {
  CHECK(message_of([] { calibrator({1}); }) == "board: needs two markers or more");
  CHECK(message_of([] { calibrator({1, 2, 1}); }) == "board: marker 1 is there twice");
  CHECK(message_of([] { BoardCalibrator({1, 2}, 0, 500); }) == "board calibrator: length is 0");
  CHECK(message_of([] { BoardCalibrator({1, 2}, 0.1, std::nan("")); }) == "board calibrator: focal_length is nan");
  const Trajectory motion = turning(1);
  NoisyCube noisy(1);
  const auto all = [&](double s) { return noisy.poses(motion(s), 0); };
  const auto without = [&](double s, const std::vector<MarkerId>& ids) {
    auto poses = all(s);
    std::erase_if(poses, [&](const PoseEstimate& pose) { return std::ranges::count(ids, pose.id) > 0; });
    return poses;
  };
  CHECK(refused(calibrator(), all) == "accepted");
  CHECK(refused(calibrator(), [&](double s) { return without(s, {4}); }) ==
        "marker 4 was never tracked together with another one: show them side by side for longer");
  // 2 and 4 are seen together, and 1 and 5, but none of one pair with one of the other.
  CHECK(refused(calibrator({1, 5, 2, 4}),
                [&](double s) {
                  return std::fmod(s, 0.04) < 0.02 ? without(s, {1, 5, 3}) : without(s, {2, 4, 3});
                }) ==
        "markers 2, 4 were not tracked together with marker 1, or one that was, at 20 places: show them side by side "
        "for longer");
  CHECK(refused(calibrator(), [at_rest = all(4)](double) { return at_rest; }) ==
        "two of the markers or more were tracked together at only 1 places, of the 20 that are needed: move them "
        "longer");
  CHECK(refused(calibrator(), [&](double s) {
          auto poses = all(s);
          for (PoseEstimate& pose : poses) pose.quality.state = TrackingState::converging;
          return poses;
        }).starts_with("two of the markers or more were tracked together at only 0 places"));
  // Moved sideways and hardly turned.
  const Trajectory sideways =
      trajectory::handheld({.T_centre = facing_pose({0, 0, 2}, {0.7, 0.7, 0}), .amplitude_rad = {0.02, 0.02, 0.02}});
  std::string by_turning = refused(calibrator({1, 2}), [&](double s) { return noisy.poses(sideways(s), 0); });
  CHECK_MESSAGE(by_turning.find("was seen together with others from one side only") != std::string::npos, by_turning);
  CHECK_MESSAGE(by_turning.ends_with("turn the body by 10 deg or more"), by_turning);
}
