#pragma once
// Decimal numbers as integers of a smaller unit, exactly: seconds in a text file as microseconds.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace evmarker::io {

namespace detail {

/// The number digits * 10^exponent.
struct Decimal {
  std::uint64_t digits = 0;
  int exponent = 0;
};

constexpr bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Removes a leading sign. True where it is a minus.
constexpr bool consume_sign(std::string_view& text) {
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);
  return negative;
}

/// Removes leading digits, those of the fraction or those before the point, and appends them to `number`.
/// @return how many there are
constexpr std::size_t consume_digits(std::string_view& text, Decimal& number, bool fraction) {
  constexpr std::uint64_t kFull = 1'000'000'000'000'000'000;  // has 19 digits; further ones are below every unit
  std::size_t count = 0;
  for (; count < text.size() && is_digit(text[count]); ++count) {
    const bool fits = number.digits < kFull;
    if (fits) number.digits = number.digits * 10 + static_cast<std::uint64_t>(text[count] - '0');
    number.exponent += (fraction ? 0 : 1) - (fits ? 1 : 0);
  }
  text.remove_prefix(count);
  return count;
}

/// Removes an exponent like `e-3`: -3. 0 where there is none, nothing where it is malformed or has too many digits.
constexpr std::optional<int> consume_exponent(std::string_view& text) {
  if (!text.starts_with('e') && !text.starts_with('E')) return 0;
  text.remove_prefix(1);
  const bool negative = consume_sign(text);
  if (text.empty() || text.size() > 4) return std::nullopt;
  int power = 0;
  for (; !text.empty() && is_digit(text.front()); text.remove_prefix(1)) power = power * 10 + (text.front() - '0');
  return negative ? -power : power;
}

/// The number as an integer, rounded half up; nothing where it exceeds 63 bits.
constexpr std::optional<std::int64_t> round_to_integer(Decimal number) {
  constexpr std::uint64_t kMax = INT64_MAX;
  auto [digits, exponent] = number;
  for (; exponent > 0 && digits != 0; --exponent) {
    if (digits > kMax / 10) return std::nullopt;
    digits *= 10;
  }
  if (exponent < 0) {
    for (; exponent < -1 && digits != 0; ++exponent) digits /= 10;
    digits = digits / 10 + (digits % 10 >= 5 ? 1 : 0);
  }
  if (digits > kMax) return std::nullopt;
  return static_cast<std::int64_t>(digits);
}

/// The number of a text like `-12.5` or `1.25e-3`, without its sign; nothing where it is none.
constexpr std::optional<Decimal> parse_magnitude(std::string_view text) {
  Decimal number;
  std::size_t digits = consume_digits(text, number, false);
  if (text.starts_with('.')) {
    text.remove_prefix(1);
    digits += consume_digits(text, number, true);
  }
  if (digits == 0) return std::nullopt;
  const auto power = consume_exponent(text);
  if (!power || !text.empty()) return std::nullopt;
  number.exponent += *power;
  return number;
}

constexpr bool is_whole(Decimal number) {
  for (; number.exponent < 0 && number.digits % 10 == 0 && number.digits != 0; ++number.exponent) number.digits /= 10;
  return number.exponent >= 0 || number.digits == 0;
}

}  // namespace detail

/// `text` times 10^`places`, rounded half away from zero, without floating point; nothing where `text` is not a number
/// like `-12.5` or `1.25e-3`, or where the result exceeds 63 bits.
/// @param places 6 to read seconds as microseconds
constexpr std::optional<std::int64_t> parse_decimal(std::string_view text, int places) {
  const bool negative = detail::consume_sign(text);
  auto number = detail::parse_magnitude(text);
  if (!number) return std::nullopt;
  number->exponent += places;
  const auto magnitude = detail::round_to_integer(*number);
  return negative && magnitude ? -*magnitude : magnitude;
}

/// The whole number of a text like `12`, `12.0` or `1.2e+01`; nothing where it is not whole or exceeds 63 bits.
constexpr std::optional<std::int64_t> parse_whole(std::string_view text) {
  const bool negative = detail::consume_sign(text);
  const auto number = detail::parse_magnitude(text);
  if (!number || !detail::is_whole(*number)) return std::nullopt;
  const auto magnitude = detail::round_to_integer(*number);
  return negative && magnitude ? -*magnitude : magnitude;
}

}  // namespace evmarker::io
