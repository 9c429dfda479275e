#pragma once
// What the Kalman filter knows beside the pose: velocity, biases, and the covariance of all.
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

/// Twist, covariance of the error state [pose; velocity; biases] and what changes both. They are those at the mean time
/// of the last events; from there, the pose has been moved on to the last of them. Perturbations act on the left, in
/// the camera frame, rotations about the marker's origin.
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

  /// Goes over to mirrored time, in which the state's own time is after the pose's.
  void reverse() noexcept {
    lead.s = -lead.s;
    scale_velocity(-1);
  }

  /// Goes over to another pose, whose motions are J times those of this one.
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

  /// Variance of the speed of the edges, summed over the three axes [m^2/s^2].
  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]
  double speed_variance(double lever2) const noexcept {
    const double of_translation = P.xx(6, 6) + P.xx(7, 7) + P.xx(8, 8),
                 of_rotation = P.xx(9, 9) + P.xx(10, 10) + P.xx(11, 11);
    return of_translation + lever2 * of_rotation;
  }

  /// Predicts twist and covariance over a step; the pose moves by motion.moved(twist) with the twist before.
  /// @param q density of the white acceleration along each axis
  void predict(const MotionStep& motion, const std::array<double, 6>& q) noexcept {
    simd::in_packs([&](auto bits) __attribute__((always_inline)) { P.predict<bits>(motion, q); });
    twist = scaled(motion.velocity_kept, twist);
  }

  /// Adds a random walk to the biases; they are never less known than at first.
  void let_biases_drift(double variance, const std::array<double, kBiases>& at_first) noexcept {
    for (std::size_t b = 0; b < kBiases; ++b)
      P.bb[b][b] = std::max(P.bb[b][b], std::min(P.bb[b][b] + variance, at_first[b]));
  }

  /// Covariance of the pose after a step from the state's own time: the pose's block of F P F^T + Q.
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
