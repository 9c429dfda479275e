#pragma once
// Eight numbers that are computed together, in loops that the compiler vectorises.
#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace evmarker::simd {

/// How many numbers are computed together: they fill one vector of 512 bits, two of 256, or four of 128.
inline constexpr std::size_t kLanes = 8;

using Lanes = std::array<double, kLanes>;

/// Calls `work(i)` for each lane i, in a loop that the compiler vectorises. `work` must be marked `always_inline`, and
/// what it does for one lane must not depend on another.
template <typename Work>
[[gnu::always_inline]] inline void for_each_lane(const Work& work) noexcept {
#ifdef __clang__  // which otherwise unrolls the loop before it looks for vectors, or rates them too low
#pragma clang loop unroll(disable) vectorize(enable)
#endif
  for (std::size_t i = 0; i < kLanes; ++i) work(i);
}

/// The sum of the lanes.
[[gnu::always_inline]] inline double sum(const Lanes& lanes) noexcept {
  double four[4], two[2];
  for (std::size_t i = 0; i < 4; ++i) four[i] = lanes[i] + lanes[i + 4];
  for (std::size_t i = 0; i < 2; ++i) two[i] = four[i] + four[i + 2];
  return two[0] + two[1];
}

/// Replaces each lane by its square root.
// By Eigen: the compiler does not vectorise a loop over std::sqrt, which may have to set errno.
[[gnu::always_inline]] inline void square_roots(Lanes& lanes) noexcept {
  Eigen::Map<Eigen::Array<double, kLanes, 1>> all(lanes.data());
  all = all.sqrt();
}

// The larger and the smaller of two numbers, each a single vector instruction. If x is NaN, the result is the bound.
[[gnu::always_inline]] inline double larger(double x, double bound) noexcept { return x > bound ? x : bound; }
[[gnu::always_inline]] inline double smaller(double x, double bound) noexcept { return x < bound ? x : bound; }

}  // namespace evmarker::simd
