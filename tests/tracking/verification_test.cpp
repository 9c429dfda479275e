#include "evmarker/tracking/verification.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "simulated.hpp"

using namespace evmarker;

namespace {

using Follower = EdgeFollower<DecoupledUpdate>;

Eigen::Isometry3d pose_of(const Eigen::Matrix3d& R, const Eigen::Vector3d& T) {
  Eigen::Isometry3d P = Eigen::Isometry3d::Identity();
  P.linear() = R;
  P.translation() = T;
  return P;
}

Eigen::Matrix3d rotation(double roll, double pitch, double yaw) {
  using Eigen::AngleAxisd, Eigen::Vector3d;
  return (AngleAxisd(yaw, Vector3d::UnitZ()) * AngleAxisd(pitch, Vector3d::UnitY()) *
          AngleAxisd(roll, Vector3d::UnitX()))
      .toRotationMatrix();
}

}  // namespace

TEST_CASE("Eq. 13 is the sum of the centre's distances along x and y in pixels") {
  const auto error = backtrack_error(pose_of(rotation(0, 0, 0), {0.10, -0.05, 0.5}),
                                     pose_of(rotation(0, 0, 0), {0.13, -0.03, 0.6}), 500);
  // 500 * |0.1 / 0.5 - 0.13 / 0.6| + 500 * |-0.05 / 0.5 + 0.03 / 0.6|
  CHECK(error.translation_px == doctest::Approx(500 * (0.13 / 0.6 - 0.2) + 500 * 0.05));
  CHECK(error.rotation_rad == doctest::Approx(0));
}

TEST_CASE("Eq. 14 adds the three angles' distances, wrapped") {
  const Eigen::Vector3d T(0, 0, 1);
  const auto plain = backtrack_error(pose_of(rotation(0.1, 0.2, 0.3), T), pose_of(rotation(0.15, 0.1, 0.33), T), 500);
  CHECK(plain.rotation_rad == doctest::Approx(0.05 + 0.1 + 0.03));
  // A marker that faces the camera upright has a roll of pi: the two sides of the cut are 0.02 apart, not 2 pi.
  const double pi = std::numbers::pi;
  const auto wrapped =
      backtrack_error(pose_of(rotation(pi - 0.01, 0, 0), T), pose_of(rotation(-pi + 0.01, 0, 0), T), 500);
  CHECK(wrapped.rotation_rad == doctest::Approx(0.02));
  CHECK(wrapped.angle_rad == doctest::Approx(0.02));
}

TEST_CASE("an error passes up to both thresholds, and never as NaN") {
  const Follower follower(make_square_marker(0.1), 500, facing_pose({0, 0, 1}), {});
  const Verification<DecoupledUpdate> verification(follower, {.max_translation_px = 5, .max_rotation_rad = 0.15});
  CHECK(verification.passes({5, 0.15, 0}));
  CHECK_FALSE(verification.passes({5.01, 0, 0}));
  CHECK_FALSE(verification.passes({0, 0.151, 0}));
  CHECK_FALSE(verification.passes({std::numeric_limits<double>::quiet_NaN(), 0, 0}));
}

TEST_CASE("automatic: a small marker may come back turned by what moves its rim by the other threshold") {
  const auto verification = [](double size_px, const VerificationSettings& settings) {
    const Follower follower(make_square_marker(0.1), 500, facing_pose({0, 0, 0.1 * 500 / size_px}), {});
    return Verification<DecoupledUpdate>(follower, settings);
  };
  const auto small = verification(32, {}), large = verification(200, {}),
             coarse = verification(200, {.max_translation_px = 20}), told = verification(32, {.max_rotation_rad = 0.2});
  CHECK(small.max_rotation_rad() == doctest::Approx(3 * 5.0 / 32));
  CHECK(small.passes({0, 0.468, 0}));
  CHECK_FALSE(small.passes({0, 0.47, 0}));
  CHECK(large.max_rotation_rad() == 0.15);
  CHECK(large.passes({0, 0.15, 0}));
  CHECK_FALSE(large.passes({0, 0.151, 0}));
  CHECK(coarse.max_rotation_rad() == doctest::Approx(0.3));
  CHECK(told.max_rotation_rad() == 0.2);
  CHECK_FALSE(told.passes({0, 0.201, 0}));
}

