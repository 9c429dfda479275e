#pragma once
// The error state of the Kalman filter, its covariance, and the prediction.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>

#include "evmarker/base/vector.hpp"
#include "evmarker/simd/pack.hpp"
#include "evmarker/update/motion_model.hpp"

namespace evmarker {

using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

/// Number of biases of the events: edge offset, trail and OFF delay, see MeasurementModel.
inline constexpr std::size_t kBiases = 3;

/// Deviation of the true state from the estimated one: x = [pose; velocity], and the biases b = [edge offset, trail,
/// OFF delay].
struct ErrorState {
  Vector12d x = Vector12d::Zero();
  std::array<double, kBiases> b{};

  Vec6 pose() const noexcept { return six_from(0); }
  Vec6 velocity() const noexcept { return six_from(6); }
  void set_pose(const Vec6& pose) noexcept { std::ranges::copy(pose.array(), x.data()); }

 private:
  Vec6 six_from(Eigen::Index i) const noexcept { return {{x(i), x(i + 1), x(i + 2)}, {x(i + 3), x(i + 4), x(i + 5)}}; }
};

/// Covariance of an error state, in blocks. Columns of twelve numbers are whole vectors of 128 and of 256 bits; columns
/// of fifteen would not be.
struct ErrorCovariance {
  alignas(64) Matrix12d xx = Matrix12d::Zero();
  alignas(64) std::array<Vector12d, kBiases> xb{Vector12d::Zero(), Vector12d::Zero(), Vector12d::Zero()};
  std::array<std::array<double, kBiases>, kBiases> bb{};

  /// Predicts xx and xb over a motion step, P = F P F^T + Q, see MotionStep; the noise of the biases is not added.
  /// @param q white acceleration of each of the six axes
  template <std::size_t kBits>
  [[gnu::always_inline]] void predict(const MotionStep& motion, const std::array<double, 6>& q) noexcept {
    using Column = simd::Pack<12, kBits>;
    std::array<double, 12> diagonal, above{};  // of F
    diagonal.fill(1);
    std::ranges::copy(motion.velocity_kept, diagonal.begin() + 6);
    std::ranges::copy(motion.pose_by_velocity, above.begin());
    const Column kept(diagonal.data()), carried(above.data());
    const auto F_times = [&](const double* numbers) __attribute__((always_inline)) {
      Column column(numbers);
      const Column velocity = column.second_half();
      column.scale(kept);
      column.add_product(carried, velocity);
      return column;
    };
#pragma GCC unroll 6
    for (std::size_t k = 0; k < 6; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      Column pose = F_times(&xx(0, i)), velocity = F_times(&xx(0, 6 + i));  // of F P; now times F^T
      pose.add(motion.pose_by_velocity[k], velocity);
      velocity.scale(motion.velocity_kept[k]);
      pose.add_at(k, motion.q_pose[k] * q[k]);
      pose.add_at(6 + k, motion.q_cross[k] * q[k]);
      velocity.add_at(k, motion.q_cross[k] * q[k]);
      velocity.add_at(6 + k, motion.q_velocity[k] * q[k]);
      pose.store(&xx(0, i));
      velocity.store(&xx(0, 6 + i));
    }
    for (Vector12d& column : xb) F_times(column.data()).store(column.data());
  }

  /// Makes xx symmetric, from which rounding takes it.
  void symmetrize() noexcept {
    for (int i = 0; i < 12; ++i)
      for (int k = 0; k < i; ++k) xx(i, k) = xx(k, i) = (xx(i, k) + xx(k, i)) / 2;
  }
};

}  // namespace evmarker
