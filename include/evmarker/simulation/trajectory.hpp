#pragma once
// Known motions of a marker in front of the camera.
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <utility>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simulation/random.hpp"

namespace evmarker {

/// T_camera_marker [m] as a function of time [s].
using Trajectory = std::function<Eigen::Isometry3d(double seconds)>;

/// Pose of a marker that faces the camera upright and is then rotated about its centre.
/// @param position of the marker's centre [m, camera frame]
/// @param rotation vector of that rotation [rad, camera frame]
inline Eigen::Isometry3d facing_pose(const Eigen::Vector3d& position,
                                     const Eigen::Vector3d& rotation = Eigen::Vector3d::Zero()) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  // The camera's y is down and its z forward, the marker's y is up and its z towards the camera.
  const Eigen::Matrix3d R = so3_exp(rotation);
  for (int i = 0; i < 3; ++i) {
    T(i, 0) = R(i, 0);
    T(i, 1) = -R(i, 1);
    T(i, 2) = -R(i, 2);
  }
  set_translation(T, position);
  return T;
}

namespace detail {

// A pose after a translation [m] and a rotation about the marker's centre [rad], both in the camera frame.
inline Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vec6& motion) {
  Eigen::Isometry3d result = T;
  set_translation(result, translation(T) + motion.t);
  result.linear() = product(so3_exp(motion.r), T.linear());
  return result;
}

}  // namespace detail