TEST_CASE("thresholds and spans out of range are named") {
  const Follower follower(make_square_marker(0.1), 500, facing_pose({0, 0, 1}), {});
  using V = Verification<DecoupledUpdate>;
  CHECK_THROWS_WITH(V(follower, {.updates = 0}), doctest::Contains("updates is 0"));
  CHECK_THROWS_WITH(V(follower, {.every = 0}), doctest::Contains("every is 0"));
  CHECK_THROWS_WITH(V(follower, {.max_translation_px = -1}), doctest::Contains("max_translation_px is -1"));
  CHECK_THROWS_WITH(V(follower, {.max_rotation_rad = -1}), doctest::Contains("max_rotation_rad is -1"));
  CHECK_THROWS_WITH(V(follower, {.max_rotation_rad = std::numeric_limits<double>::quiet_NaN()}),
                    doctest::Contains("max_rotation_rad is nan"));
  CHECK_THROWS_WITH(V(follower, {.max_events = 0}), doctest::Contains("max_events is 0"));
}

TEST_CASE("the way back leads to where a good tracker was, and elsewhere for one on the wrong marker") {
  const Trajectory motion = simulated::near_motion(31);
  const auto events = simulated::near_events(motion, 0.4, 31);
  const UndistortionTable lines(simulated::camera);

  struct Outcome {
    std::vector<BacktrackError> errors;
    double true_error_px = 0;
  };
  const auto run = [&](const MarkerModel& model, const Eigen::Isometry3d& start,
                       const VerificationSettings& settings = {}) {
    Follower follower(model, lines.focal_length(), start, {});
    Verification<DecoupledUpdate> verification(follower, settings);
    SpatiotemporalFilter filter(lines.sensor_size());
    Outcome outcome;
    int updates = 0;
    for (const Event& event : events) {
      if (!filter.accept(event)) continue;
      const auto [match, updated, segment] = follower.push(lines(event), event.t);
      if (match == MatchResult::far) continue;
      updates += updated;
      if (updates == 50 && updated) verification.restart(follower);  // the first updates refine the start
      if (const BacktrackError* const error = verification.push(event, updated, follower, lines); error && updates > 50)
        outcome.errors.push_back(*error);
    }
    const auto truth = motion(0.4);
    outcome.true_error_px = backtrack_error(truth, follower.T_camera_marker(), lines.focal_length()).translation_px;
    return outcome;
  };
  const auto worst = [](const Outcome& outcome) {
    double px = 0, rad = 0;
    for (const auto& error : outcome.errors) {
      px = std::max(px, error.translation_px);
      rad = std::max(rad, error.rotation_rad);
    }
    return std::pair(px, rad);
  };

  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  const Outcome good = run(model, motion(0));
  REQUIRE(good.errors.size() > 10);
  REQUIRE(good.true_error_px < 3);
  CHECK(worst(good).first < 5);
  CHECK(worst(good).second < 0.15);

  // Every window, or the first of four.
  const auto all = run(model, motion(0), {.every = 1}), few = run(model, motion(0), {.every = 4});
  CHECK(all.errors.size() > 1.7 * static_cast<double>(good.errors.size()));
  CHECK(good.errors.size() > 1.7 * static_cast<double>(few.errors.size()));
  CHECK(worst(all).first < 5);

  Eigen::Isometry3d beside = motion(0);  // on half the marker, turned: the events do not belong to these edges
  beside.translation() += Eigen::Vector3d(0.04, 0.03, 0);
  beside.linear() = so3_exp({0, 0, 0.4}) * beside.linear();
  const Outcome bad = run(model, beside);
  REQUIRE(bad.errors.size() > 3);
  REQUIRE(bad.true_error_px > 5);
  CHECK((worst(bad).first > 5 || worst(bad).second > 0.15));
}

