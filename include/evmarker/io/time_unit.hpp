#pragma once
// Units of the times in text.
#include <array>
#include <optional>
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
constexpr std::optional<TimeUnit> time_unit_named(std::string_view word) noexcept {
  constexpr auto s = TimeUnit::seconds, ms = TimeUnit::milliseconds, us = TimeUnit::microseconds,
                 ns = TimeUnit::nanoseconds;
  constexpr std::array<std::pair<std::string_view, TimeUnit>, 18> words{{
      {"s", s},
      {"sec", s},
      {"second", s},  //
      {"ms", ms},
      {"msec", ms},
      {"milli", ms},
      {"millisec", ms},
      {"millisecond", ms},  //
      {"us", us},
      {"usec", us},
      {"micro", us},
      {"microsec", us},
      {"microsecond", us},  //
      {"ns", ns},
      {"nsec", ns},
      {"nano", ns},
      {"nanosec", ns},
      {"nanosecond", ns},
  }};
  for (const std::string_view mu : {"\xC2\xB5", "\xCE\xBC"})  // micro sign, Greek letter
    if (word.starts_with(mu))
      return word == mu                                     ? std::nullopt
             : time_unit_named(word.substr(mu.size())) == s ? std::optional(us)
                                                            : std::nullopt;
  if (word.size() > 2 && word.ends_with('s')) word.remove_suffix(1);
  for (const auto& [name, unit] : words)
    if (word == name) return unit;
  return std::nullopt;
}

}  // namespace evmarker::io
