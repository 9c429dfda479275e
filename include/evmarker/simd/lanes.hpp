#pragma once
// Numbers that are computed together, for loops that the compiler makes vectors of.
#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace evmarker::simd {

/// Numbers that are computed together: one vector of 512 bits, two of 256, four of 128.
inline constexpr std::size_t kLanes = 8;

using Lanes = std::array<double, kLanes>;

/// The sum of the lanes.
[[gnu::always_inline]] inline double sum(const Lanes& lanes) noexcept {
  double four[4], two[2];
  for (std::size_t i = 0; i < 4; ++i) four[i] = lanes[i] + lanes[i + 4];
  for (std::size_t i = 0; i < 2; ++i) two[i] = four[i] + four[i + 2];
  return two[0] + two[1];
}

/// Takes the square root of each lane.
// Through Eigen: a loop over std::sqrt, which may have to set errno, does not become a vector instruction.
[[gnu::always_inline]] inline void square_roots(Lanes& lanes) noexcept {
  Eigen::Map<Eigen::Array<double, kLanes, 1>> all(lanes.data());
  all = all.sqrt();
}

// Vectors have these as one instruction; of a NaN they make the bound.
[[gnu::always_inline]] inline double larger(double x, double bound) noexcept { return x > bound ? x : bound; }
[[gnu::always_inline]] inline double smaller(double x, double bound) noexcept { return x < bound ? x : bound; }

}  // namespace evmarker::simd
