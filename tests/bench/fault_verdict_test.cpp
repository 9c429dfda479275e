#include "../../bench/fault_verdict.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

using namespace evmarker;

namespace {

// Gives poses of a marker at rest to a verdict.
struct Judged {
  bench::Situation situation{{{640, 480}, 533, 533, 319.5, 239.5}, {}, {}};
  bench::FaultVerdict verdict;

  Judged() {
    situation.scene.markers.push_back(bench::detail::marker(3, 0.1, trajectory::still(facing_pose({0, 0, 0.6}))));
  }

  void add(Timestamp t, double off_m, TrackingState state = TrackingState::tracking,
           LossReason reason = LossReason::none) {
    constexpr Timestamp kClockAhead_us = 500;
    PoseEstimate pose;
    pose.t = t + kClockAhead_us;
    pose.T_camera_marker = situation.truth(0, t);
    pose.T_camera_marker.translation().x() += off_m;
    pose.quality.state = state;
    pose.quality.loss_reason = reason;
    verdict.add(situation, pose, kClockAhead_us);
  }
};

}  // namespace

TEST_CASE("a verdict on faults counts wrong poses and losses, and the time until the marker is tracked for good") {
  const std::vector<Timestamp> moments{10000, 50000};
  Judged judged;
  judged.verdict.begin_recording();
  judged.add(9000, 0.001);
  judged.add(12000, 0.06);  // wrong until the next pose
  judged.add(13000, 0.02);
  judged.add(14000, 0.08, TrackingState::converging);
  judged.add(15000, 0.08, TrackingState::lost, LossReason::hidden);
  judged.add(23000, 0.002);
  judged.add(55000, 0.003);
  judged.verdict.end_recording(moments, 1000);
  CHECK(judged.verdict.tracking() == 5);
  CHECK(judged.verdict.wrong() == 1);
  CHECK(judged.verdict.longest_wrong_ms() == doctest::Approx(1));
  CHECK(judged.verdict.worst().translation_mm == doctest::Approx(60));
  CHECK(judged.verdict.losses() == "1 hidden");
  CHECK(judged.verdict.settled_ms() == doctest::Approx(23 - 11));

  judged.verdict.begin_recording();
  judged.add(20000, 0);
  judged.add(51000, 0, TrackingState::lost, LossReason::hidden);
  judged.add(51000, 0, TrackingState::lost, LossReason::inconsistent);
  judged.verdict.end_recording(moments, 1000);
  CHECK(judged.verdict.losses() == "2 hidden, 1 inconsistent");
  CHECK(std::isinf(judged.verdict.settled_ms()));
}
