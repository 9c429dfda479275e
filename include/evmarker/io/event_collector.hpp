#pragma once
// Gathers the events of a batch, and counts what is not delivered.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
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

/// An event as a file has it: its coordinates may be off the sensor.
struct RecordedEvent {
  std::int64_t x, y;
  bool on;
  Timestamp t;  ///< [us]
};

/// The events and triggers of a batch, as readers deliver them: on the sensor, in the order of the file, counted.
class EventCollector {
 public:
  /// @param path only named in errors
  EventCollector(std::filesystem::path path, bool shift_first_time_to_zero)
      : path_(std::move(path)), shift_(shift_first_time_to_zero) {}

  void set_sensor_size(SensorSize size) noexcept { size_ = size; }
  SensorSize sensor_size() const noexcept { return size_; }
  void start_batch() noexcept {
    count_ = 0;
    triggers_.clear();
  }

  /// Adds one event; `add_each`, which does the same to many, would take longer for it.
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
    if (count_ == events_.size()) make_room(1);
    events_[count_++] = {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
                         static_cast<std::int16_t>(on ? 1 : 0), shifted};
  }

  /// Adds as many events, of which `decode(i)` gives the i-th: three times as fast as one by one.
  /// @throws RecordingError where a shifted time does not fit into 64 bits; the events before it have been added
  template <typename Decode>
  void add_each(std::size_t count, const Decode& decode) {
    if (events_.size() < count_ + count) make_room(count);
    // Nothing in the loop branches on the events, and nothing in it is in memory but they.
    Event* const added = events_.data() + count_;
    const auto [width, height] = size_;
    std::size_t on_sensor = 0;
    std::uint64_t steps_back = 0;
    Timestamp last = statistics.events > 0 ? last_ : std::numeric_limits<Timestamp>::min();
    for (std::size_t i = 0; i < count; ++i) {
      const RecordedEvent event = decode(i);
      const bool inside = (event.x >= 0) & (event.x < width) & (event.y >= 0) & (event.y < height);
      added[on_sensor] = {static_cast<std::uint16_t>(event.x), static_cast<std::uint16_t>(event.y),
                          static_cast<std::int16_t>(event.on ? 1 : 0), event.t};
      steps_back += static_cast<std::uint64_t>(inside & (event.t < last));
      last = inside ? event.t : last;
      on_sensor += inside ? 1U : 0U;
    }
    last_ = last;
    statistics.time_steps_back += steps_back;
    statistics.off_sensor += count - on_sensor;
    if (shift_.wanted()) return keep_shifted(on_sensor);
    statistics.events += on_sensor;
    count_ += on_sensor;
  }

  /// @throws RecordingError where a batch has so many triggers that they are no recording's
  void add(TriggerEvent trigger) {
    if (triggers_.size() > kMaxTriggers)
      throw RecordingError(path_, "garbled: " + std::to_string(triggers_.size()) + " triggers among " +
                                      std::to_string(count_) + " events");
    trigger.t = shift(trigger.t);
    ++statistics.triggers;
    triggers_.push_back(trigger);
  }

  std::span<const Event> events() const noexcept { return std::span(events_).first(count_); }
  std::span<const TriggerEvent> triggers() const noexcept { return triggers_; }

  RecordingStatistics statistics;

 private:
  static constexpr std::size_t kMaxTriggers = std::size_t{1} << 20;  // in a batch: 16 MB, minutes of 1 kHz

  [[gnu::noinline]] void make_room(std::size_t count) { events_.resize(std::max(2 * events_.size(), count_ + count)); }

  // Keeps as many of the events behind the last.
  void keep_shifted(std::size_t events) {
    for (; events > 0; --events, ++count_, ++statistics.events) events_[count_].t = shift(events_[count_].t);
  }

  Timestamp shift(Timestamp t) {
    const auto shifted = shift_(t);
    if (!shifted) throw RecordingError(path_, shift_.fault(t));
    return *shifted;
  }

  std::filesystem::path path_;
  SensorSize size_;
  TimeShift shift_;
  Timestamp last_ = 0;
  std::vector<Event> events_;  // with room for more than there are
  std::size_t count_ = 0;
  std::vector<TriggerEvent> triggers_;
};

}  // namespace evmarker::io
