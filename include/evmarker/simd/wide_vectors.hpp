#pragma once
// Runs loops with the widest vectors that the processor has, in programs that are compiled for any processor.
#include <cstddef>
#include <type_traits>

namespace evmarker::simd {

namespace detail {

template <std::size_t kBits>
using Bits = std::integral_constant<std::size_t, kBits>;

}  // namespace detail

// Elsewhere than on x86-64, loops use the vectors that the program is compiled for, and packs those of two doubles that
// every aarch64 has.
#if defined(__GNUC__) && defined(__x86_64__)

namespace detail {

template <typename Loops>
#ifdef __clang__  // does not accept the preference, and needs none
[[gnu::noinline, gnu::target("avx512f,avx512dq,avx512vl,fma")]]
#else
[[gnu::noinline, gnu::target("avx512f,avx512dq,avx512vl,fma,prefer-vector-width=512")]]
#endif
void in_512_bits(const Loops& loops) noexcept {
  loops();
}

template <typename Loops>
[[gnu::noinline, gnu::target("avx2,fma")]] void in_256_bits(const Loops& loops) noexcept {
  loops();
}

inline int widest_vectors() noexcept {
  __builtin_cpu_init();
  // Every processor with AVX-512 has FMA.
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
    return 512;
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? 256 : 128;
}

inline const int kVectorBits = widest_vectors();

}  // namespace detail

/// Calls `loops()`, a function whose loops the compiler can vectorise, in a version compiled for the widest vectors
/// that this processor has. `loops` must be marked `always_inline`, and so must all functions that it calls.
template <typename Loops>
[[gnu::always_inline]] inline void in_wide_vectors(const Loops& loops) noexcept {
  if (detail::kVectorBits == 512)
    detail::in_512_bits(loops);
  else if (detail::kVectorBits == 256)
    detail::in_256_bits(loops);
  else
    loops();
}

/// Calls `work(bits)` in the same way; `bits` is the width for its `Pack`s: 128, or 256 where there are vectors of 256
/// or 512 bits, as the twelve numbers of a column are no multiple of eight. A pack wider than the vectors that a
/// function is compiled for would be split by way of memory.
template <typename Work>
[[gnu::always_inline]] inline void in_packs(const Work& work) noexcept {
  if (detail::kVectorBits == 512)
    detail::in_512_bits([&]() __attribute__((always_inline)) { work(detail::Bits<256>()); });
  else if (detail::kVectorBits == 256)
    detail::in_256_bits([&]() __attribute__((always_inline)) { work(detail::Bits<256>()); });
  else
    work(detail::Bits<128>());
}

#else

template <typename Loops>
void in_wide_vectors(const Loops& loops) noexcept {
  loops();
}

template <typename Work>
void in_packs(const Work& work) noexcept {
  work(detail::Bits<128>());
}

#endif

}  // namespace evmarker::simd
