#include "evmarker/io/pose_reader.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <future>
#include <limits>
#include <numbers>

#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

template <typename Read>
std::string pose_error_in(Read&& read, const std::string& text) {
  const TemporaryFolder folder;
  const auto path = write_file(folder / "p", text);
  return error_of([&] { read(path); });
}

const std::string kColumns =
    "t_us,marker_id,state,tx,ty,tz,qx,qy,qz,qw,matched,residual_px,backtrack_px,backtrack_rad\n";

}  // namespace

TEST_CASE("read_tum: comments, blanks and exact times") {
  const TemporaryFolder folder;
  const auto poses = read_tum(
      write_file(folder / "a.tum",
                 "# t tx ty tz qx qy qz qw\n\n1.000001 1 2 3 0 0 0 1\n 2.5  -1e-3 0 0  0 0 0.70710678 0.70710678\n"));
  REQUIRE(poses.size() == 2);
  CHECK(poses[0].t == 1000001);
  CHECK(poses[0].T_camera_marker.translation() == Eigen::Vector3d(1, 2, 3));
  CHECK(poses[1].t == 2500000);
  const Eigen::Vector3d turned = poses[1].T_camera_marker.linear() * Eigen::Vector3d::UnitX();
  CHECK((turned - Eigen::Vector3d::UnitY()).norm() < 1e-7);
}

TEST_CASE("read_tum: malformed lines are reported with their number") {
  CHECK(contains(pose_error_in(read_tum, "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1\n"), "p: line 2: has 7 numbers"));
  CHECK(contains(pose_error_in(read_tum, "# c\nx 0 0 0 0 0 0 1\n"), "line 2: t is 'x'"));
  CHECK(contains(pose_error_in(read_tum, "1 0 zero 0 0 0 0 1\n"), "line 1: ty is 'zero'"));
  CHECK(contains(pose_error_in(read_tum, "1 0 0 nan 0 0 0 1\n"), "tz is 'nan'"));
  CHECK(contains(pose_error_in(read_tum, "1 0 0 0 0 0 0 0\n"), "quaternion has length 0"));
  CHECK(contains(pose_error_in(read_tum, "1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"), "line 2: t is '1', not after"));
  CHECK(contains(error_of([] { read_tum("/no/such.tum"); }), "/no/such.tum: cannot open"));
}

TEST_CASE("read_pose_csv: columns are found by name, optional ones may be missing") {
  const TemporaryFolder folder;
  const auto poses = read_pose_csv(
      write_file(folder / "a.csv", "marker_id,t_us,qw,qx,qy,qz,tx,ty,tz,note\n5,77,1,0,0,0,1,2,3,hello\n"));
  REQUIRE(poses.size() == 1);
  CHECK(poses[0].id == 5);
  CHECK(poses[0].t == 77);
  CHECK(poses[0].T_camera_marker.translation() == Eigen::Vector3d(1, 2, 3));
  CHECK(poses[0].T_camera_marker.linear() == Eigen::Matrix3d::Identity());
  CHECK(poses[0].quality.state == TrackingState::tracking);
  CHECK(std::isnan(poses[0].quality.backtrack_px));
  CHECK(poses[0].quality.health == 0);
  CHECK(poses[0].quality.loss_reason == LossReason::none);
}

TEST_CASE("read_pose_csv: a table is read with and without health and loss reason") {
  const TemporaryFolder folder;
  const std::string row = "1,2,lost,0,0,1,0,0,0,1,5,0.5,3,0.25";
  const auto before = read_pose_csv(write_file(folder / "before.csv", kColumns + row + "\n"));
  REQUIRE(before.size() == 1);
  CHECK(before[0].quality.state == TrackingState::lost);
  CHECK(before[0].quality.backtrack_rad == 0.25);
  CHECK(before[0].quality.health == 0);
  CHECK(before[0].quality.loss_reason == LossReason::none);
  const std::string columns = std::string(kPoseCsvHeader) + "\n";
  const auto with = read_pose_csv(write_file(folder / "with.csv", columns + row + ",0.125,left_image\n"));
  REQUIRE(with.size() == 1);
  CHECK(with[0].quality.backtrack_rad == 0.25);
  CHECK(with[0].quality.health == 0.125);
  CHECK(with[0].quality.loss_reason == LossReason::left_image);
  CHECK(contains(pose_error_in(read_pose_csv, columns + row + ",0.125,tired\n"), "line 2: loss_reason is 'tired'"));
  CHECK(contains(pose_error_in(read_pose_csv, columns + row + ",well,hidden\n"), "line 2: health is 'well'"));
}

TEST_CASE("read_pose_csv: malformed lines are reported with their number") {
  CHECK(contains(pose_error_in(read_pose_csv, ""), "empty"));
  CHECK(contains(pose_error_in(read_pose_csv, "t_us,tx\n"), "line 1: no column 'marker_id'"));
  CHECK(contains(pose_error_in(read_pose_csv, kColumns + "1,2,tracking,0,0,0,0,0,0,1,5,0.5,nan\n"),
                 "line 2: has 13 columns, not 14"));
  CHECK(contains(pose_error_in(read_pose_csv, kColumns + "1,2,flying,0,0,0,0,0,0,1,5,0.5,nan,nan\n"),
                 "line 2: state is 'flying'"));
  CHECK(contains(pose_error_in(read_pose_csv, kColumns + "1.5,2,tracking,0,0,0,0,0,0,1,5,0.5,nan,nan\n"),
                 "t_us is '1.5'"));
  CHECK(contains(pose_error_in(read_pose_csv, kColumns + "1,2,tracking,0,0,0,0,0,0,1,5,0.5,nan,?\n"),
                 "backtrack_rad is '?'"));
}

