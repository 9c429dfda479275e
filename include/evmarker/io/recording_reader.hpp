#pragma once
// What the readers of all kinds of recordings have in common.
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

struct RecordingOptions {
  /// For recordings without sensor size; the size in a recording has precedence.
  std::optional<SensorSize> sensor_size = std::nullopt;
  /// True to subtract the time of the first event or trigger from all, which is OpenEB's default.
  bool shift_first_time_to_zero = false;
  /// Of a ROS recording, the topic whose events are read; empty for the only one that has events.
  std::string topic = {};
};

/// Reads a recording of any length in constant memory; an `EventSource`. A recording that was cut off yields all that
/// is whole before the cut; `statistics().truncated_bytes` is not 0 where the cut is within an event or packet.
class RecordingReader {
 public:
  using event_type = Event;

  virtual ~RecordingReader() = default;

  virtual SensorSize sensor_size() const = 0;
  /// The next events in the order of the file, valid until the next call; none at the end.
  /// @throws RecordingError naming what cannot be read, once all events before it are delivered
  virtual std::span<const Event> next_batch() = 0;
  /// Trigger events among the events of the last batch, or behind the last event of the file.
  virtual std::span<const TriggerEvent> triggers() const = 0;
  virtual RecordingStatistics statistics() const = 0;
  virtual std::uint64_t bytes_read() const = 0;
  /// Size of the file; 0 where it has none, like a pipe.
  virtual std::uint64_t bytes_total() const = 0;

 protected:
  RecordingReader() = default;
  RecordingReader(RecordingReader&&) = default;
  RecordingReader& operator=(RecordingReader&&) = default;
};

/// The size in the recording, else that of the options.
/// @param max_side most pixels a side that `encoding` can address
/// @throws RecordingError where there is neither, or it is out of range
inline SensorSize choose_sensor_size(std::optional<SensorSize> recorded, const RecordingOptions& options, int max_side,
                                     const char* encoding, const std::filesystem::path& path) {
  const auto size = recorded ? recorded : options.sensor_size;
  if (!size) throw RecordingError(path, "no sensor size in it: give it, --size 640,480 (in the options: sensor_size)");
  const auto fits = [&](int side) { return side >= 1 && side <= max_side; };
  if (fits(size->width) && fits(size->height)) return *size;
  throw RecordingError(path, "sensor size is " + std::to_string(size->width) + " x " + std::to_string(size->height) +
                                 " px, " + encoding + " addresses 1.." + std::to_string(max_side) + " a side");
}

}  // namespace evmarker::io
