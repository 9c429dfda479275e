#pragma once
// A few numbers in vector registers, for loops that are too short for the compiler to vectorise.
#include <array>
#include <cstddef>
#include <cstdint>

namespace evmarker::simd {

namespace detail {

// Specialisations, not one template: the compilers ignore these attributes where they depend on a template parameter.
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

/// Two doubles in one register; the usual operators work element by element.
using Pair = detail::Vector<128>::InRegister;

/// Loads two adjacent numbers, which need only the alignment of a double.
[[gnu::always_inline]] inline Pair pair_at(const double* numbers) noexcept {
  return *reinterpret_cast<const detail::Vector<128>::InMemory*>(numbers);
}
// The larger (smaller) of x and the bound, element by element; the bound where x is NaN.
[[gnu::always_inline]] inline Pair larger(Pair x, Pair bound) noexcept { return x > bound ? x : bound; }
[[gnu::always_inline]] inline Pair smaller(Pair x, Pair bound) noexcept { return x < bound ? x : bound; }
// The second number first.
[[gnu::always_inline]] inline Pair swapped(Pair x) noexcept { return __builtin_shufflevector(x, x, 1, 0); }

/// Four unsigned numbers in one register; the usual operators work element by element, and a comparison sets all
/// bits of an element where it holds, none elsewhere.
using Quad [[gnu::vector_size(16)]] = std::uint32_t;

/// Loads four adjacent numbers, which need only the alignment of one.
[[gnu::always_inline]] inline Quad quad_at(const std::uint32_t* numbers) noexcept {
  using InMemory [[gnu::vector_size(16), gnu::aligned(4), gnu::may_alias]] = std::uint32_t;
  return *reinterpret_cast<const InMemory*>(numbers);
}

/// `kNumbers` doubles in vectors of `kBits` bits: 128 or 256, as `in_packs` (wide_vectors.hpp) chooses; or 64, one
/// double to a vector, for packs too short for those. `kNumbers` is a multiple of the doubles in one vector.
template <std::size_t kNumbers, std::size_t kBits>
class Pack {
 public:
  /// All zeros.
  [[gnu::always_inline]] Pack() noexcept : parts_{} {}
  /// Loads `kNumbers` adjacent numbers, which need only the alignment of a double.
  [[gnu::always_inline]] explicit Pack(const double* numbers) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] = *reinterpret_cast<const InMemory*>(numbers + kPerPart * i);
  }
  [[gnu::always_inline]] void store(double* numbers) const noexcept {
    for (std::size_t i = 0; i < kParts; ++i) *reinterpret_cast<InMemory*>(numbers + kPerPart * i) = parts_[i];
  }

  [[gnu::always_inline]] double operator[](std::size_t i) const noexcept { return parts_[i / kPerPart][i % kPerPart]; }

  [[gnu::always_inline]] void scale(double factor) noexcept {
    for (Part& part : parts_) part *= factor;
  }
  /// Multiplies by another pack, element by element.
  [[gnu::always_inline]] void scale(const Pack& factors) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] *= factors.parts_[i];
  }
  /// Adds a multiple of another pack.
  [[gnu::always_inline]] void add(double times, const Pack& other) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] += times * other.parts_[i];
  }
  /// Subtracts a multiple of another pack.
  [[gnu::always_inline]] void subtract(double times, const Pack& other) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] -= times * other.parts_[i];
  }
  /// Adds the element-wise product of two other packs.
  [[gnu::always_inline]] void add_product(const Pack& a, const Pack& b) noexcept {
    for (std::size_t i = 0; i < kParts; ++i) parts_[i] += a.parts_[i] * b.parts_[i];
  }
  /// Adds a number to element i; it must be finite, as it is multiplied by 0 for the other elements.
  [[gnu::always_inline]] void add_at(std::size_t i, double number) noexcept {
    Part at{};
    at[i % kPerPart] = 1;
    parts_[i / kPerPart] += number * at;
  }

  /// A pack of the second half of the numbers, followed by zeros.
  [[gnu::always_inline]] Pack second_half() const noexcept {
    Pack half;
    if constexpr (kParts % 2 == 0) {
      for (std::size_t i = 0; i < kParts / 2; ++i) half.parts_[i] = parts_[kParts / 2 + i];
    } else {  // the half begins within a vector: twelve numbers in vectors of four
      static_assert(kParts == 3 && kPerPart == 4);
      half.parts_[0] = __builtin_shufflevector(parts_[1], parts_[2], 2, 3, 4, 5);
      half.parts_[1] = __builtin_shufflevector(parts_[2], Part{}, 2, 3, 4, 5);
    }
    return half;
  }

 private:
  using Part = typename detail::Vector<kBits>::InRegister;
  using InMemory = typename detail::Vector<kBits>::InMemory;
  static constexpr std::size_t kPerPart = kBits / 64, kParts = kNumbers / kPerPart;
  static_assert(kParts * kPerPart == kNumbers);

  std::array<Part, kParts> parts_;
};

}  // namespace evmarker::simd