TEST_CASE("Trajectory: linear and along the shortest arc, nothing outside the samples") {
  TimedPose a{.t = 1000}, b{.t = 3000};
  a.T_camera_marker.translation() = Eigen::Vector3d(0, 0, 1);
  b.T_camera_marker = Eigen::Translation3d(1, 0, 3) * Eigen::AngleAxisd(1.2, Eigen::Vector3d(1, 2, 2) / 3);
  const Trajectory trajectory({a, b});
  CHECK_FALSE(trajectory.at(999));
  CHECK_FALSE(trajectory.at(3001));
  CHECK(trajectory.at(1000)->isApprox(a.T_camera_marker));
  CHECK(trajectory.at(3000)->isApprox(b.T_camera_marker));
  const Eigen::Isometry3d quarter =
      Eigen::Translation3d(0.25, 0, 1.5) * Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 2) / 3);
  CHECK((trajectory.at(1500)->matrix() - quarter.matrix()).norm() < 1e-12);
  CHECK_FALSE(Trajectory().at(0));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   Trajectory({b, a});
                 }),
                 "pose 1 at 1000 us does not follow 3000"));
}

TEST_CASE("Trajectory: rotation beyond 180 degrees is interpolated along the shorter arc") {
  TimedPose a{.t = 0}, b{.t = 100};
  a.T_camera_marker.linear() = Eigen::AngleAxisd(3.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  b.T_camera_marker.linear() = Eigen::AngleAxisd(-3.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d half = Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  CHECK((Trajectory({a, b}).at(50)->linear() - half).norm() < 1e-12);
}

TEST_CASE("Trajectory: any two times can be interpolated") {
  TimedPose a{.t = std::numeric_limits<Timestamp>::min()}, b{.t = std::numeric_limits<Timestamp>::max()};
  b.T_camera_marker.translation() = Eigen::Vector3d(0, 0, 4);
  const Trajectory trajectory({a, b});
  CHECK(trajectory.at(0)->translation().z() == doctest::Approx(2));
  CHECK(trajectory.at(a.t / 2)->translation().z() == doctest::Approx(1));
}

TEST_CASE("GroundTruth: a FIFO is read once") {
  const TemporaryFolder folder;
  const std::string tum = "# truth\n1 0 0 1 0 0 0 1\n2 0 0 3 0 0 0 1\n";
  const std::string table = kColumns + "0,3,tracking,0,0,1,0,0,0,1,0,0,nan,nan\n";
  for (const std::string& text : {tum, table}) {
    Fifo fifo(folder / "fifo", text);
    auto end = std::async(std::launch::async, [&] { fifo.end(); });
    const GroundTruth truth = GroundTruth::read(folder / "fifo");
    CHECK(truth.at(3, text == tum ? 1000000 : 0)->translation().z() == 1);
    end.get();
    std::filesystem::remove(folder / "fifo");
  }
}

TEST_CASE("GroundTruth: TUM applies to any marker, a table to each of its markers") {
  const TemporaryFolder folder;
  const auto tum = GroundTruth::read(write_file(folder / "a.tum", "# truth\n1 0 0 1 0 0 0 1\n2 0 0 3 0 0 0 1\n"));
  CHECK(tum.ids().empty());
  CHECK(tum.at(17, 1500000)->translation().z() == doctest::Approx(2));
  CHECK_FALSE(tum.at(17, 2500000));

  const auto table = GroundTruth::read(write_file(
      folder / "a.csv", kColumns + "0,3,tracking,0,0,1,0,0,0,1,0,0,nan,nan\n0,4,tracking,0,0,5,0,0,0,1,0,0,nan,nan\n"
                                   "10,3,tracking,0,0,2,0,0,0,1,0,0,nan,nan\n10,4,lost,9,9,9,0,0,0,1,0,0,nan,nan\n"
                                   "20,4,tracking,0,0,7,0,0,0,1,0,0,nan,nan\n"));
  CHECK(table.ids() == std::vector<MarkerId>{3, 4});
  CHECK(table.at(3, 5)->translation().z() == doctest::Approx(1.5));
  CHECK(table.at(4, 10)->translation().z() == doctest::Approx(6));
  CHECK_FALSE(table.at(3, 11));
  CHECK_FALSE(table.at(5, 5));

  CHECK(contains(pose_error_in(GroundTruth::read, ""), "no poses"));
  CHECK(contains(pose_error_in(GroundTruth::read, "# nothing\n"), "no poses"));
  CHECK(contains(pose_error_in(GroundTruth::read, kColumns), "no poses"));
  CHECK(contains(pose_error_in(GroundTruth::read, kColumns + "5,3,tracking,0,0,1,0,0,0,1,0,0,nan,nan\n"
                                                             "4,3,tracking,0,0,1,0,0,0,1,0,0,nan,nan\n"),
                 "marker 3: trajectory: pose 1 at 4 us"));
}
