#pragma once
// What a reader met in a recording besides the events it delivered.
#include <cstdint>

namespace evmarker::io {

/// Counts since the reader was opened; everything that is not handed on shows up here.
struct RecordingStatistics {
  std::uint64_t events = 0;               ///< delivered
  std::uint64_t triggers = 0;             ///< delivered external trigger events
  std::uint64_t dropped_before_time = 0;  ///< events and triggers before the first time word: their time is unknown
  std::uint64_t off_sensor = 0;       ///< events outside the sensor, or on a row that no word has named yet: dropped
  std::uint64_t time_steps_back = 0;  ///< events earlier than the delivered event before them: delivered as they are
  std::uint64_t unknown_words = 0;    ///< words of a type that the format does not define: skipped
  std::uint64_t truncated_bytes = 0;  ///< bytes at the end that are no whole word or line: the recording was cut

  constexpr bool operator==(const RecordingStatistics&) const = default;
};

}  // namespace evmarker::io
