#include "evmarker/tracking/pose_outbox.hpp"

#include <doctest/doctest.h>

#include <stdexcept>
#include <vector>

using evmarker::PoseEstimate;
using evmarker::PoseOutbox;

namespace {

PoseEstimate pose_at(evmarker::Timestamp t) {
  PoseEstimate pose;
  pose.t = t;
  return pose;
}

}  // namespace

TEST_CASE("poses come in the order of their events, those of one event in order of time") {
  PoseOutbox outbox(4);
  outbox.add(pose_at(50), 2);
  outbox.add(pose_at(70), 0);
  outbox.add(pose_at(40), 2);
  outbox.add(pose_at(60), 1);
  std::vector<evmarker::Timestamp> times;
  outbox.hand_over([&](const PoseEstimate& pose) { times.push_back(pose.t); });
  CHECK(times == std::vector<evmarker::Timestamp>{70, 60, 40, 50});
  CHECK(outbox.empty());
}

TEST_CASE("poses that a callback has refused by an exception do not come again") {
  PoseOutbox outbox(4);
  for (std::size_t i = 0; i < 3; ++i) outbox.add({}, i);
  CHECK_THROWS_AS(outbox.hand_over([](const PoseEstimate&) { throw std::runtime_error("callback"); }),
                  std::runtime_error);
  CHECK(outbox.empty());
}
