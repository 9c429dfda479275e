#pragma once
// Seeded numbers and poses for tests that try many.
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>

class SeededNumbers {
 public:
  explicit SeededNumbers(unsigned seed) : engine_(seed) {}
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine_); }
  int integer(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine_); }

 private:
  std::mt19937 engine_;
};

/// Somewhere in a cone about the optical axis, tilted and turned.
inline Eigen::Isometry3d random_pose(SeededNumbers& random, double distance, double max_tilt,
                                     bool from_behind = false) {
  constexpr double kPi = std::numbers::pi;
  const double turn = random(-kPi, kPi), direction = random(-kPi, kPi), tilt = random(0, max_tilt);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(direction), std::sin(direction), 0)) *
                Eigen::AngleAxisd(from_behind ? 0 : kPi, Eigen::Vector3d::UnitX()) *
                Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()))
                   .toRotationMatrix();
  const double y = random(-0.3, 0.3), x = random(-0.4, 0.4);  // as arguments, in an order that compilers choose
  T.translation() = distance * Eigen::Vector3d(x, y, 1);
  return T;
}
