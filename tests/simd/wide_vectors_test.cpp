#include "evmarker/simd/wide_vectors.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <cstddef>

namespace simd = evmarker::simd;

namespace {

using Numbers = std::array<double, 64>;

[[gnu::always_inline]] inline void polynomial(const Numbers& x, Numbers& y) noexcept {
  for (std::size_t i = 0; i < x.size(); ++i) y[i] = (x[i] * x[i] + 3) / (1 + x[i]) - x[i] * 0.25;
}

}  // namespace

TEST_CASE("whatever the processor has, the loops give the same to rounding") {
  Numbers x, expected, wide;
  for (std::size_t i = 0; i < x.size(); ++i) x[i] = std::sqrt(static_cast<double>(i));
  polynomial(x, expected);
  wide.fill(-1);
  simd::in_wide_vectors([&]() __attribute__((always_inline)) { polynomial(x, wide); });
  for (std::size_t i = 0; i < x.size(); ++i) {
    CAPTURE(i);
    CHECK(wide[i] == doctest::Approx(expected[i]).epsilon(1e-14));
  }
}

#if defined(__GNUC__) && defined(__x86_64__)
TEST_CASE("every width that the processor has gives the same to rounding") {
  namespace detail = evmarker::simd::detail;
  MESSAGE("vectors of " << detail::kVectorBits << " bits");
  const bool known = detail::kVectorBits == 128 || detail::kVectorBits == 256 || detail::kVectorBits == 512;
  CHECK(known);
  Numbers x, expected;
  for (std::size_t i = 0; i < x.size(); ++i) x[i] = std::sqrt(static_cast<double>(i));
  polynomial(x, expected);
  const auto check = [&](auto run) {
    Numbers y;
    y.fill(-1);
    run([&]() __attribute__((always_inline)) { polynomial(x, y); });
    for (std::size_t i = 0; i < x.size(); ++i) CHECK(y[i] == doctest::Approx(expected[i]).epsilon(1e-14));
  };
  if (detail::kVectorBits >= 256) check([](const auto& loops) { detail::in_256_bits(loops); });
  if (detail::kVectorBits >= 512) check([](const auto& loops) { detail::in_512_bits(loops); });
}
#endif
