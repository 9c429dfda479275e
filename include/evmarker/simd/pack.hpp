#pragma once
// A few numbers in vector registers, where loops are too short for the compiler to make vectors of them.
#include <array>
#include <cstddef>

namespace evmarker::simd {

namespace detail {

// As members of Pack, these attributes would depend on its parameters, and be lost.
template <std::size_t kBits>
struct Vector;
template <>
struct Vector<64> {
  using InRegister [[gnu::vector_size(8)]] = double;
  using InMemory [[gnu::vector_size(8), gnu::aligned(8), gnu::may_alias]] = double;
};
template <>
struct Vector<128> {
  using InRegister [[gnu::vector_size(16)]] = double;
  using InMemory [[gnu::vector_size(16), gnu::aligned(8), gnu::may_alias]] = double;
};
template <>
struct Vector<256> {
  using InRegister [[gnu::vector_size(32)]] = double;
  using InMemory [[gnu::vector_size(32), gnu::aligned(8), gnu::may_alias]] = double;
};

}  // namespace detail

/// Two numbers, computed together by the usual operators.
using Pair = detail::Vector<128>::InRegister;

/// Two numbers that lie one after the other.
[[gnu::always_inline]] inline Pair pair_at(const double* numbers) noexcept {
  return *reinterpret_cast<const detail::Vector<128>::InMemory*>(numbers);
}
// As of single numbers, see lanes.hpp.
[[gnu::always_inline]] inline Pair larger(Pair x, Pair bound) noexcept { return x > bound ? x : bound; }
[[gnu::always_inline]] inline Pair smaller(Pair x, Pair bound) noexcept { return x < bound ? x : bound; }
[[gnu::always_inline]] inline Pair swapped(Pair x) noexcept { return __builtin_shufflevector(x, x, 1, 0); }

/// `kNumbers` numbers, all zero at first, in vectors of `kBits` bits: see `in_packs`.
template <std::size_t kNumbers, std::size_t kBits>
class Pack {
 public:
  [[gnu::always_inline]] Pack() noexcept : parts_{} {}
  [[gnu::always_inline]] explicit Pack(const double* numbers) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] = *reinterpret_cast<const InMemory*>(numbers + kPart * i);
  }
  [[gnu::always_inline]] void store(double* numbers) const noexcept {
    for (std::size_t i = 0; i < kParts; ++i) *reinterpret_cast<InMemory*>(numbers + kPart * i) = parts_[i];
  }

  [[gnu::always_inline]] double operator[](std::size_t i) const noexcept { return parts_[i / kPart][i % kPart]; }

  [[gnu::always_inline]] void scale(double factor) noexcept {
    for (Part& part : parts_) part *= factor;
  }
  /// Adds, or subtracts, a multiple of the other.
  [[gnu::always_inline]] void add(double times, const Pack& other) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] += times * other.parts_[i];
  }
  [[gnu::always_inline]] void subtract(double times, const Pack& other) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] -= times * other.parts_[i];
  }
  /// Adds the products of two others, number by number.
  [[gnu::always_inline]] void add_product(const Pack& a, const Pack& b) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] += a.parts_[i] * b.parts_[i];
  }
  [[gnu::always_inline]] void add_at(std::size_t i, double number) noexcept {
    Part at{};
    at[i % kPart] = 1;
    parts_[i / kPart] += number * at;
  }

  /// The second half, followed by zeros.
  [[gnu::always_inline]] Pack second_half() const noexcept {
    Pack half;
    if constexpr (kParts % 2 == 0) {
      for (std::size_t i = 0; i < kParts / 2; ++i) half.parts_[i] = parts_[kParts / 2 + i];
    } else {
      static_assert(kParts == 3 && kPart == 4);
      half.parts_[0] = __builtin_shufflevector(parts_[1], parts_[2], 2, 3, 4, 5);
      half.parts_[1] = __builtin_shufflevector(parts_[2], Part{}, 2, 3, 4, 5);
    }
    return half;
  }
  [[gnu::always_inline]] void scale_second_half(double factor) noexcept {
    for (std::size_t i = (kParts + 1) / 2; i < kParts; ++i) parts_[i] *= factor;
    if constexpr (kParts % 2 != 0) parts_[kParts / 2] *= Part{1, 1, factor, factor};
  }

 private:
  using Part = typename detail::Vector<kBits>::InRegister;
  using InMemory = typename detail::Vector<kBits>::InMemory;
  static constexpr std::size_t kPart = kBits / 64, kParts = kNumbers / kPart;
  static_assert(kParts * kPart == kNumbers);

  std::array<Part, kParts> parts_;
};

}  // namespace evmarker::simd
