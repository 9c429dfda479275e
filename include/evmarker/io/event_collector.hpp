#pragma once
// Gathers the events of a batch, and counts what is not delivered.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/packed_events.hpp"
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
    count_ = 0;
    triggers_.clear();
  }

  /// Adds one event; for many, of which most are usual, `add_each` and `add_filled` take less than half the time.
  /// @throws RecordingError where a shifted time does not fit into 64 bits
  void add(std::int64_t x, std::int64_t y, bool on, Timestamp t) {
    if (x < 0 || x >= size_.width || y < 0 || y >= size_.height) {
      ++statistics.off_sensor;
      return;
    }
    if (count_ == events_.size()) make_room(1);
    keep(static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), on, t);
  }

  /// Adds `count` events, of which `decode(i)` gives the i-th: as a file has it, of any polarity, on or off the sensor.
  /// @throws RecordingError where a shifted time does not fit into 64 bits; the events before it have been added
  template <typename Decode>
  void add_each(std::size_t count, const Decode& decode) {
    const std::span<Event> added = room(count);
    for_each_block(added, [&](std::size_t begin, std::span<Event> block) {
      UsualEvents usual(last_);
      for (std::size_t i = 0; i < block.size(); ++i) {
        const PackedEvent event = decode(begin + i);
        std::memcpy(static_cast<void*>(&block[i]), &event, sizeof event);
        usual.add(event);
      }
      keep_all(block, usual.all(size_));
    });
  }

  /// Room for `count` events behind those of the batch, to be filled from its begin and added by `add_filled`. Valid
  /// until anything else is called.
  std::span<Event> room(std::size_t count) {
    if (events_.size() < count_ + count) make_room(count);
    return std::span(events_).subspan(count_, count);
  }

  /// Adds the first `count` events of the last `room`: as `add_each`, of any polarity, on or off the sensor.
  /// @throws as `add_each`
  void add_filled(std::size_t count) {
    for_each_block(std::span(events_).subspan(count_, count),
                   [&](std::size_t, std::span<Event> block) { keep_all(block, are_usual(block, last_, size_)); });
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

  // Blocks are short, as one unusual event makes all of its block be looked at one by one.
  template <typename Work>
  static void for_each_block(std::span<Event> events, const Work& work) {
    constexpr std::size_t kBlock = 512;
    for (std::size_t begin = 0; begin < events.size(); begin += kBlock)
      work(begin, events.subspan(begin, std::min(kBlock, events.size() - begin)));
  }

  // Keeps events of the room, and moves them up to the last one kept if others before them were left out. All are kept
  // as they are if they are usual and no time is shifted, else one by one.
  void keep_all(std::span<const Event> events, bool all_usual) {
    if (all_usual && !shift_.wanted()) {
      if (events.data() != &events_[count_]) std::ranges::copy(events, &events_[count_]);
      last_ = events.back().t;
      statistics.events += events.size();
      count_ += events.size();
      return;
    }
    for (const Event& event : events) {
      if (size_.contains(event.x, event.y))
        keep(event.x, event.y, event.p > 0, event.t);
      else
        ++statistics.off_sensor;
    }
  }

  // Puts an event behind the last. By value, as it may have been in the very place that is written to.
  void keep(std::uint16_t x, std::uint16_t y, bool on, Timestamp t) {
    const Timestamp shifted = shift(t);
    statistics.time_steps_back += statistics.events > 0 && t < last_ ? 1U : 0U;
    last_ = t;
    ++statistics.events;
    events_[count_++] = {x, y, static_cast<std::int16_t>(on ? 1 : 0), shifted};
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
