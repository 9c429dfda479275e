#include "evmarker/evaluation/accuracy.hpp"

#include <doctest/doctest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <vector>

using namespace evmarker;
using namespace std::chrono_literals;

namespace {

// A pose that is so far off the identity, along and about some axes.
PoseEstimate off_by(double mm, double deg, Timestamp t = 0, TrackingState state = TrackingState::tracking) {
  PoseEstimate pose;
  pose.t = t;
  pose.quality.state = state;
  pose.T_camera_marker.translation() = 1e-3 * mm * Eigen::Vector3d(2, -1, 2) / 3;
  pose.T_camera_marker.linear() =
      Eigen::AngleAxisd(deg * std::numbers::pi / 180, Eigen::Vector3d(1, 2, -2) / 3).toRotationMatrix();
  return pose;
}

const Eigen::Isometry3d kTruth = Eigen::Isometry3d::Identity();
const double kNan = std::numeric_limits<double>::quiet_NaN();

}  // namespace

TEST_CASE("the error of a pose, worked by hand") {
  Eigen::Isometry3d a = Eigen::Isometry3d::Identity(), b = a;
  CHECK(pose_error(a, b).translation_mm == 0);
  CHECK(pose_error(a, b).rotation_deg == 0);
  a.translation() = Eigen::Vector3d(0.1, 0.2, 0.5);
  b.translation() = Eigen::Vector3d(0.103, 0.2, 0.504);
  CHECK(pose_error(a, b).translation_mm == doctest::Approx(5));
  // Quarter turns about x and y: together a third of a turn, not two quarters.
  a.linear() = Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitX()).toRotationMatrix();
  b.linear() = Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitY()).toRotationMatrix();
  CHECK(pose_error(a, b).rotation_deg == doctest::Approx(120));
  b.linear() = Eigen::AngleAxisd(-std::numbers::pi / 2, Eigen::Vector3d::UnitX()).toRotationMatrix();
  CHECK(pose_error(a, b).rotation_deg == doctest::Approx(180));
}

TEST_CASE("mean, median, 95th percentile and maximum") {
  std::vector<double> values(101);
  std::iota(values.rbegin(), values.rend(), 0.0);  // 100 down to 0
  const Spread spread = Spread::of(values);
  CHECK(spread.mean == doctest::Approx(50));
  CHECK(spread.median == 50);
  CHECK(spread.p95 == 95);
  CHECK(spread.max == 100);

  const Spread skewed = Spread::of({1, 1, 1, 97});
  CHECK(skewed.mean == doctest::Approx(25));
  CHECK(skewed.median == 1);
  CHECK(skewed.p95 == 97);
  CHECK(skewed.max == 97);

  const Spread lone = Spread::of({7});
  CHECK(lone.mean == 7);
  CHECK(lone.median == 7);
  CHECK(lone.p95 == 7);
  CHECK(lone.max == 7);

  const Spread none = Spread::of({});
  CHECK(none.mean == 0);
  CHECK(none.median == 0);
  CHECK(none.p95 == 0);
  CHECK(none.max == 0);
}

TEST_CASE("translation and rotation are measured apart, on tracking poses only") {
  AccuracyMeter meter;
  meter.add(off_by(400, 90, 100, TrackingState::converging), kTruth);
  meter.add(off_by(1, 4, 200), kTruth);
  meter.add(off_by(2, 6, 300), kTruth);
  meter.add(off_by(6, 2, 400), kTruth);
  meter.add(off_by(500, 90, 500, TrackingState::lost), kTruth);
  CHECK(meter.poses() == 5);
  CHECK(meter.tracking() == 3);
  CHECK(meter.lost() == 1);
  CHECK(meter.wild() == 0);  // converging and lost poses are nobody's to rely on
  CHECK(meter.first_t() == 100);
  CHECK(meter.translation_mm().mean == doctest::Approx(3));
  CHECK(meter.translation_mm().median == doctest::Approx(2));
  CHECK(meter.translation_mm().max == doctest::Approx(6));
  CHECK(meter.rotation_deg().mean == doctest::Approx(4));
  CHECK(meter.rotation_deg().median == doctest::Approx(4));
  CHECK(meter.rotation_deg().p95 == doctest::Approx(6));
}

TEST_CASE("wild poses are off by more than 50 mm or by more than 20 degrees") {
  AccuracyMeter meter;
  meter.add(off_by(49.9, 19.9), kTruth);
  CHECK(meter.wild() == 0);
  meter.add(off_by(50.1, 0), kTruth);
  CHECK(meter.wild() == 1);
  meter.add(off_by(0, 20.1), kTruth);
  CHECK(meter.wild() == 2);
  meter.add(off_by(60, 30), kTruth);
  CHECK(meter.wild() == 3);  // once, though it is both
  meter.add(off_by(60, 30, 0, TrackingState::converging), kTruth);
  meter.add(off_by(60, 30, 0, TrackingState::lost), kTruth);
  CHECK(meter.wild() == 3);
}

