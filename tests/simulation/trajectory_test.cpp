#include "evmarker/simulation/trajectory.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

/// Largest speed of the centre [m/s] and turn rate [rad/s] and largest change of the speed within a step.
struct Motion {
  double speed = 0, turn_rate = 0, jump = 0;
};

Motion observe(const Trajectory& trajectory, double seconds, double step = 1e-3) {
  Motion motion;
  Eigen::Vector3d last_velocity = (trajectory(step).translation() - trajectory(0).translation()) / step;
  for (int i = 0; i * step < seconds; ++i) {
    const auto a = trajectory(i * step), b = trajectory((i + 1) * step);
    const Eigen::Vector3d velocity = (b.translation() - a.translation()) / step;
    motion.speed = std::max(motion.speed, velocity.norm());
    motion.turn_rate = std::max(motion.turn_rate, geodesic_angle(a.linear(), b.linear()) / step);
    motion.jump = std::max(motion.jump, (velocity - last_velocity).norm());
    last_velocity = velocity;
  }
  return motion;
}

}  // namespace

TEST_CASE("a facing marker turns its z axis to the camera and its y axis up") {
  const auto T = facing_pose({0.1, 0.2, 0.6});
  CHECK(T.linear().determinant() == doctest::Approx(1));
  CHECK((T * Eigen::Vector3d(0, 0, 0.01)).z() == doctest::Approx(0.59));
  CHECK((T * Eigen::Vector3d(0, 0.01, 0)).y() == doctest::Approx(0.19));
  CHECK((T * Eigen::Vector3d(0.01, 0, 0)).x() == doctest::Approx(0.11));
}

TEST_CASE("still stays, linear and spin keep their rates") {
  const auto start = facing_pose({0, 0, 1}, {0.2, 0, 0});
  CHECK(trajectory::still(start)(5).isApprox(start));

  const auto moved = trajectory::linear(start, {1, 2, 3}, {0, 0, 0.5})(0.1);
  CHECK((moved.translation() - start.translation()).isApprox(Eigen::Vector3d(0.1, 0.2, 0.3)));
  CHECK((moved.linear() * start.linear().transpose()).isApprox(so3_exp({0, 0, 0.05})));

  const auto spun = trajectory::spin(start, {0, 0, 2}, 3.0);
  CHECK(spun(0).isApprox(start));
  CHECK(geodesic_angle(spun(0.1).linear(), start.linear()) == doctest::Approx(0.3));
  CHECK(spun(0.1).translation().isApprox(start.translation()));
}

TEST_CASE("hand-held sway moves on every axis, stays within its amplitudes and is smooth") {
  const trajectory::Handheld sway{.amplitude_m = {0.05, 0.04, 0.03}, .amplitude_rad = {0.2, 0.3, 0.4}};
  const auto trajectory = trajectory::handheld(sway);
  Eigen::Vector3d reach = Eigen::Vector3d::Zero(), turn = Eigen::Vector3d::Zero();
  for (int i = 0; i < 10000; ++i) {
    const auto T = trajectory(i * 1e-3);
    reach = reach.cwiseMax((T.translation() - sway.T_centre.translation()).cwiseAbs());
    turn = turn.cwiseMax(so3_log(T.linear() * sway.T_centre.linear().transpose()).cwiseAbs());
  }
  for (int axis = 0; axis < 3; ++axis) {
    CHECK(reach(axis) <= sway.amplitude_m(axis) + 1e-12);
    CHECK(reach(axis) > 0.6 * sway.amplitude_m(axis));
    CHECK(turn(axis) <= sway.amplitude_rad(axis) + 1e-9);
    CHECK(turn(axis) > 0.6 * sway.amplitude_rad(axis));
  }
  const auto motion = observe(trajectory, 10);
  CHECK(motion.speed > 0.2);  // 5 cm at 1 Hz
  CHECK(motion.speed < 1.5);
  CHECK(motion.jump < 0.02);
  CHECK_FALSE(trajectory::handheld({.seed = 2})(0.5).isApprox(trajectory::handheld({.seed = 1})(0.5)));
  CHECK(trajectory::handheld({.seed = 2})(0.5).isApprox(trajectory::handheld({.seed = 2})(0.5)));
}

TEST_CASE("stop and go rests, then goes on, with a continuous velocity") {
  const auto base = trajectory::linear(facing_pose({0, 0, 1}), {1, 0, 0});
  const auto trajectory = trajectory::stop_and_go(base, 0.4, 0.2);
  const auto x = [&](double s) { return trajectory(s).translation().x(); };
  CHECK(x(0) == doctest::Approx(0));
  CHECK(x(0.4) == doctest::Approx(0.4));
  CHECK(x(0.5) == x(0.45));  // rests
  CHECK(x(0.6) == doctest::Approx(0.4));
  CHECK(x(0.8) == doctest::Approx(0.6));  // halfway through the second move
  CHECK(x(1.0) == doctest::Approx(0.8));
  const auto motion = observe(trajectory, 3);
  CHECK(motion.speed == doctest::Approx(1.875).epsilon(0.001).scale(0));
  CHECK(motion.jump < 0.03);
}

TEST_CASE("moves and rests may be of different length, and begin again when the list ends") {
  const auto base = trajectory::linear(facing_pose({0, 0, 1}), {1, 0, 0});
  const auto trajectory = trajectory::stop_and_go(base, {{0.4, 0.1}, {0.2, 1.0}});  // a round of 1.7 s: 0.6 m
  const auto x = [&](double s) { return trajectory(s).translation().x(); };
  CHECK(x(0.2) == doctest::Approx(0.2));
  CHECK(x(0.45) == doctest::Approx(0.4));
  CHECK(x(0.6) == doctest::Approx(0.5));  // in the middle of the second move
  CHECK(x(0.8) == doctest::Approx(0.6));
  CHECK(x(1.69) == x(0.8));  // rests for long
  CHECK(x(1.9) == doctest::Approx(0.8));
  CHECK(x(2.4) == doctest::Approx(1.2));
  const auto motion = observe(trajectory, 5);
  CHECK(motion.speed == doctest::Approx(1.875).epsilon(0.001).scale(0));
  CHECK(motion.jump < 0.06);
  const auto even = trajectory::stop_and_go(base, 0.4, 0.2), same = trajectory::stop_and_go(base, {{0.4, 0.2}});
  for (double s = 0; s < 2; s += 0.037) CHECK(even(s).translation().x() == doctest::Approx(same(s).translation().x()));
}

TEST_CASE("motions that make no sense are named") {
  const auto start = facing_pose({0, 0, 1});
  CHECK_THROWS_WITH_AS(trajectory::stop_and_go(trajectory::still(start), 0, 1), "trajectory: move_s is 0",
                       std::invalid_argument);
  CHECK_THROWS_AS(trajectory::stop_and_go({}, 1, 1), std::invalid_argument);
  CHECK_THROWS_WITH_AS(trajectory::stop_and_go(trajectory::still(start), {{1, 1}, {1, -2}}), "trajectory: rest_s is -2",
                       std::invalid_argument);
  CHECK_THROWS_AS(trajectory::stop_and_go(trajectory::still(start), std::vector<trajectory::MoveAndRest>{}),
                  std::invalid_argument);
  CHECK_THROWS_AS(trajectory::spin(start, {0, 0, 0}, 1), std::invalid_argument);
  CHECK_THROWS_AS(trajectory::still(facing_pose({0, 0, std::nan("")})), std::invalid_argument);
  CHECK_THROWS_WITH_AS(trajectory::handheld({.frequency_hz = -1}), "trajectory: frequency_hz is -1",
                       std::invalid_argument);
}
