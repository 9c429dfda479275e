#pragma once
// The fields of a line of text.
#include <algorithm>
#include <charconv>
#include <concepts>
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

/// The number that the whole text is; nothing where it is none, or one that the type cannot hold.
template <typename Number>
std::optional<Number> parse_as(std::string_view text) {
  Number value{};
#ifndef __cpp_lib_to_chars  // libc++'s from_chars takes whole numbers only
  if constexpr (std::floating_point<Number>) {
    std::istringstream stream{std::string(text)};
    stream.imbue(std::locale::classic());
    if (!(stream >> std::noskipws >> value) || stream.peek() != std::istringstream::traits_type::eof())
      return std::nullopt;
    return value;
  } else
#endif
  {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
    return value;
  }
}

/// 1 and 0 of Python's `True` and `False` and the like; nothing for any other text.
constexpr std::optional<int> parse_truth(std::string_view text) {
  if (text == "True" || text == "true" || text == "TRUE") return 1;
  if (text == "False" || text == "false" || text == "FALSE") return 0;
  return std::nullopt;
}

}  // namespace evmarker::io::detail
