#pragma once
// Seeded random numbers that are the same with every standard library.
#include <cmath>
#include <cstdint>
#include <numbers>

namespace evmarker {

/// A number in which every bit depends on every bit of the key (the finaliser of SplitMix64; Steele, Lea and Flood,
/// "Fast splittable pseudorandom number generators", 2014).
constexpr std::uint64_t mix_bits(std::uint64_t key) noexcept {
  key = (key ^ (key >> 30)) * 0xBF58476D1CE4E5B9u;
  key = (key ^ (key >> 27)) * 0x94D049BB133111EBu;
  return key ^ (key >> 31);
}

/// SplitMix64 generator. A stream is fixed by a seed and up to two keys, so that what one pixel draws does not depend
/// on what others drew before it.
class Random {
 public:
  explicit constexpr Random(std::uint64_t seed, std::uint64_t key = 0, std::uint64_t subkey = 0) noexcept
      : state_(mix_bits(mix_bits(mix_bits(seed + kIncrement) + key + kIncrement) + subkey + kIncrement)) {}

  constexpr std::uint64_t bits() noexcept { return mix_bits(state_ += kIncrement); }

  /// In [0, 1).
  constexpr double uniform() noexcept { return static_cast<double>(bits() >> 11) * 0x1p-53; }

  /// In [low, high).
  constexpr double uniform(double low, double high) noexcept { return low + (high - low) * uniform(); }

  /// Mean 1; waiting time of a Poisson process of rate 1.
  double exponential() noexcept { return -std::log1p(-uniform()); }

  /// Mean 0, standard deviation 1 (Box and Muller).
  double gaussian() noexcept {
    const double radius = std::sqrt(2 * exponential());
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  static constexpr std::uint64_t kIncrement = 0x9E3779B97F4A7C15u;
  std::uint64_t state_;
};

}  // namespace evmarker
