#pragma once
// Layout of a text recording: separator, columns and unit of time, recognised from its first lines.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/raw_header.hpp"

namespace evmarker::io {

enum class TimeUnit { microseconds, seconds };

/// Layout of a text recording; whatever is not set is recognised from the file.
struct TextLayout {
  std::optional<char> separator = std::nullopt;  ///< comma, semicolon, tab, or a space for one blank or more
  std::string columns = {};                      ///< a letter for each column: x, y, p, t, or - to ignore it; `xypt`
  std::optional<TimeUnit> time_unit = std::nullopt;  ///< seconds where times have a decimal point
};

/// A complete layout, and what precedes the first event.
struct RecognizedText {
  char separator = ',';
  std::string columns;  ///< empty where they are not recognised: too few lines look like events
  TimeUnit time_unit = TimeUnit::microseconds;
  std::optional<SensorSize> size;  ///< from a line `%geometry:640,480` or a first line `640 480`
  std::size_t leading_lines = 0;   ///< lines to skip: comments, geometry, column names
};

namespace detail {

inline std::string_view trimmed(std::string_view text) {
  constexpr std::string_view blanks = " \t\r";
  const auto begin = text.find_first_not_of(blanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(blanks) - begin + 1);
}

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

/// The letter of a column named like `x`, `polarity`, `timestamp`, `t_us`, `time [s]`; `-` for any other.
inline char column_of(std::string_view name, std::optional<TimeUnit>& unit) {
  std::string word, suffix;
  for (const char c : name) {
    if (std::isalpha(static_cast<unsigned char>(c)) == 0) {
      if (!word.empty()) suffix += ' ';
      continue;
    }
    const char lower = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    (suffix.empty() ? word : suffix) += lower;
  }
  const std::string unit_name(trimmed(suffix));
  if (word == "x" || word == "y") return word[0];
  if (word == "p" || word == "pol" || word == "polarity" || word == "on") return 'p';
  if (word != "t" && word != "ts" && word != "time" && word != "timestamp") return '-';
  if (unit_name == "us") unit = TimeUnit::microseconds;
  if (unit_name == "s" || unit_name == "sec" || unit_name == "seconds") unit = TimeUnit::seconds;
  return 't';
}

inline bool is_polarity(std::string_view field) { return field == "0" || field == "1" || field == "-1"; }

/// `xypt` or `txyp`, whichever fits more of the sampled lines; empty where neither fits half of them, so that a few
/// malformed lines are left to the reader to report. Where both fit equally, `txyp` for blanks and `xypt` otherwise.
inline std::string guess_columns(const std::vector<std::vector<std::string_view>>& lines, char separator) {
  std::size_t xypt = 0, txyp = 0;
  for (const auto& fields : lines) {
    if (fields.size() != 4) continue;
    const bool time_first = fields[0].find('.') != std::string_view::npos;
    if (is_polarity(fields[2]) && !time_first) ++xypt;
    if (is_polarity(fields[3])) ++txyp;
  }
  if (2 * std::max(xypt, txyp) < lines.size() || lines.empty()) return "";
  if (xypt == txyp) return separator == ' ' ? "txyp" : "xypt";
  return xypt > txyp ? "xypt" : "txyp";
}

}  // namespace detail

/// Completes `layout` from the beginning of a file.
/// @param head whole lines; an incomplete last line is ignored unless it is the only one
inline RecognizedText recognize_text(std::string_view head, const TextLayout& layout = {}) {
  constexpr std::size_t kSamples = 200;
  RecognizedText found;
  std::string columns = layout.columns;
  std::optional<TimeUnit> unit = layout.time_unit, named_unit;
  std::vector<std::vector<std::string_view>> samples;
  if (layout.separator) found.separator = *layout.separator;

  std::size_t line_number = 0;
  while (!head.empty() && samples.size() < kSamples) {
    const auto end = head.find('\n');
    if (end == std::string_view::npos && !samples.empty()) break;
    const std::string_view line = detail::trimmed(head.substr(0, end));
    head.remove_prefix(std::min(end, head.size() - 1) + 1);
    ++line_number;
    if (line.starts_with("%geometry:")) found.size = detail::parse_geometry(line.substr(10), ',');
    if (line.empty() || line.front() == '#' || line.front() == '%') continue;
    if (samples.empty() && !layout.separator) found.separator = detail::separator_of(line);
    auto fields = detail::split(line, found.separator);
    if (samples.empty()) {
      const bool names = std::isalpha(static_cast<unsigned char>(line.front())) != 0;
      const bool size_line = fields.size() == 2 && !found.size && !names;
      if (names && columns.empty())
        for (const std::string_view name : fields) columns += detail::column_of(name, named_unit);
      if (size_line && detail::parse_positive(fields[0]) && detail::parse_positive(fields[1]))
        found.size = SensorSize{*detail::parse_positive(fields[0]), *detail::parse_positive(fields[1])};
      if (names || (size_line && found.size)) {
        found.leading_lines = line_number;
        continue;
      }
    }
    samples.push_back(std::move(fields));
  }

  found.columns = columns.empty() ? detail::guess_columns(samples, found.separator) : columns;
  if (!unit) unit = named_unit;
  const auto t = found.columns.find('t');
  const bool point = std::ranges::any_of(samples, [&](const auto& fields) {
    return t < fields.size() && fields[t].find_first_of(".eE") != std::string_view::npos;
  });
  found.time_unit = unit.value_or(point ? TimeUnit::seconds : TimeUnit::microseconds);
  return found;
}

}  // namespace evmarker::io
