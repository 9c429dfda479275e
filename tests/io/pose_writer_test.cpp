#include "evmarker/io/pose_writer.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "evmarker/io/pose_reader.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

Eigen::Isometry3d make_pose(double x, double y, double z, const Eigen::AngleAxisd& rotation) {
  return Eigen::Translation3d(x, y, z) * rotation;
}

const Eigen::AngleAxisd kQuarterTurn(std::numbers::pi / 2, Eigen::Vector3d::UnitZ());

std::vector<PoseEstimate> random_poses(std::size_t count) {
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  std::vector<PoseEstimate> poses(count);
  for (std::size_t i = 0; i < count; ++i) {
    PoseEstimate& pose = poses[i];
    pose.id = static_cast<MarkerId>(i % 3);
    pose.t = static_cast<Timestamp>(i) * 1234567;
    const Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
    pose.T_camera_marker = Eigen::Translation3d(normal(random), normal(random), normal(random)) * q.normalized();
    pose.quality = {.state = static_cast<TrackingState>(i % 3),
                    .health = std::abs(normal(random)),
                    .loss_reason = static_cast<LossReason>(i % kLossReasons),
                    .matched = static_cast<int>(i),
                    .offered = 0,
                    .residual_px = normal(random),
                    .backtrack_px = normal(random),
                    .backtrack_rad = normal(random)};
  }
  return poses;
}

}  // namespace

TEST_CASE("PoseCsvWriter: the exact text of a table") {
  const TemporaryFolder folder;
  PoseCsvWriter writer(folder / "poses.csv");
  PoseEstimate pose;
  pose.id = 7;
  pose.t = 123456;
  pose.T_camera_marker.translation() = Eigen::Vector3d(0.1, -0.25, 1e-7);
  pose.quality.matched = 42;
  pose.quality.residual_px = 0.5;
  pose.quality.health = 0.75;
  writer.write(pose);
  pose.quality.state = TrackingState::lost;
  pose.quality.loss_reason = LossReason::hidden;
  pose.quality.backtrack_px = 3;
  pose.quality.backtrack_rad = -std::numeric_limits<double>::quiet_NaN();
  writer.write(pose);
  CHECK(writer.poses_written() == 2);
  CHECK_FALSE(std::filesystem::exists(folder / "poses.csv"));
  writer.close();
  CHECK(read_file(folder / "poses.csv") ==
        "t_us,marker_id,state,tx,ty,tz,qx,qy,qz,qw,matched,residual_px,backtrack_px,backtrack_rad,health,loss_reason\n"
        "123456,7,converging,0.1,-0.25,1e-07,0,0,0,1,42,0.5,nan,nan,0.75,none\n"
        "123456,7,lost,0.1,-0.25,1e-07,0,0,0,1,42,0.5,3,nan,0.75,hidden\n");
  CHECK(folder.files() == 1);
}

TEST_CASE("Pose writers: poses that are not T_camera_marker are named, and not read as such") {
  const TemporaryFolder folder;
  PoseCsvWriter table(folder / "poses.csv", PoseColumns::pose, "T_marker_camera");
  table.write(PoseEstimate{});
  table.close();
  CHECK(read_file(folder / "poses.csv").starts_with(std::string(kPoseCsvHeader) + ",transform\n"));
  CHECK(read_file(folder / "poses.csv").ends_with(",none,T_marker_camera\n"));
  TumWriter tum(folder / "poses.tum", "T_1_2");
  tum.write(PoseEstimate{});
  tum.close();
  CHECK(read_file(folder / "poses.tum") == "# T_1_2\n0.000000 0 0 0 0 0 0 1\n");
  CHECK(contains(error_of([&] { read_pose_csv(folder / "poses.csv"); }), "line 2: its poses are T_marker_camera"));
  CHECK(contains(error_of([&] { read_tum(folder / "poses.tum"); }), "line 1: its poses are T_1_2"));
  for (const char* file : {"poses.csv", "poses.tum"})
    CHECK(contains(error_of([&] { GroundTruth::read(folder / file); }), "not T_camera_marker"));
}

TEST_CASE("PoseCsvWriter: numbers read back exactly, the quaternion with w >= 0") {
  const TemporaryFolder folder;
  const auto poses = random_poses(500);
  PoseCsvWriter writer(folder / "poses.csv");
  for (const PoseEstimate& pose : poses) writer.write(pose);
  writer.close();
  const auto read = read_pose_csv(folder / "poses.csv");
  REQUIRE(read.size() == poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    CHECK(read[i].t == poses[i].t);
    CHECK(read[i].id == poses[i].id);
    CHECK(read[i].quality.state == poses[i].quality.state);
    CHECK(read[i].quality.matched == poses[i].quality.matched);
    CHECK(read[i].quality.residual_px == poses[i].quality.residual_px);
    CHECK(read[i].quality.backtrack_px == poses[i].quality.backtrack_px);
    CHECK(read[i].quality.backtrack_rad == poses[i].quality.backtrack_rad);
    CHECK(read[i].quality.health == poses[i].quality.health);
    CHECK(read[i].quality.loss_reason == poses[i].quality.loss_reason);
    CHECK(read[i].T_camera_marker.translation() == poses[i].T_camera_marker.translation());
    CHECK((read[i].T_camera_marker.linear() - poses[i].T_camera_marker.linear()).norm() < 1e-14);
  }
}

TEST_CASE("Pose writers: destroyed without close, they leave no file") {
  const TemporaryFolder folder;
  {
    PoseCsvWriter table(folder / "poses.csv");
    TumWriter tum(folder / "poses.tum");
    table.write(PoseEstimate{});
    tum.write(PoseEstimate{});
    CHECK(folder.files() == 2);
  }
  CHECK(folder.files() == 0);
  CHECK(contains(error_of([&] { PoseCsvWriter(folder / "no/poses.csv"); }), "cannot create"));
}

TEST_CASE("TumWriter: times exact to the microsecond, one marker a file") {
  const TemporaryFolder folder;
  TumWriter writer(folder / "a.tum");
  writer.write(-1500000, Eigen::Isometry3d::Identity());
  writer.write(7, Eigen::Isometry3d::Identity());
  writer.write(1700000000123456, make_pose(1, 2, 3, kQuarterTurn));
  PoseEstimate pose;
  pose.id = 3;
  pose.t = 1700000000123457;
  writer.write(pose);
  pose.id = 4;
  CHECK(contains(error_of<std::invalid_argument>([&] { writer.write(pose); }),
                 "marker_id is 4, but the file is of marker 3"));
  writer.close();
  const std::string text = read_file(folder / "a.tum");
  CHECK(text.starts_with(
      "-1.500000 0 0 0 0 0 0 1\n0.000007 0 0 0 0 0 0 1\n1700000000.123456 1 2 3 0 0 0.70710678118654"));
  const auto poses = read_tum(folder / "a.tum");
  REQUIRE(poses.size() == 4);
  CHECK(poses[0].t == -1500000);
  CHECK(poses[2].t == 1700000000123456);
  CHECK(poses[3].t == 1700000000123457);
  CHECK((poses[2].T_camera_marker.matrix() - make_pose(1, 2, 3, kQuarterTurn).matrix()).norm() < 1e-14);
}
