#pragma once
// What the names of columns say about a text recording: which column is which, and the unit of time.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/io/text_fields.hpp"
#include "evmarker/io/time_unit.hpp"

namespace evmarker::io {

/// Columns by letters: x, y, p, t, or - for any other.
struct NamedColumns {
  std::string letters;
  std::optional<TimeUnit> time_unit = std::nullopt;  ///< nothing where the name does not contain one

  /// True if x, y, p and t are there once each.
  bool complete() const {
    return std::ranges::all_of(std::string_view("xypt"), [&](char c) { return std::ranges::count(letters, c) == 1; });
  }
};

namespace detail {

/// Words of a name in lower case: `time` and `ms` of `Time [ms]`, `t_ms` and `timeMs`.
inline std::vector<std::string> words_of(std::string_view name) {
  std::vector<std::string> words;
  char last = ' ';
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    const bool letter = std::isalpha(byte) != 0 || byte >= 0x80, last_lower = last >= 'a' && last <= 'z';
    const bool begins = last == ' ' || (last_lower && std::isupper(byte) != 0);
    if (letter && begins) words.emplace_back();
    if (letter) words.back() += static_cast<char>(std::tolower(byte));
    last = letter ? c : ' ';
  }
  return words;
}

inline void name_column(std::string_view name, NamedColumns& columns) {
  const std::vector<std::string> words = words_of(name);
  const auto is_any_of = [&](std::initializer_list<std::string_view> list) {
    return !words.empty() && std::ranges::find(list, words.front()) != list.end();
  };
  const bool is_unit = words.size() == 1 && words.front().size() > 1 && time_unit_named(words.front());
  if (is_any_of({"x", "xs"})) {
    columns.letters += 'x';
  } else if (is_any_of({"y", "ys"})) {
    columns.letters += 'y';
  } else if (is_any_of({"p", "ps", "pol", "polarity", "polarities", "on"})) {
    columns.letters += 'p';
  } else if (is_any_of({"t", "ts", "time", "times", "timestamp", "timestamps"}) || is_unit) {
    columns.letters += 't';
    for (const std::string& word : words)
      if (!columns.time_unit) columns.time_unit = time_unit_named(word);
  } else {
    columns.letters += '-';
  }
}

}  // namespace detail

/// Columns of names like `x`, `polarity`, `t_us`, `time [s]`, with or without quotation marks.
/// @param fields of the line; a unit that blanks set apart, as in `time [s]`, may be a field of its own
inline NamedColumns name_columns(const std::vector<std::string_view>& fields) {
  std::vector<std::string> names;
  for (const std::string_view field : fields) {
    const std::string_view name = detail::unquoted(field);
    const bool unit_apart = !names.empty() && (name.starts_with('[') || name.starts_with('('));
    if (unit_apart)
      names.back().append(" ").append(name);
    else
      names.emplace_back(name);
  }
  NamedColumns columns;
  for (const std::string& name : names) detail::name_column(name, columns);
  return columns;
}

}  // namespace evmarker::io