TEST_CASE("a pose that is no number is wild and infinitely wrong") {
  for (const bool rotation : {false, true}) {
    CAPTURE(rotation);
    AccuracyMeter meter;
    PoseEstimate bad = off_by(1, 1);
    (rotation ? bad.T_camera_marker.linear()(0, 0) : bad.T_camera_marker.translation()(0)) = kNan;
    for (int i = 0; i < 20; ++i) meter.add(off_by(i, 1), kTruth);
    meter.add(bad, kTruth);
    CHECK(meter.wild() == 1);
    const Spread spread = rotation ? meter.rotation_deg() : meter.translation_mm();
    CHECK(spread.max == std::numeric_limits<double>::infinity());
    CHECK(spread.median == doctest::Approx(rotation ? 1 : 10));
  }
}

TEST_CASE("the error in units of the stated covariance, worked by hand") {
  PoseEstimate pose = off_by(3, 0);  // (2, -1, 2) mm
  CHECK(std::isnan(nees(pose, kTruth)));
  Vector6d sigma;
  sigma << 1e-3, 1e-3, 2e-3, 0.1, 0.1, 0.1;
  pose.covariance = sigma.cwiseAbs2().asDiagonal();
  CHECK(nees(pose, kTruth) == doctest::Approx((4 + 1 + 1) / 6.0));
  PoseEstimate turned = off_by(0, 9);  // (1, 2, -2) / 3 times 9 deg
  turned.covariance = pose.covariance;
  CHECK(nees(turned, kTruth) == doctest::Approx(std::pow(9 * std::numbers::pi / 180 / 0.1, 2) / 6));
  AccuracyMeter meter;
  for (const PoseEstimate& added : {pose, turned, off_by(3, 0)}) meter.add(added, kTruth);
  CHECK(meter.nees().max == doctest::Approx(1));
  CHECK(meter.nees().mean == doctest::Approx((nees(pose, kTruth) + nees(turned, kTruth)) / 2));  // the third has none
}

TEST_CASE("coverage is the share of whole slots that hold a tracking pose") {
  AccuracyMeter meter(10us);
  meter.add(off_by(1, 1, 1000, TrackingState::converging), kTruth);  // the first pose, in any state, starts the slots
  CHECK(meter.coverage(1040) == 0);
  meter.add(off_by(1, 1, 1010), kTruth);
  meter.add(off_by(1, 1, 1012), kTruth);  // the same slot again
  meter.add(off_by(1, 1, 1019), kTruth);
  CHECK(meter.coverage(1040) == doctest::Approx(0.25));
  meter.add(off_by(1, 1, 1020), kTruth);  // the next one begins here
  CHECK(meter.coverage(1040) == doctest::Approx(0.5));
  meter.add(off_by(1, 1, 1035, TrackingState::lost), kTruth);
  CHECK(meter.coverage(1040) == doctest::Approx(0.5));
  meter.add(off_by(1, 1, 1055), kTruth);  // after the end
  CHECK(meter.coverage(1040) == doctest::Approx(0.5));
  CHECK(meter.coverage(1059) == doctest::Approx(2.0 / 5));  // the sixth is not whole
  CHECK(meter.coverage(1060) == doctest::Approx(3.0 / 6));
}

TEST_CASE("coverage without slots is zero, and full where every slot is held") {
  CHECK(AccuracyMeter().coverage(1000000) == 0);  // no poses
  AccuracyMeter meter;                            // 10 ms
  meter.add(off_by(1, 1, 500000), kTruth);
  CHECK(meter.coverage(0) == 0);  // before the first pose
  CHECK(meter.coverage(500000) == 0);
  CHECK(meter.coverage(509999) == 0);
  CHECK(meter.coverage(510000) == 1);
  for (int i = 1; i < 50; ++i) meter.add(off_by(1, 1, 500000 + 10000 * i), kTruth);
  CHECK(meter.coverage(1000000) == 1);
  CHECK(meter.coverage(1500000) == doctest::Approx(0.5));
}

TEST_CASE("poses out of order count in their slots, those before the first in none") {
  AccuracyMeter meter(10us);
  meter.add(off_by(1, 1, 1020), kTruth);
  meter.add(off_by(1, 1, 1045), kTruth);
  meter.add(off_by(1, 1, 1035), kTruth);
  meter.add(off_by(1, 1, 1030), kTruth);
  CHECK(meter.coverage(1060) == doctest::Approx(3.0 / 4));
  meter.add(off_by(1, 1, 1015), kTruth);
  meter.add(off_by(1, 1, -5), kTruth);
  CHECK(meter.coverage(1060) == doctest::Approx(3.0 / 4));
  CHECK(meter.tracking() == 6);
}

TEST_CASE("slots shorter than a microsecond are refused") {
  CHECK_THROWS_WITH(AccuracyMeter(0us), "accuracy: slot is 0 us");
  CHECK_THROWS_WITH(AccuracyMeter(-5us), "accuracy: slot is -5 us");
  CHECK_NOTHROW(AccuracyMeter(1us));
}
