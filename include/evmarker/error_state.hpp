#pragma once
// Floor 1. The error state of the Kalman filter and its covariance.
#include <Eigen/Core>
#include <cstddef>

#include "evmarker/pack.hpp"

namespace evmarker {

using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

/// How far a state is from what was expected: x = [pose; its velocity], and the edge offset o.
struct ErrorState {
  Vector12d x = Vector12d::Zero();
  double o = 0;
};

template <std::size_t kBits>
using StatePack = Pack<12, kBits>;

/// Its covariance. Columns of twelve are whole vectors, whatever their width.
struct ErrorCovariance {
  alignas(32) Matrix12d xx = Matrix12d::Zero();
  alignas(32) Vector12d xo = Vector12d::Zero();
  double oo = 0;

  /// What time makes of it: the pose moves by `carried` times the velocity, of which `kept` is left.
  /// @param pose_noise, both_noise, velocity_noise what is added to the diagonals of its quarters
  template <std::size_t kBits>
  [[gnu::always_inline]] void predict(double carried, double kept, const double* pose_noise, const double* both_noise,
                                      const double* velocity_noise) noexcept {
    // F P F^T with F = [I, carried I; 0, kept I], column by column.
    const auto moved = [&](const double* numbers) __attribute__((always_inline)) {
      StatePack<kBits> column(numbers), velocity = column.second_half();
      column.scale_second_half(kept);
      column.add(carried, velocity);
      return column;
    };
#pragma GCC unroll 6
    for (std::size_t k = 0; k < 6; ++k) {
      double *const pose = xx.data() + 12 * k, *const velocity = xx.data() + 12 * (6 + k);
      StatePack<kBits> of_velocity = moved(velocity), of_pose = moved(pose);
      of_pose.add(carried, of_velocity);
      of_velocity *= kept;
      of_pose.add_at(k, pose_noise[k]);
      of_pose.add_at(6 + k, both_noise[k]);
      of_velocity.add_at(k, both_noise[k]);
      of_velocity.add_at(6 + k, velocity_noise[k]);
      of_pose.store(pose);
      of_velocity.store(velocity);
    }
    moved(xo.data()).store(xo.data());
  }
};

}  // namespace evmarker
