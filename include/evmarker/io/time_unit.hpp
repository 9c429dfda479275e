#pragma once
// Units of the times in text.
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace evmarker::io {

enum class TimeUnit { seconds, milliseconds, microseconds, nanoseconds };

constexpr const char* to_string(TimeUnit unit) noexcept {
  switch (unit) {
    case TimeUnit::seconds: return "s";
    case TimeUnit::milliseconds: return "ms";
    case TimeUnit::microseconds: return "us";
    case TimeUnit::nanoseconds: return "ns";
  }
  return "?";
}

/// Places by which the decimal point moves to the right to make microseconds of a number.
constexpr int places_to_microseconds(TimeUnit unit) noexcept { return 6 - 3 * static_cast<int>(unit); }

/// The unit of a word in lower case like `ns`, `usec`, `milliseconds`, `µs`; nothing for any other word.
inline std::optional<TimeUnit> time_unit_named(std::string_view word) {
  constexpr std::array<std::pair<TimeUnit, std::string_view>, 4> names{{
      {TimeUnit::seconds, " s sec secs second seconds "},
      {TimeUnit::milliseconds, " ms msec msecs milli millis millisec millisecs millisecond milliseconds "},
      {TimeUnit::microseconds,
       " us usec usecs micro micros microsec microsecs microsecond microseconds "
       "\xC2\xB5s \xCE\xBCs "},  // micro sign, Greek letter
      {TimeUnit::nanoseconds, " ns nsec nsecs nano nanos nanosec nanosecs nanosecond nanoseconds "},
  }};
  if (word.empty() || word.find(' ') != std::string_view::npos) return std::nullopt;
  const std::string between_blanks = ' ' + std::string(word) + ' ';
  for (const auto& [unit, words] : names)
    if (words.find(between_blanks) != std::string_view::npos) return unit;
  return std::nullopt;
}

}  // namespace evmarker::io
