#pragma once
// Decimal numbers to integers of a smaller unit, exactly: seconds in a text file to microseconds.
#include <cstdint>
#include <optional>
#include <string_view>

namespace evmarker::io {

/// `text` times 10^`places`, rounded half away from zero, never through floating point; nothing where `text` is not a
/// number like `-12.5` or `1.25e-3`, or where the result exceeds 63 bits.
/// @param places 6 to read seconds as microseconds
constexpr std::optional<std::int64_t> parse_decimal(std::string_view text, int places) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);

  // Value = digits * 10^exponent; from the 20th digit on they are below every unit asked for.
  std::uint64_t digits = 0;
  int exponent = 0, used = 0;
  bool any = false, point = false;
  for (; !text.empty(); text.remove_prefix(1)) {
    const char c = text.front();
    if (c == '.' && !point) {
      point = true;
      continue;
    }
    if (!is_digit(c)) break;
    any = true;
    if (used < 19) {
      digits = digits * 10 + static_cast<std::uint64_t>(c - '0');
      if (digits != 0) ++used;
      exponent -= point ? 1 : 0;
    } else if (!point) {
      ++exponent;
    }
  }
  if (!any) return std::nullopt;
  if (text.starts_with('e') || text.starts_with('E')) {
    text.remove_prefix(1);
    const bool down = text.starts_with('-');
    if (down || text.starts_with('+')) text.remove_prefix(1);
    if (text.empty() || text.size() > 4) return std::nullopt;
    int power = 0;
    for (; !text.empty() && is_digit(text.front()); text.remove_prefix(1)) power = power * 10 + (text.front() - '0');
    exponent += down ? -power : power;
  }
  if (!text.empty()) return std::nullopt;

  exponent += places;
  constexpr std::uint64_t kMax = INT64_MAX;
  for (; exponent > 0 && digits != 0; --exponent) {
    if (digits > kMax / 10) return std::nullopt;
    digits *= 10;
  }
  if (exponent < 0) {
    for (; exponent < -1 && digits != 0; ++exponent) digits /= 10;
    digits = digits / 10 + (digits % 10 >= 5 ? 1 : 0);
  }
  if (digits > kMax) return std::nullopt;
  const auto value = static_cast<std::int64_t>(digits);
  return negative ? -value : value;
}

}  // namespace evmarker::io
