#pragma once
// Layout of a text recording: separator, columns and unit of time, recognised from its first lines.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/column_names.hpp"
#include "evmarker/io/header_lines.hpp"
#include "evmarker/io/layout_guess.hpp"
#include "evmarker/io/text_fields.hpp"
#include "evmarker/io/time_unit.hpp"

namespace evmarker::io {

/// Layout of a text recording; whatever is not set is recognised from the file.
struct TextLayout {
  std::optional<char> separator = std::nullopt;  ///< comma, semicolon, tab, or a space for one blank or more
  std::string columns = {};                      ///< a letter for each column: x, y, p, t, or - to ignore it; `x,y,p,t`
  std::optional<TimeUnit> time_unit = std::nullopt;
};

/// A complete layout, and what precedes the first event.
struct RecognizedText {
  char separator = ',';
  std::string columns;  ///< a letter for each column, without commas
  TimeUnit time_unit = TimeUnit::microseconds;
  std::optional<SensorSize> size;  ///< from a line `%geometry:640,480` or a first line `640 480`
  std::size_t leading_lines = 0;   ///< lines to skip: comments, geometry, column names
  std::string fault = {};          ///< one line that says what cannot be recognised; empty where all is
};

namespace detail {

/// The first lines of a text recording, taken apart.
class TextHead {
 public:
  /// @param head whole lines; an incomplete last line is ignored unless it is the only one
  TextHead(std::string_view head, std::optional<char> separator) : given_(separator) {
    if (separator) text.separator = *separator;
    while (!head.empty() && samples.size() < kSamples) {
      const auto end = head.find('\n');
      if (end == std::string_view::npos && !samples.empty()) break;
      ++line_number_;
      read(trimmed(head.substr(0, end)));
      head.remove_prefix(std::min(end, head.size() - 1) + 1);
    }
  }

  RecognizedText text;
  NamedColumns names;
  bool metavision = false;  // true where there is a line %geometry
  Samples samples;

 private:
  static constexpr std::size_t kSamples = 10000;

  void read(std::string_view line) {
    constexpr std::string_view geometry = "%geometry:";
    if (line.starts_with(geometry)) {
      metavision = true;
      set_size(line.substr(geometry.size()), ',');
    } else if (line.starts_with('#') || line.starts_with('%')) {
      const auto named = name_columns(split(line.substr(1), separator_of(line)));
      if (samples.empty() && named.complete()) names = named;
    } else if (!line.empty()) {
      if (samples.empty() && !given_) text.separator = separator_of(line);
      const auto fields = split(line, text.separator);
      if (samples.empty() && is_heading(line, fields))
        text.leading_lines = line_number_;
      else
        add_sample(fields);
    }
  }

  void add_sample(const std::vector<std::string_view>& fields) {
    std::vector<double> sample;
    for (const std::string_view field : fields) sample.push_back(sample_of(unquoted(field)));
    samples.push_back(std::move(sample));
  }

  // The names of columns, or the sensor size alone.
  bool is_heading(std::string_view line, const std::vector<std::string_view>& fields) {
    const bool numbers =
        std::ranges::any_of(fields, [](auto field) { return !std::isnan(sample_of(unquoted(field))); });
    const bool name_line = !numbers && !names.complete(), size_line = numbers && fields.size() == 2 && !text.size;
    if (name_line) names = name_columns(fields);
    if (size_line) set_size(line, text.separator);
    return name_line || size_line;
  }

  void set_size(std::string_view value, char separator) {
    const auto sides = split(value, separator);
    const auto side = [&](std::size_t i) { return sides.size() == 2 ? parse_positive(sides[i]).value_or(0) : 0; };
    const SensorSize size{side(0), side(1)};
    const auto fits = [](int length) { return length >= 1 && length <= SensorSize::kMaxSide; };
    if (fits(size.width) && fits(size.height))
      text.size = size;
    else if (text.fault.empty())
      text.fault = "line " + std::to_string(line_number_) + ": sensor size is '" + std::string(value.substr(0, 40)) +
                   "', must be width and height in 1.." + std::to_string(SensorSize::kMaxSide) + " px";
  }

  std::optional<char> given_;
  std::size_t line_number_ = 0;
};

/// Completes the columns: those of the names or, where there are none, those that the samples fit.
inline void recognize_columns(TextHead& head, std::optional<SensorSize> size) {
  const std::size_t fields = head.samples.empty() ? 0 : head.samples.front().size();
  const bool first_is_index = first_column_counts(head.samples);
  RecognizedText& text = head.text;
  text.fault = "cannot recognise the columns x, y, p, t";
  if (head.names.complete()) {
    const bool unnamed_index = first_is_index && fields == head.names.letters.size() + 1;
    text.columns = (unnamed_index ? "-" : "") + head.names.letters;
  } else if (head.names.letters.empty()) {
    const auto orders = guess_columns(head.samples, first_is_index && fields == 5, size);
    if (orders.size() == 1) text.columns = orders.front();
    if (orders.size() > 1) text.fault = "the columns may be '" + orders[0] + "' or '" + orders[1] + "'";
  }
  text.fault += ": name them, --columns t,x,y,p (in the options: text_layout.columns)";
  if (!text.columns.empty()) text.fault.clear();
}

/// Completes the unit of time: the one that is named, unless no camera can be so fast, else the one in which the
/// samples are those of an event camera.
inline void recognize_time_unit(TextHead& head, std::optional<TimeUnit> named, std::optional<SensorSize> size) {
  const std::string& columns = head.text.columns;
  const std::size_t t = columns.find('t'), x = columns.find('x'), y = columns.find('y');
  std::vector<double> times;
  SensorSize seen;
  for (const std::vector<double>& line : head.samples) {
    if (line.size() != columns.size() || std::isnan(line[t])) continue;
    times.push_back(line[t]);
    if (line[x] < 2048 && line[x] >= seen.width) seen.width = static_cast<int>(line[x]) + 1;
    if (line[y] < 2048 && line[y] >= seen.height) seen.height = static_cast<int>(line[y]) + 1;
  }
  const auto unit = named ? named : guess_time_unit(times, size.value_or(seen), head.metavision);
  std::string& fault = head.text.fault;
  if (named) fault = unit_fault(std::move(times), *named, size.value_or(seen));
  if (!unit) fault = "cannot tell the unit of its times";
  if (!fault.empty()) fault += ": name it, --time-unit s|ms|us|ns (in the options: text_layout.time_unit)";
  if (unit) head.text.time_unit = *unit;
}

}  // namespace detail

/// Completes `layout` from the beginning of a file.
/// @param head whole lines; an incomplete last line is ignored unless it is the only one
/// @param size of the sensor where the file has none
inline RecognizedText recognize_text(std::string_view head, const TextLayout& layout = {},
                                     std::optional<SensorSize> size = std::nullopt) {
  detail::TextHead lines(head, layout.separator);
  if (lines.text.size) size = lines.text.size;
  for (const char c : layout.columns)
    if (c != ',' && c != ' ') lines.text.columns += c;
  if (!lines.text.fault.empty()) return lines.text;
  if (layout.columns.empty()) detail::recognize_columns(lines, size);
  if (NamedColumns{lines.text.columns}.complete())
    detail::recognize_time_unit(lines, layout.time_unit ? layout.time_unit : lines.names.time_unit, size);
  return lines.text;
}

}  // namespace evmarker::io
