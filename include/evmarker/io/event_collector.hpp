#pragma once
// Gathers the events of a batch, and counts what is not delivered.
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_statistics.hpp"
#include "evmarker/io/time_shift.hpp"

namespace evmarker::io {

/// The events and triggers of a batch, as readers deliver them: on the sensor, in the order of the file, counted.
class EventCollector {
 public:
  /// @param path only named in errors
  EventCollector(std::filesystem::path path, bool shift_first_time_to_zero)
      : path_(std::move(path)), shift_(shift_first_time_to_zero) {}

  void set_sensor_size(SensorSize size) noexcept { size_ = size; }
  SensorSize sensor_size() const noexcept { return size_; }
  void start_batch() noexcept {
    events_.clear();
    triggers_.clear();
  }

  /// @throws RecordingError where a shifted time does not fit into 64 bits
  void add(std::int64_t x, std::int64_t y, bool on, Timestamp t) {
    if (x < 0 || x >= size_.width || y < 0 || y >= size_.height) {
      ++statistics.off_sensor;
      return;
    }
    const Timestamp shifted = shift(t);
    statistics.time_steps_back += statistics.events > 0 && t < last_ ? 1U : 0U;
    last_ = t;
    ++statistics.events;
    events_.push_back(
        {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(on ? 1 : 0), shifted});
  }

  /// @throws RecordingError where a batch has so many triggers that they are no recording's
  void add(TriggerEvent trigger) {
    if (triggers_.size() > kMaxTriggers)
      throw RecordingError(path_, "garbled: " + std::to_string(triggers_.size()) + " triggers among " +
                                      std::to_string(events_.size()) + " events");
    trigger.t = shift(trigger.t);
    ++statistics.triggers;
    triggers_.push_back(trigger);
  }

  std::span<const Event> events() const noexcept { return events_; }
  std::span<const TriggerEvent> triggers() const noexcept { return triggers_; }

  RecordingStatistics statistics;

 private:
  static constexpr std::size_t kMaxTriggers = std::size_t{1} << 20;  // in a batch: 16 MB, minutes of 1 kHz

  Timestamp shift(Timestamp t) {
    const auto shifted = shift_(t);
    if (!shifted) throw RecordingError(path_, shift_.fault(t));
    return *shifted;
  }

  std::filesystem::path path_;
  SensorSize size_;
  TimeShift shift_;
  Timestamp last_ = 0;
  std::vector<Event> events_;
  std::vector<TriggerEvent> triggers_;
};

}  // namespace evmarker::io
