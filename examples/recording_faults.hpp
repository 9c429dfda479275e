#pragma once
// Says what is wrong with a recording, a line for each kind of fault that there is.
#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <evmarker/io/recording_statistics.hpp>

namespace recording_faults {

/// What RecordedTime leaves out.
inline constexpr const char* kStray = "events of stray times, far from the others': not counted as recorded time";

/// Prints nothing for a count of 0.
inline void print(std::uint64_t count, const char* what, std::FILE* to = stdout) {
  if (count > 0) std::fprintf(to, "recording  %" PRIu64 " %s\n", count, what);
}

inline void print(const evmarker::io::RecordingStatistics& s, std::FILE* to = stdout) {
  print(s.time_steps_back, "steps back in time", to);
  print(s.off_sensor, "events off the sensor, dropped", to);
  print(s.dropped_before_time, "events before the first time stamp, dropped", to);
  print(s.unknown_words, "unknown words, skipped", to);
  print(s.garbled_times, "time words that the next ones contradict, not followed", to);
  print(s.truncated_bytes, "bytes at the end that are no whole event: the file was cut", to);
}

}  // namespace recording_faults
