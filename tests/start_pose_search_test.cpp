#include "evmarker/start_pose_search.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "evmarker/accuracy.hpp"
#include "evmarker/marker_tracker.hpp"
#include "simulated.hpp"

using namespace evmarker;

namespace {

const MarkerModel kModel = make_code_marker(simulated::kMarkerLength, simulated::code());

// Off by so much to one side, in depth and about some axis.
Eigen::Isometry3d off(Eigen::Isometry3d T, std::mt19937& random, double sideways_m, double depth_m, double angle_deg) {
  std::normal_distribution<double> normal;
  const double direction = std::uniform_real_distribution<double>(0, 2 * std::numbers::pi)(random);
  T.translation() += Eigen::Vector3d(sideways_m * std::cos(direction), sideways_m * std::sin(direction), depth_m);
  const Eigen::Vector3d axis = Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
  T.linear() = so3_exp(angle_deg / 180 * std::numbers::pi * axis) * T.linear();
  return T;
}

}  // namespace

TEST_CASE("starts 15 mm to a side, 45 mm in depth and 5 degrees off at 0.6 m are captured within 50 ms") {
  int runs = 0, captured = 0, captured_without = 0;
  for (std::uint64_t seed = 900; seed < 920; ++seed) {
    const Trajectory motion = simulated::near_motion(seed);
    const auto events = simulated::filtered(simulated::near_events(motion, 0.05, seed));
    REQUIRE(events.size() > 5000);
    std::mt19937 random(static_cast<unsigned>(seed));
    for (int run = 0; run < 5; ++run) {
      const Eigen::Isometry3d start = off(motion(0), random, 0.015, run % 2 == 0 ? 0.045 : -0.045, 5);
      const auto locked = [&](const MarkerTrackerSettings<>& settings) {
        MarkerTracker tracker(simulated::camera, kModel, start, settings);
        for (const Event& event : events) tracker.push(event);
        const PoseError error =
            pose_error(tracker.T_camera_marker(), motion(1e-6 * static_cast<double>(tracker.estimate().t)));
        return tracker.state() == TrackingState::tracking && error.translation_mm < 2 && error.rotation_deg < 2;
      };
      ++runs;
      captured += locked({});
      captured_without += locked({.start_search = std::nullopt});
    }
  }
  MESSAGE("captured " << captured << " of " << runs << ", without looking for the marker first " << captured_without);
  CHECK(runs == 100);
  CHECK(captured >= 95);
  CHECK(captured_without < 50);  // or the starts were too easy
}

TEST_CASE("events that fit no pose leave the rough one, and old ones are forgotten") {
  const Eigen::Isometry3d T = facing_pose({0, 0, 0.6});
  const auto push_noise = [&](Capture& capture, Timestamp step_us, int count) {
    std::mt19937 random(5);
    std::uniform_int_distribution<int> place(250, 390);
    for (int i = 0; i < count; ++i) {
      const Event event{static_cast<std::uint16_t>(place(random)), static_cast<std::uint16_t>(place(random) - 80), 1,
                        step_us * i};
      if (capture.push(event, Eigen::Vector2d(event.x - 319.5, event.y - 239.5))) return true;
    }
    return false;
  };
  Capture quick(kModel, 533, T, {});
  REQUIRE(push_noise(quick, 1, 10000));
  CHECK(quick.solve().matrix() == T.matrix());
  CHECK(quick.events().size() > 500);
  Capture original(kModel, 533, T, {}), copy = original;  // needs as many events
  REQUIRE(push_noise(copy, 1, 10000));
  CHECK(copy.events().size() == quick.events().size());
  Capture slow(kModel, 533, T, {});
  CHECK_FALSE(push_noise(slow, 1000, 10000));
  CHECK(slow.events().size() <= 201);
}
