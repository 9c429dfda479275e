#include "../../bench/pose_bound.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace evmarker;
using bench::BoundErrors;
using bench::JerkDensity;
using bench::PoseBound;

namespace {

constexpr double kStep_s = 0.5e-3, kSigma = 1e-5;  // of a step's measurement [m, rad]
constexpr JerkDensity kNoJerk{1e-12, 1e-12};

Eigen::Isometry3d at_rest(double) { return Eigen::Isometry3d(Eigen::Translation3d(0.02, -0.01, 0.5)); }

Eigen::Isometry3d swinging(double t_s) {
  Eigen::Isometry3d T = at_rest(t_s);
  T.translation().x() += 0.1 * std::sin(20 * t_s);
  T.rotate(Eigen::AngleAxisd(0.3 * std::cos(15 * t_s), Eigen::Vector3d::UnitY()));
  return T;
}

std::vector<Matrix6d> steps_of(std::size_t count, double sigma) {
  return std::vector<Matrix6d>(count, Matrix6d::Identity() / (sigma * sigma));
}

double rms(const std::vector<Vector6d>& errors) {
  double sum = 0;
  for (const Vector6d& error : errors) sum += error.squaredNorm();
  return std::sqrt(sum / (6 * static_cast<double>(errors.size())));
}

}  // namespace

TEST_CASE("without jerk, the bound is that of a parabola through the measurements") {
  // Of N measurements at equal distances: 9 sigma^2 / N at the last one, 9 sigma^2 / 4N in the middle.
  constexpr std::size_t kSteps = 400;
  constexpr int kRuns = 60;
  double last = 0, middle = 0;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const BoundErrors errors = PoseBound(steps_of(kSteps, kSigma), at_rest, kStep_s, seed).errors(kNoJerk, 10);
    REQUIRE(errors.filter.size() == kSteps);
    REQUIRE(errors.smoother.size() == kSteps);
    last += errors.filter.back().squaredNorm() / (6 * kRuns);
    middle += errors.smoother[kSteps / 2].squaredNorm() / (6 * kRuns);
  }
  const double unit = kSigma * kSigma / kSteps;  // 360 squares each: known to 7.5 %
  CHECK(last / unit == doctest::Approx(9).epsilon(0.2).scale(0));
  CHECK(middle / unit == doctest::Approx(9.0 / 4).epsilon(0.2).scale(0));
}

TEST_CASE("four times the information halves the error, and a direction without any keeps that of the start") {
  const auto rms_of = [](std::vector<Matrix6d> information) {
    return rms(PoseBound(std::move(information), at_rest, kStep_s, 3).filter(kNoJerk));
  };
  const double of_one = rms_of(steps_of(300, kSigma));
  CHECK(of_one > kSigma / 10);
  CHECK(of_one / rms_of(steps_of(300, kSigma / 2)) == doctest::Approx(2).epsilon(0.01).scale(0));
  auto without_depth = steps_of(300, kSigma);
  for (Matrix6d& information : without_depth) information(2, 2) = 0;
  for (const Vector6d& error : PoseBound(without_depth, at_rest, kStep_s, 3).filter(kNoJerk)) {
    CHECK(error[2] == 0);  // nothing is known of it, and nothing is drawn
    CHECK(error[0] != 0);
  }
}

TEST_CASE("noise that edges share is drawn with the covariance that belongs to the information") {
  // Depth and a tilt are known as their sum alone: after one step, the error of the sum is that of the measurement.
  Vector6d row = Vector6d::Zero();
  row[2] = 1;
  row[3] = 1;
  const std::vector<Matrix6d> information{row * row.transpose() / (kSigma * kSigma)};
  constexpr int kRuns = 2000;
  double sum = 0;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const Vector6d error = PoseBound(information, at_rest, kStep_s, seed).filter(kNoJerk).front();
    sum += std::pow(error[2] + error[3], 2) / kRuns;
  }
  CHECK(std::sqrt(sum) == doctest::Approx(kSigma).epsilon(0.05).scale(0));
}

TEST_CASE("a smoother is nearer than a filter, and one that waits a little lies between") {
  const BoundErrors errors =
      PoseBound(steps_of(2000, 10 * kSigma), swinging, kStep_s, 5).errors({.translation = 1e3, .rotation = 1e4}, 10);
  REQUIRE(errors.lagged.size() == errors.filter.size());
  MESSAGE("filter " << rms(errors.filter) << ", 10 steps later " << rms(errors.lagged) << ", afterwards "
                    << rms(errors.smoother));
  CHECK(rms(errors.lagged) < 0.9 * rms(errors.filter));
  CHECK(rms(errors.smoother) < 0.95 * rms(errors.lagged));
  CHECK(rms(errors.filter) > 10 * kSigma / 10);
}

TEST_CASE("a motion that is taken for smoother than it is is left behind") {
  const PoseBound bound(steps_of(2000, kSigma), swinging, kStep_s, 5);
  CHECK(rms(bound.filter({.translation = 1e-3, .rotation = 1e-2})) >
        3 * rms(bound.filter({.translation = 1e3, .rotation = 1e4})));
}
