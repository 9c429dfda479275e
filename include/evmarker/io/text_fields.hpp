#pragma once
// The fields of a line of text.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <locale>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace evmarker::io::detail {

inline std::string_view trimmed(std::string_view text) {
  constexpr std::string_view blanks = " \t\r";
  const auto begin = text.find_first_not_of(blanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(blanks) - begin + 1);
}

/// Without the quotation marks around it, if there are any.
inline std::string_view unquoted(std::string_view text) {
  for (const char mark : {'"', '\''})
    if (text.size() >= 2 && text.front() == mark && text.back() == mark) return text.substr(1, text.size() - 2);
  return text;
}

/// Comma, semicolon, or a space, which stands for one blank or more.
inline char separator_of(std::string_view line) {
  for (const char c : {',', ';'})
    if (line.find(c) != std::string_view::npos) return c;
  return ' ';
}

inline std::vector<std::string_view> split(std::string_view line, char separator) {
  std::vector<std::string_view> fields;
  const bool blank = separator == ' ' || separator == '\t';
  line = trimmed(line);
  while (!line.empty()) {
    const auto end = std::min(blank ? line.find_first_of(" \t") : line.find(separator), line.size());
    fields.push_back(trimmed(line.substr(0, end)));
    line.remove_prefix(std::min(end + 1, line.size()));
    if (blank) line = trimmed(line);
  }
  return fields;
}

using std::from_chars;
#ifndef __cpp_lib_to_chars
/// As the standard's, which libc++ has for whole numbers only; it takes the whole text or nothing.
inline std::from_chars_result from_chars(const char* begin, const char* end, double& value) {
  const std::string text(begin, end);
  if (text.starts_with('+') || text.find_first_of("xX") != text.npos) return {begin, std::errc::invalid_argument};
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  stream >> std::noskipws >> value;
  const bool tiny = value != 0 && std::abs(value) < std::numeric_limits<double>::min();  // which counts as a failure
  if (stream.fail() && !tiny) return {begin, std::errc::invalid_argument};
  stream.clear();
  return {stream.peek() == std::istringstream::traits_type::eof() ? end : begin, {}};
}
#endif

/// The decimal number that the whole text is; nothing where it is none, or one that the type cannot hold.
template <typename Number>
std::optional<Number> parse_as(std::string_view text) {
  Number value{};
  const auto [end, error] = from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// 1 and 0 of Python's `True` and `False` and the like; nothing for any other text.
constexpr std::optional<int> parse_truth(std::string_view text) {
  if (text == "True" || text == "true" || text == "TRUE") return 1;
  if (text == "False" || text == "false" || text == "FALSE") return 0;
  return std::nullopt;
}

}  // namespace evmarker::io::detail
