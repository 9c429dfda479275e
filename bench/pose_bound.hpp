#pragma once
// The error that the noise of the events leaves to an estimator of the pose that knows everything else.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/simulation/random.hpp"

namespace evmarker::bench {

/// Density of the white jerk that a motion is taken for [m^2/s^5, rad^2/s^5].
struct JerkDensity {
  double translation, rotation;
};

/// Errors of the pose at each step: of a filter, of a filter that may wait, and of a smoother that knows all steps.
struct BoundErrors {
  std::vector<Vector6d> filter, lagged, smoother;
};

/// A Kalman filter and smoother (Rauch, Tung and Striebel) over [pose, velocity, acceleration] with measurements of
/// exactly the information that the events have, linearised at the truth. It follows the true motion, whose changes of
/// acceleration it takes for white noise. What is computed are its errors, not its estimates.
class PoseBound {
 public:
  /// @param information of the events of each step about the pose, order as in PoseEstimate
  /// @param truth pose at a time [s]; step k is at (k + 1/2) step_s
  PoseBound(std::vector<Matrix6d> information, const std::function<Eigen::Isometry3d(double)>& truth, double step_s,
            std::uint64_t seed)
      : information_(std::move(information)), step_s_(step_s), F_(transition(step_s)) {
    Random random(seed);
    for (std::size_t k = 0; k < information_.size(); ++k) {
      change_.push_back(change(truth, (static_cast<double>(k) + 0.5) * step_s));
      noise_.push_back(noise(information_[k], random));
    }
  }

  /// Errors of the filter alone.
  std::vector<Vector6d> filter(const JerkDensity& density) const { return poses(forward(density, false).error); }

  /// @param lag_steps how much later than its time a pose of `lagged` is estimated
  BoundErrors errors(const JerkDensity& density, std::size_t lag_steps) const {
    const Pass pass = forward(density, true);
    BoundErrors errors{poses(pass.error), {}, {}};
    const std::size_t steps = pass.error.size();
    for (std::size_t k = 0; k < steps; ++k) {
      const std::size_t latest = std::min(k + lag_steps, steps - 1);
      errors.lagged.push_back(smoothed(pass, k, latest));
    }
    std::vector<State> smoother = pass.error;
    for (std::size_t k = steps; k-- > 1;) smoother[k - 1] = step_back(pass, k - 1, smoother[k]);
    errors.smoother = poses(smoother);
    return errors;
  }

 private:
  using State = Eigen::Matrix<double, 18, 1>;  // pose, velocity, acceleration
  using Matrix = Eigen::Matrix<double, 18, 18>;
  struct Pass {
    std::vector<State> error, predicted;  // of each step, after and before its events
    std::vector<Matrix> gain;             // of the smoother, P F^T P_predicted^-1, from each step to the next
  };

  static Matrix transition(double h) {
    Matrix F = Matrix::Identity();
    F.diagonal<6>().setConstant(h);
    F.diagonal<12>().setConstant(h * h / 2);
    return F;
  }

  Matrix process_noise(const JerkDensity& density) const {
    const double h = step_s_, h2 = h * h, h3 = h2 * h;
    const double of_order[3][3] = {
        {h2 * h3 / 20, h2 * h2 / 8, h3 / 6}, {h2 * h2 / 8, h3 / 3, h2 / 2}, {h3 / 6, h2 / 2, h}};
    Vector6d q;
    q << Eigen::Vector3d::Constant(density.translation), Eigen::Vector3d::Constant(density.rotation);
    Matrix Q = Matrix::Zero();
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) Q.block<6, 6>(6 * i, 6 * k) = (of_order[i][k] * q).asDiagonal();
    return Q;
  }

  static Matrix initial_covariance() {
    State sigma;
    sigma << Eigen::Vector3d::Constant(0.01), Eigen::Vector3d::Constant(0.1), Eigen::Vector3d::Constant(1),
        Eigen::Vector3d::Constant(10), Eigen::Vector3d::Constant(10), Eigen::Vector3d::Constant(100);
    return sigma.cwiseAbs2().asDiagonal();
  }

  static Vector6d difference(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
    Vector6d d;
    d << to.translation() - from.translation(), so3_log(to.linear() * from.linear().transpose());
    return d;
  }

  // What the true motion does in the step that ends at `t_s`, beside what F says.
  State change(const std::function<Eigen::Isometry3d(double)>& truth, double t_s) const {
    const auto at = [&](double t, const Vector6d& pose) {
      constexpr double h = 1e-3;
      const Vector6d before = difference(truth(t), truth(t - h)), after = difference(truth(t), truth(t + h));
      State s;
      s << pose, (after - before) / (2 * h), (after + before) / (h * h);
      return s;
    };
    const double from_s = t_s - step_s_;
    return at(t_s, difference(truth(from_s), truth(t_s))) - F_ * at(from_s, Vector6d::Zero());
  }

  // A draw of J^T R^-1 v: noise v of covariance R has the covariance `information` = J^T R^-1 J there.
  static Vector6d noise(const Matrix6d& information, Random& random) {
    Vector6d z;
    for (double& one : z) one = random.gaussian();
    const Eigen::LDLT<Matrix6d> root(information);
    const Vector6d scaled = root.vectorD().cwiseMax(0).cwiseSqrt().cwiseProduct(z);
    return root.transpositionsP().transpose() * Vector6d(root.matrixL() * scaled);
  }

  Pass forward(const JerkDensity& density, bool with_gains) const {
    const Matrix Q = process_noise(density);
    Matrix P = initial_covariance();
    State error = State::Zero();
    Pass pass;
    for (std::size_t k = 0; k < information_.size(); ++k) {
      const Matrix predicted_P = F_ * P * F_.transpose() + Q;
      if (with_gains && k > 0) pass.gain.push_back(predicted_P.llt().solve(F_ * P).transpose());
      pass.predicted.push_back(F_ * error - change_[k]);
      // (P^-1 + H^T I H)^-1 for H = [1 0 0], without an inverse of I, which may be singular.
      const Matrix6d S = Matrix6d::Identity() + information_[k] * predicted_P.topLeftCorner<6, 6>();
      P = predicted_P - predicted_P.leftCols<6>() * S.partialPivLu().solve(information_[k] * predicted_P.topRows<6>());
      P = (P + P.transpose()).eval() / 2;
      error = pass.predicted.back() + P.leftCols<6>() * (noise_[k] - information_[k] * pass.predicted.back().head<6>());
      pass.error.push_back(error);
    }
    return pass;
  }

  // The error at step k when that of step k + 1 is known to be `next`.
  static State step_back(const Pass& pass, std::size_t k, const State& next) {
    return pass.error[k] + pass.gain[k] * (next - pass.predicted[k + 1]);
  }

  // The pose's error at step k by all events up to `latest`.
  static Vector6d smoothed(const Pass& pass, std::size_t k, std::size_t latest) {
    State error = pass.error[latest];
    for (std::size_t i = latest; i > k; --i) error = step_back(pass, i - 1, error);
    return error.head<6>();
  }

  static std::vector<Vector6d> poses(const std::vector<State>& states) {
    std::vector<Vector6d> poses;
    for (const State& state : states) poses.push_back(state.head<6>());
    return poses;
  }

  std::vector<Matrix6d> information_;
  double step_s_;
  Matrix F_;
  std::vector<State> change_;
  std::vector<Vector6d> noise_;
};

}  // namespace evmarker::bench