TEST_CASE("verification leaves the forward tracker as it is") {
  const Trajectory motion = simulated::near_motion(32);
  const auto events = simulated::near_events(motion, 0.1, 32);
  const UndistortionTable lines(simulated::camera);
  Follower alone(make_code_marker(0.10, simulated::code()), lines.focal_length(), motion(0), {});
  Follower verified = alone;
  Verification<DecoupledUpdate> verification(verified, {.updates = 3, .min_events = 1});
  int verifications = 0;
  for (const Event& event : events) {
    alone.push(lines(event), event.t);
    const auto [match, updated, segment] = verified.push(lines(event), event.t);
    verifications += verification.push(event, updated, verified, lines) != nullptr;
  }
  REQUIRE(verifications > 10);
  CHECK(alone.T_camera_marker().matrix() == verified.T_camera_marker().matrix());
}

TEST_CASE("a brief window is gone back over after some hundred events, and only the first is brief") {
  const Trajectory motion = simulated::near_motion(33);
  const auto events = simulated::near_events(motion, 0.2, 33);
  const UndistortionTable lines(simulated::camera);
  const auto verified_after = [&](VerificationWindow window) {
    Follower follower(make_code_marker(simulated::kMarkerLength, simulated::code()), lines.focal_length(), motion(0),
                      {.events_per_update = 100});
    Verification<DecoupledUpdate> verification(follower, {.every = 1});
    verification.restart(follower, window);
    std::vector<int> after;
    int pushed = 0;
    for (const Event& event : events) {
      const auto [match, updated, segment] = follower.push(lines(event), event.t);
      if (match == MatchResult::far) continue;
      ++pushed;
      if (verification.push(event, updated, follower, lines)) after.push_back(pushed);
    }
    return after;
  };
  const auto brief = verified_after(VerificationWindow::brief), full = verified_after(VerificationWindow::full);
  REQUIRE(brief.size() > 2);
  REQUIRE(full.size() > 1);
  CHECK(brief[0] >= 500);
  CHECK(brief[0] < 1500);
  CHECK(full[0] > 10000);  // 100 updates of 100 events
  CHECK(brief[1] > 10000);
}

TEST_CASE("a window is gone back over, however few events it may keep") {
  const Trajectory motion = simulated::near_motion(31);
  const UndistortionTable lines(simulated::camera);
  for (const std::size_t max_events : {2u, 4u, 64u}) {
    CAPTURE(max_events);
    Follower follower(make_code_marker(simulated::kMarkerLength, simulated::code()), lines.focal_length(), motion(0),
                      {.events_per_update = 1});
    Verification<DecoupledUpdate> verification(follower, {.max_events = max_events});
    int verified = 0;
    for (const Event& event : simulated::filtered(simulated::near_events(motion, 0.05, 31))) {
      const bool updated = follower.push(lines(event), event.t, polarity(event)).updated;
      verified += verification.push(event, updated, follower, lines) != nullptr;
    }
    CHECK(verified > 10);
  }
}

TEST_CASE("what is not known of the distance is no error of the place in the image, wherever the marker is") {
  constexpr double kFocal = 800, kSigma_m = 0.01;
  for (const Eigen::Vector3d& T :
       {Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.5, -0.2, 1), Eigen::Vector3d(-1, 0, 2)}) {
    CAPTURE(T.transpose());
    Matrix6d P = Matrix6d::Identity();
    P.topLeftCorner<3, 3>() = kSigma_m * kSigma_m * T.normalized() * T.normalized().transpose();
    CHECK(origin_deviation_px(P, T, kFocal) < 1e-6);
    P.topLeftCorner<3, 3>() = kSigma_m * kSigma_m * Eigen::Matrix3d::Identity();
    const double x = T.x() / T.z(), y = T.y() / T.z();
    CHECK(origin_deviation_px(P, T, kFocal) ==
          doctest::Approx(kFocal * kSigma_m / T.z() * (std::sqrt(1 + x * x) + std::sqrt(1 + y * y))));
  }
}
