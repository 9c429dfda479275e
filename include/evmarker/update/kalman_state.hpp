#pragma once
// The Kalman filter's velocity, and the covariance of pose, velocity and biases.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "evmarker/base/vector.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/error_state.hpp"
#include "evmarker/update/motion_model.hpp"

namespace evmarker {

/// Twist and covariance of the error state [pose; velocity; biases], at the mean time of the last update's events; the
/// pose, which is kept elsewhere, is ahead of that by `lead`, at the last of these events. Perturbations act on the
/// left, in the camera frame, rotations about the marker's origin.
struct KalmanState {
  /// From the state's own time to the pose's.
  struct Lead {
    double s = 0;  ///< duration
    Vec6 motion;   ///< by which the pose was moved for it
  };

  Vec6 twist;  ///< [m/s, rad/s]
  ErrorCovariance P;
  Lead lead;

  /// Scales the velocity, as if its unit of time had changed.
  void scale_velocity(double factor) noexcept {
    twist = factor * twist;
    for (int k = 0; k < 6; ++k)
      for (int i = 0; i < 6; ++i) {
        P.xx(i, 6 + k) *= factor;
        P.xx(6 + k, i) *= factor;
        P.xx(6 + i, 6 + k) *= factor * factor;
      }
    for (Vector12d& column : P.xb)
      for (int i = 6; i < 12; ++i) column(i) *= factor;
  }

  /// Goes over to mirrored time, in which the state's own time is after the pose's: `lead.motion` stays, as the pose is
  /// where it was.
  void reverse() noexcept {
    lead.s = -lead.s;
    scale_velocity(-1);
  }

  /// Goes over to another pose; J maps perturbations of this one to those of the other.
  void transform(const Matrix6d& J) noexcept {
    twist = product(J, twist);
    lead.motion = product(J, lead.motion);
    const auto transform_column = [&](double* column) {
      for (double* x : {column, column + 6}) {  // pose, velocity
        const Vec6 moved = product(J, {{x[0], x[1], x[2]}, {x[3], x[4], x[5]}});
        std::ranges::copy(moved.array(), x);
      }
    };
    // P is symmetric, so that its rows are transformed as columns, too.
    for (int side = 0; side < 2; ++side) {
      for (int k = 0; k < 12; ++k) transform_column(&P.xx(0, k));
      for (int k = 0; k < 12; ++k)
        for (int i = 0; i < k; ++i) std::swap(P.xx(i, k), P.xx(k, i));
    }
    P.symmetrize();
    for (Vector12d& column : P.xb) transform_column(column.data());
  }

  /// About the variance of the edges' velocity, summed over the three axes, as if all levers were at right angles to
  /// the rotation [m^2/s^2].
  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]
  double speed_variance(double lever2) const noexcept {
    const double of_translation = P.xx(6, 6) + P.xx(7, 7) + P.xx(8, 8),
                 of_rotation = P.xx(9, 9) + P.xx(10, 10) + P.xx(11, 11);
    return of_translation + lever2 * of_rotation;
  }

  /// Variance of the translation, a sum over its axes [m^2].
  double translation_variance() const noexcept { return P.xx(0, 0) + P.xx(1, 1) + P.xx(2, 2); }

  /// Predicts twist and covariance over a step; the caller moves the pose.
  /// @param faded the twist after the step
  /// @param q density of the white acceleration along each axis
  void predict(const Vec6& faded, const MotionStep& motion, const std::array<double, 6>& q) noexcept {
    simd::in_packs([&](auto bits) __attribute__((always_inline)) { P.predict<bits>(motion, q); });
    twist = faded;
  }

  /// Lets the biases walk at random; their variances do not grow beyond the initial ones.
  /// @param variance added to each [px^2, px^2, ms^2]
  void let_biases_drift(double variance, const std::array<double, kBiases>& initial_variances) noexcept {
    for (std::size_t b = 0; b < kBiases; ++b)
      P.bb[b][b] = std::max(P.bb[b][b], std::min(P.bb[b][b] + variance, initial_variances[b]));
  }

  /// Adds to `pose`, the pose's block of P, what a step from the state's own time adds to it: it becomes that of
  /// F P F^T + Q.
  void add_motion(Matrix6d& pose, const MotionStep& motion, const std::array<double, 6>& q) const noexcept {
    const auto carried = [&](int i) { return motion.pose_by_velocity[static_cast<std::size_t>(i)]; };
    for (int k = 0; k < 6; ++k) {
      for (int i = 0; i < 6; ++i)
        pose(i, k) +=
            carried(i) * P.xx(6 + i, k) + carried(k) * P.xx(i, 6 + k) + carried(i) * carried(k) * P.xx(6 + i, 6 + k);
      const auto axis = static_cast<std::size_t>(k);
      pose(k, k) += motion.q_pose[axis] * q[axis];
    }
  }
};

}  // namespace evmarker
