#include "evmarker/update/kalman_state.hpp"

#include <doctest/doctest.h>

#include <Eigen/Eigenvalues>

using namespace evmarker;

namespace {

// A covariance with correlations between all.
KalmanState state() {
  KalmanState state;
  state.twist = {{1, 2, 3}, {4, 5, 6}};
  for (int i = 0; i < 12; ++i)
    for (int k = 0; k < 12; ++k) state.P.xx(i, k) = (i == k ? 3 : 1) + 0.01 * (i + k);
  for (Vector12d& column : state.P.xb) column = Vector12d::Constant(0.1);
  for (std::size_t b = 0; b < kBiases; ++b) state.P.bb[b][b] = 0.5 + static_cast<double>(b);
  return state;
}

}  // namespace

TEST_CASE("kalman state: a scaled velocity scales its covariance") {
  const KalmanState before = state();
  KalmanState after = before;
  after.scale_velocity(0.5);
  Matrix12d by = Matrix12d::Identity();
  by.bottomRightCorner<6, 6>() *= 0.5;
  CHECK((after.P.xx - by * before.P.xx * by).cwiseAbs().maxCoeff() == 0);
  for (std::size_t b = 0; b < kBiases; ++b) CHECK(after.P.xb[b] == by * before.P.xb[b]);
  CHECK(Vector6d(after.twist) == 0.5 * Vector6d(before.twist));
}

TEST_CASE("kalman state: another pose, whose motions are a linear map of those of this one") {
  const KalmanState before = state();
  KalmanState after = before;
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() << 0, -1, 0, -1, 0, 0, 0, 0, -1;
  J(0, 4) = 0.2;
  after.lead.motion = before.twist;
  after.transform(J);
  CHECK((Vector6d(after.twist) - J * Vector6d(before.twist)).norm() < 1e-12);
  CHECK((Vector6d(after.lead.motion) - J * Vector6d(before.twist)).norm() < 1e-12);
  const auto block = [](const KalmanState& s, int i, int k) { return Matrix6d(s.P.xx.block<6, 6>(6 * i, 6 * k)); };
  for (int i = 0; i < 2; ++i)
    for (int k = 0; k < 2; ++k)
      CHECK((block(after, i, k) - J * block(before, i, k) * J.transpose()).cwiseAbs().maxCoeff() < 1e-12);
  for (std::size_t b = 0; b < kBiases; ++b) {
    CHECK((after.P.xb[b].head<6>() - J * before.P.xb[b].head<6>()).norm() < 1e-12);
    CHECK((after.P.xb[b].tail<6>() - J * before.P.xb[b].tail<6>()).norm() < 1e-12);
  }
  CHECK(after.P.xx == after.P.xx.transpose());
}

TEST_CASE("kalman state: the variance of the edges' speed is that of translation, and of rotation with their lever") {
  const KalmanState s = state();
  constexpr double kLever2 = 0.01;
  CHECK(s.speed_variance(kLever2) ==
        doctest::Approx(s.P.xx.block<3, 3>(6, 6).trace() + kLever2 * s.P.xx.block<3, 3>(9, 9).trace()));
}

TEST_CASE("kalman state: in mirrored time, the velocity is reversed, and the pose is before the state") {
  KalmanState s = state();
  s.lead = {0.001, {{1, 0, 0}, {}}};
  s.reverse();
  CHECK(Vector6d(s.twist) == -Vector6d(state().twist));
  CHECK(s.lead.s == -0.001);
  CHECK(s.lead.motion.t.x == 1);  // the pose is where it was
}

TEST_CASE("kalman state: the pose's covariance after a step is that of a prediction") {
  const std::array<double, 6> q{1, 2, 3, 4, 5, 6};
  const MotionStep motion = motion_step(0.1, {1, 3, 5, 2, 4, 6});
  KalmanState predicted = state();
  Matrix6d pose = predicted.P.xx.topLeftCorner<6, 6>();
  predicted.add_motion(pose, motion, q);
  predicted.predict({{1, 2, 3}, {4, 5, 6}}, motion, q);
  CHECK((pose - predicted.P.xx.topLeftCorner<6, 6>()).cwiseAbs().maxCoeff() < 1e-14);
  CHECK(Vector6d(predicted.twist) == Vector6d(1, 2, 3, 4, 5, 6));
}

TEST_CASE("kalman state: biases drift, but are never less known than at first") {
  KalmanState s = state();
  s.let_biases_drift(0.1, {1, 1});
  CHECK(s.P.bb[0][0] == doctest::Approx(0.6));
  CHECK(s.P.bb[1][1] == 1.5);  // was less known before
  s.let_biases_drift(100, {1, 1});
  CHECK(s.P.bb[0][0] == 1);
}
