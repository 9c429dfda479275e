#pragma once
// Counts of what a reader delivered and what it dropped.
#include <cstdint>

namespace evmarker::io {

/// Counts since the recording was opened. Whatever is not delivered is counted here.
struct RecordingStatistics {
  std::uint64_t events = 0;               ///< delivered
  std::uint64_t triggers = 0;             ///< delivered external trigger events
  std::uint64_t dropped_before_time = 0;  ///< events and triggers before the first time word: their time is unknown
  std::uint64_t off_sensor = 0;           ///< events outside the sensor, or before the first row of EVT3: dropped
  std::uint64_t time_steps_back = 0;      ///< events earlier than the event delivered before them: delivered unchanged
  std::uint64_t unknown_words = 0;        ///< words of a type that the format does not define: skipped
  std::uint64_t garbled_times = 0;        ///< time words that jump and that the next ones contradict: not followed
  std::uint64_t truncated_bytes = 0;      ///< bytes of an incomplete word or line at the end: the recording was cut off

  constexpr bool operator==(const RecordingStatistics&) const = default;
};

}  // namespace evmarker::io
