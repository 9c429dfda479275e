#pragma once
// Opens recordings, and refuses those that do not fit the calibration, or are garbled.
#include <cstdint>
#include <evmarker/events/event.hpp>
#include <evmarker/io/event_reader.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "interruption.hpp"
#include "reader_options.hpp"

namespace recording_checks {

inline std::string show(evmarker::SensorSize size) {
  return std::to_string(size.width) + " x " + std::to_string(size.height) + " px";
}

/// @throws std::runtime_error naming both files and both sizes
inline void require_size(evmarker::SensorSize recorded, const std::string& path, evmarker::SensorSize camera_size,
                         const std::string& camera_path) {
  if (recorded == camera_size) return;
  throw std::runtime_error(path + ": recorded with " + show(recorded) + ", but " + camera_path + " says " +
                           show(camera_size));
}

/// Opens a recording, which ends when the program is interrupted.
/// @param size for a recording that does not state its own
/// @throws std::runtime_error where it cannot be read, or an option is for others
inline evmarker::io::EventReader open(const std::string& path, std::optional<evmarker::SensorSize> size,
                                      const ReaderOptions& options) {
  try {
    evmarker::io::EventReader recording(path, options.options(size));
    options.require_meaning(recording.kind(), path);
    return recording;
  } catch (const evmarker::io::RecordingError&) {
    if (interruption::requested) interruption::end(0, {});  // while a FIFO was silent, which then seems to be cut off
    throw;
  }
}

/// The same of a recording that is to be tracked.
/// @throws std::runtime_error where it cannot be read or its size is not that of the camera
inline evmarker::io::EventReader open(const std::string& path, evmarker::SensorSize camera_size,
                                      const std::string& camera_path, const ReaderOptions& options) {
  evmarker::io::EventReader recording = open(path, std::optional(camera_size), options);
  require_size(recording.sensor_size(), path, camera_size, camera_path);
  return recording;
}

/// A lost packet garbles a few words, which are counted and reported; more than 1 % are an error.
/// @param size_from what states the size of the sensor, such as the calibration
/// @param at_end also checks recordings that are too short for a share of 1 % to mean anything
/// @throws std::runtime_error naming the file and the counts
inline void require_sane(const evmarker::io::EventReader& recording, const std::string& path,
                         const std::string& size_from, bool at_end) {
  const auto s = recording.statistics();
  const std::uint64_t seen = s.events + s.off_sensor + s.dropped_before_time + s.unknown_words;
  if (!at_end && seen < 100000) return;
  const auto fail = [&](const std::string& reason) { throw std::runtime_error(path + ": " + reason); };
  const auto too_many = [&](std::uint64_t count) { return count * 100 > seen; };
  if (too_many(s.unknown_words))
    fail("garbled: " + std::to_string(s.unknown_words) + " words of unknown type beside " + std::to_string(s.events) +
         " events");
  if (too_many(s.off_sensor))
    fail(std::to_string(s.off_sensor) + " of " + std::to_string(s.events + s.off_sensor) +
         " events are off the sensor of " + show(recording.sensor_size()) + " in " + size_from);
  if (s.events == 0)
    fail("no events in it" + (s.dropped_before_time > 0
                                  ? " but " + std::to_string(s.dropped_before_time) + " before the first time stamp"
                                  : std::string()));
}

}  // namespace recording_checks
