#pragma once
// What the first lines of a text recording show where it has no names: the order of its columns, the unit of its times.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/text_fields.hpp"
#include "evmarker/io/time_unit.hpp"

namespace evmarker::io::detail {

/// So many times prove what is not customary.
inline constexpr std::size_t kManyTimes = 100;

/// The numbers of sampled lines; what is no number is NaN, `True` is 1.
using Samples = std::vector<std::vector<double>>;

inline double sample_of(std::string_view field) {
  if (const auto truth = parse_truth(field)) return *truth;
  const auto value = parse_as<double>(field);
  return value && std::isfinite(*value) ? *value : std::numeric_limits<double>::quiet_NaN();
}

/// Number of sampled lines that are events if the columns have this order: the polarity is 0, 1 or -1, the pixel is
/// whole and on a sensor of this size, if one is given, and the time is none before that of the line before.
inline std::size_t count_fitting(const Samples& lines, std::string_view order, std::optional<SensorSize> size) {
  const std::size_t x = order.find('x'), y = order.find('y'), p = order.find('p'), t = order.find('t');
  const auto is_pixel = [](double value, double side) {
    return value >= 0 && value < side && value == std::floor(value);
  };
  const double no_limit = std::numeric_limits<double>::infinity();
  std::size_t count = 0;
  double last = -no_limit;
  for (const std::vector<double>& line : lines) {
    if (line.size() != order.size() || std::isnan(line[t])) continue;
    const bool event = (std::abs(line[p]) == 1 || line[p] == 0) && is_pixel(line[x], size ? size->width : no_limit) &&
                       is_pixel(line[y], size ? size->height : no_limit);
    if (event && line[t] >= last) ++count;
    last = line[t];
  }
  return count;
}

/// The orders of columns that fit the sampled lines best, and at least a third of them. Several are a tie; none, that
/// these are no events, or that x and y are not side by side.
inline std::vector<std::string> guess_columns(const Samples& lines, bool first_is_index,
                                              std::optional<SensorSize> size) {
  const std::vector<std::string_view> customary{"xypt", "txyp", "xytp"}, others{"pxyt", "tpxy", "ptxy"};
  for (const auto* const orders : {&customary, &others})
    for (const auto on_sensor : {size, std::optional<SensorSize>()}) {
      std::vector<std::pair<std::size_t, std::string>> fits;
      for (const std::string_view order : *orders) {
        const std::string columns = (first_is_index ? "-" : "") + std::string(order);
        fits.emplace_back(count_fitting(lines, columns, on_sensor), columns);
      }
      const std::size_t best = std::ranges::max(fits).first;
      if (best == 0 || 3 * best < lines.size()) continue;
      std::vector<std::string> found;
      for (const auto& [count, columns] : fits)
        if (10 * count >= 9 * best) found.push_back(columns);
      return found;
    }
  return {};
}

/// True if the first column counts the lines.
inline bool first_column_counts(const Samples& lines) {
  for (std::size_t i = 0; i < lines.size(); ++i)
    if (lines[i].empty() || lines[i][0] != lines[0][0] + static_cast<double>(i)) return false;
  return lines.size() > 1 && (lines[0][0] == 0 || lines[0][0] == 1);
}

/// True if all times are whole milliseconds from each other, which no event camera's are.
inline bool is_coarse(const std::vector<double>& times, double milliseconds) {
  return std::ranges::all_of(times, [&](double t) {
    const double difference = (t - times.front()) * milliseconds;
    return std::abs(difference - std::round(difference)) < 5e-4;
  });
}

/// Events per second and pixel of the sampled times in this unit, without the first and last twentieth: a single wrong
/// time must not decide.
/// @param times ascending
inline double pixel_rate(const std::vector<double>& times, TimeUnit unit, SensorSize size) {
  const double pixels = std::max(128.0 * 128, static_cast<double>(size.width) * size.height);
  const double seconds = std::pow(10, places_to_microseconds(unit) - 6);
  const std::size_t first = times.size() / 20, last = times.size() - 1 - first;
  return static_cast<double>(last - first) / ((times[last] - times[first]) * seconds * pixels);
}

/// The units that make the sampled times those of an event camera: 0.01 to 100 events per second and pixel, resolved
/// finer than milliseconds.
/// @param times ascending
inline std::vector<TimeUnit> plausible_units(const std::vector<double>& times, SensorSize size) {
  std::vector<TimeUnit> units;
  for (const TimeUnit unit :
       {TimeUnit::seconds, TimeUnit::milliseconds, TimeUnit::microseconds, TimeUnit::nanoseconds}) {
    const double rate = pixel_rate(times, unit, size), milliseconds = std::pow(10, places_to_microseconds(unit) - 3);
    if (rate >= 0.01 && rate <= 100 && !is_coarse(times, milliseconds)) units.push_back(unit);
  }
  return units;
}

/// What shows that many sampled times are in a longer unit than this one, which is named: no event camera is so fast.
/// Empty if nothing does, as where all are the same.
inline std::string unit_fault(std::vector<double> times, TimeUnit unit, SensorSize size) {
  constexpr double kMost = 1e4;  // events per second and pixel
  if (unit == TimeUnit::seconds || times.size() < kManyTimes) return {};
  std::ranges::sort(times);
  const double rate = pixel_rate(times, unit, size);
  if (rate <= kMost || std::isinf(rate)) return {};
  return std::string("the unit of its times is not ") + to_string(unit) + ", in which its first " +
         std::to_string(times.size()) + " events would come faster than any camera's";
}

/// The unit of times whose column names none; nothing where the times do not show it.
/// @param metavision true for Metavision's CSV, with its line `%geometry`: whole numbers are microseconds
inline std::optional<TimeUnit> guess_time_unit(std::vector<double> times, SensorSize size, bool metavision) {
  constexpr std::size_t kFew = 10;  // events, which have no rate
  const bool whole = std::ranges::all_of(times, [](double t) { return t == std::floor(t); });
  const auto customary = whole ? TimeUnit::microseconds : TimeUnit::seconds;
  if (times.size() < 2 || (metavision && whole)) return customary;
  std::ranges::sort(times);
  const auto units = plausible_units(times, size);
  if (units.size() == 1 && (units[0] == customary || times.size() >= kManyTimes)) return units[0];
  const bool possible = units.empty() || std::ranges::find(units, customary) != units.end();
  if (times.size() < kFew && possible) return customary;
  return std::nullopt;
}

}  // namespace evmarker::io::detail
