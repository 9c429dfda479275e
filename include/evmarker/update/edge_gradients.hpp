#pragma once
// How a motion of the pose shows in the image: as the motion of the edges along their normals.
#include <array>
#include <cstddef>

namespace evmarker {

/// The mean of g g^T over events, where g is the derivative of a residual by the pose. For a step x of the pose,
/// x^T (mean of g g^T) x is the mean squared motion of the edges along their normals: large for a step across the line
/// of sight, and small for one along it, or for a tilt of a marker that faces the camera.
class EdgeGradients {
 public:
  static constexpr std::size_t kStates = 6;
  using Gradient = std::array<double, kStates>;  ///< derivative of a residual by the pose [px/m, px/rad]

  /// Adds the gradient of an event. It need not be that of every event, only a fair sample.
  void add(const Gradient& gradient) noexcept {
    for (std::size_t k = 0; k < kStates; ++k)
      for (std::size_t i = 0; i <= k; ++i) sums_[k][i] = kKept * sums_[k][i] + gradient[k] * gradient[i];
    weight_ = kKept * weight_ + 1;
  }

  bool known() const noexcept { return weight_ > 0; }

  /// Mean squared motion along the normals [px^2].
  /// @param square (k, i) -> mean product of the k-th and i-th element of the step
  template <typename Square>
  double px2(const Square& square) const noexcept {
    double sum = 0;
    for (std::size_t k = 0; k < kStates; ++k) {
      sum += sums_[k][k] * square(k, k);
      for (std::size_t i = 0; i < k; ++i) sum += 2 * sums_[k][i] * square(k, i);
    }
    return sum / weight_;
  }

 private:
  static constexpr double kKept = 31.0 / 32;  // of the sums, from one sampled event to the next

  std::array<Gradient, kStates> sums_{};  // of g g^T, lower triangle
  double weight_ = 0;
};

}  // namespace evmarker
