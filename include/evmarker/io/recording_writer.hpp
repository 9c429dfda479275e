#pragma once
// What the writers of all kinds of recordings have in common.
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"

namespace evmarker::io {

/// Writes a recording. The file appears under its name in `close()`; a writer that is destroyed before that leaves
/// no file.
class RecordingWriter {
 public:
  virtual ~RecordingWriter() = default;

  /// @throws std::invalid_argument naming an event that is off the sensor or whose time the format cannot express
  /// @throws RecordingError where the disk is full
  virtual void write(std::span<const Event> events) = 0;
  /// Writes a trigger event between the events written before and after this call.
  /// @throws std::invalid_argument where the format has no triggers, or cannot express its id or time
  /// @throws RecordingError where the disk is full
  virtual void write_trigger(const TriggerEvent&) { throw std::invalid_argument("trigger: the format has none"); }
  /// Completes the file; calling it again does nothing.
  /// @throws RecordingError where the disk is full
  virtual void close() = 0;

  /// How many of the events, from the first on, can be written next; the time of the one behind them the format cannot
  /// express.
  virtual std::size_t count_writable(std::span<const Event> events) const = 0;
  virtual bool can_write(const TriggerEvent&) const { return false; }
  virtual SensorSize sensor_size() const noexcept = 0;
  virtual std::uint64_t events_written() const noexcept = 0;

 protected:
  RecordingWriter() = default;
  RecordingWriter(RecordingWriter&&) = default;
  RecordingWriter& operator=(RecordingWriter&&) = default;
};

}  // namespace evmarker::io
