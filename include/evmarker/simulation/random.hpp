#pragma once
// Seeded random numbers that do not depend on the standard library's generators and distributions.
#include <cmath>
#include <cstdint>
#include <numbers>

namespace evmarker {

/// A hash in which every bit depends on every bit of the key: the finaliser of SplitMix64 (Steele, Lea and Flood,
/// "Fast splittable pseudorandom number generators", 2014).
constexpr std::uint64_t mix_bits(std::uint64_t key) noexcept {
  key = (key ^ (key >> 30)) * 0xBF58476D1CE4E5B9u;
  key = (key ^ (key >> 27)) * 0x94D049BB133111EBu;
  return key ^ (key >> 31);
}

/// SplitMix64 generator. A seed and up to two keys determine the sequence, so that the numbers drawn for one pixel do
/// not depend on those drawn for others before.
class Random {
 public:
  explicit constexpr Random(std::uint64_t seed, std::uint64_t key = 0, std::uint64_t subkey = 0) noexcept
      : state_(mix_bits(mix_bits(mix_bits(seed + kIncrement) + key + kIncrement) + subkey + kIncrement)) {}

  /// 64 random bits.
  constexpr std::uint64_t bits() noexcept { return mix_bits(state_ += kIncrement); }

  /// A uniformly distributed number in [0, 1).
  constexpr double uniform() noexcept { return static_cast<double>(bits() >> 11) * 0x1p-53; }

  /// A uniformly distributed number in [low, high).
  constexpr double uniform(double low, double high) noexcept { return low + (high - low) * uniform(); }

  /// An exponentially distributed number of mean 1: the waiting time of a Poisson process of rate 1.
  double exponential() noexcept { return -std::log1p(-uniform()); }

  /// A normally distributed number of mean 0 and standard deviation 1 (Box and Muller).
  double gaussian() noexcept {
    const double radius = std::sqrt(2 * exponential());
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  static constexpr std::uint64_t kIncrement = 0x9E3779B97F4A7C15u;
  std::uint64_t state_;
};

}  // namespace evmarker