/// Trajectories. All functions throw std::invalid_argument naming the argument that makes no sense.
namespace trajectory {

namespace detail {

inline constexpr Require require("trajectory");

inline void require_finite(const Eigen::Isometry3d& T) {
  require(is_finite(T), "an element of the pose", std::nan(""));
}

inline void require_finite(const Eigen::Vector3d& v, const char* name) {
  require(is_finite(Vec3(v)), name, v.x() + v.y() + v.z());
}

}  // namespace detail

/// A marker at rest.
inline Trajectory still(const Eigen::Isometry3d& T_camera_marker) {
  detail::require_finite(T_camera_marker);
  return [T_camera_marker](double) { return T_camera_marker; };
}

/// A marker with constant velocity of its centre [m/s] and constant angular velocity [rad/s], both in the camera frame.
inline Trajectory linear(const Eigen::Isometry3d& T_start, const Eigen::Vector3d& velocity_m_per_s,
                         const Eigen::Vector3d& turn_rate_rad_per_s = Eigen::Vector3d::Zero()) {
  detail::require_finite(T_start);
  detail::require_finite(velocity_m_per_s, "velocity_m_per_s");
  detail::require_finite(turn_rate_rad_per_s, "turn_rate_rad_per_s");
  return [=](double seconds) {
    return evmarker::detail::moved(T_start, {seconds * Vec3(velocity_m_per_s), seconds * Vec3(turn_rate_rad_per_s)});
  };
}

/// A marker that rotates about its centre, around an axis of any length in the camera frame.
inline Trajectory spin(const Eigen::Isometry3d& T_start, const Eigen::Vector3d& axis, double rad_per_s) {
  const double length = norm(Vec3(axis));
  detail::require(std::isfinite(length) && length > 0, "length of the axis", length);
  return linear(T_start, Vec3(), rad_per_s * (Vec3(axis) / length));
}

/// Parameters of `handheld`: the sway of a hand that holds the marker or the camera.
struct Handheld {
  Eigen::Isometry3d T_centre = facing_pose({0, 0, 0.6});
  Eigen::Vector3d amplitude_m{0.05, 0.04, 0.05};    ///< largest excursion of the centre, per camera axis
  Eigen::Vector3d amplitude_rad{0.25, 0.25, 0.35};  ///< largest element of the rotation vector, per camera axis
  double frequency_hz = 1.0;                        ///< of the slowest of the three sines on each axis
  std::uint64_t seed = 1;                           ///< determines the phases and the exact frequencies
};

/// Hand-held sway: along and about each camera axis the sum of three sines without a common period.
inline Trajectory handheld(const Handheld& sway = {}) {
  detail::require_finite(sway.T_centre);
  detail::require_finite(sway.amplitude_m, "amplitude_m");
  detail::require_finite(sway.amplitude_rad, "amplitude_rad");
  detail::require(std::isfinite(sway.frequency_hz) && sway.frequency_hz >= 0, "frequency_hz", sway.frequency_hz);

  struct Sine {
    double weight, rad_per_s, phase;
  };
  constexpr std::array<double, 3> kRatios{1.0, std::numbers::phi, std::numbers::phi * std::numbers::sqrt2};
  constexpr std::array<double, 3> kWeights{0.6, 0.28, 0.12};
  Random random(sway.seed);
  std::array<std::array<Sine, 3>, 6> axes{};
  for (auto& axis : axes)
    for (std::size_t i = 0; i < axis.size(); ++i) {
      const double detune = random.uniform(0.93, 1.07);  // so that no two axes have the same frequencies
      axis[i] = {kWeights[i], 2 * std::numbers::pi * sway.frequency_hz * kRatios[i] * detune,
                 random.uniform(0, 2 * std::numbers::pi)};
    }
  return [sway, axes](double seconds) {
    std::array<double, 6> wave{};
    for (std::size_t axis = 0; axis < axes.size(); ++axis)
      for (const Sine& sine : axes[axis]) wave[axis] += sine.weight * std::sin(sine.rad_per_s * seconds + sine.phase);
    const Vec3 m = sway.amplitude_m, rad = sway.amplitude_rad;
    return evmarker::detail::moved(sway.T_centre, {{m.x * wave[0], m.y * wave[1], m.z * wave[2]},
                                                   {rad.x * wave[3], rad.y * wave[4], rad.z * wave[5]}});
  };
}

namespace detail {

// A motion from 0 to 1 with velocity and acceleration 0 at both ends and a largest velocity of 1.875.
inline double ease(double u) { return u * u * u * (10 + u * (6 * u - 15)); }

}  // namespace detail

/// A move and the rest after it.
struct MoveAndRest {
  double move_s;  ///< positive
  double rest_s;  ///< 0 or more
};

/// Interrupts a motion by rests: it runs for `move_s` and rests for `rest_s` of every leg in turn, again and again. It
/// starts and stops smoothly: velocity and acceleration are continuous. In the middle of a move it runs 1.875 times as
/// fast as without rests.
inline Trajectory stop_and_go(Trajectory base, std::vector<MoveAndRest> legs) {
  detail::require(static_cast<bool>(base), "presence of the base motion", 0);
  detail::require(!legs.empty(), "number of moves", 0);
  MoveAndRest round{0, 0};  // sums over all legs
  for (const MoveAndRest& leg : legs) {
    detail::require(std::isfinite(leg.move_s) && leg.move_s > 0, "move_s", leg.move_s);
    detail::require(std::isfinite(leg.rest_s) && leg.rest_s >= 0, "rest_s", leg.rest_s);
    round.move_s += leg.move_s;
    round.rest_s += leg.rest_s;
  }
  return [base = std::move(base), legs = std::move(legs), round](double seconds) {
    const double rounds = std::floor(seconds / (round.move_s + round.rest_s));
    double left_s = seconds - rounds * (round.move_s + round.rest_s), moved_s = rounds * round.move_s;
    for (const MoveAndRest& leg : legs) {
      moved_s += leg.move_s * detail::ease(std::fmin(left_s / leg.move_s, 1.0));
      left_s -= leg.move_s + leg.rest_s;
      if (left_s <= 0) break;
    }
    return base(moved_s);
  };
}

/// Interrupts a motion by rests, with moves of equal length and rests of equal length.
inline Trajectory stop_and_go(Trajectory base, double move_s, double rest_s) {
  detail::require(static_cast<bool>(base), "presence of the base motion", 0);
  detail::require(std::isfinite(move_s) && move_s > 0, "move_s", move_s);
  detail::require(std::isfinite(rest_s) && rest_s >= 0, "rest_s", rest_s);
  return [base = std::move(base), move_s, rest_s](double seconds) {
    const double cycles = std::floor(seconds / (move_s + rest_s));
    const double u = std::fmin((seconds - cycles * (move_s + rest_s)) / move_s, 1.0);
    return base(move_s * (cycles + detail::ease(u)));
  };
}

}  // namespace trajectory
}  // namespace evmarker
