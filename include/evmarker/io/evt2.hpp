#pragma once
// Prophesee EVT2: one 32-bit word for each event.
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

/// Type of an EVT2 word, its bits 31..28.
enum class Evt2Word : std::uint32_t { cd_off = 0, cd_on = 1, time_high = 8, trigger = 10, others = 14, continued = 15 };

/// Decodes a stream of EVT2 words, piece by piece. Never yields an event off the sensor.
class Evt2Decoder {
 public:
  static constexpr std::size_t kWordBytes = 4;
  static constexpr std::size_t kMaxEventsPerWord = 1;

  explicit Evt2Decoder(SensorSize size) : size_(size) {}

  /// Decodes the whole words of `bytes` into `room`, which holds kMaxEventsPerWord for each of them.
  /// @return number of events
  std::size_t decode(std::span<const std::byte> bytes, std::span<Event> room, std::vector<TriggerEvent>& triggers) {
    Event* out = room.data();
    const std::byte* const end = bytes.data() + bytes.size() / kWordBytes * kWordBytes;
    for (const std::byte* at = bytes.data(); at != end; at += kWordBytes) {
      const auto word = load_word<std::uint32_t>(at);
      switch (static_cast<Evt2Word>(word >> 28U)) {
        case Evt2Word::cd_off:
        case Evt2Word::cd_on: out += decode_event(word, *out); break;
        case Evt2Word::time_high:
          time_high_ = high_.unroll(word & 0x0FFFFFFFU) * 64;
          time_known_ = true;
          break;
        case Evt2Word::trigger: decode_trigger(word, triggers); break;
        case Evt2Word::others:
        case Evt2Word::continued: break;
        default: ++statistics_.unknown_words;
      }
    }
    const auto count = static_cast<std::size_t>(out - room.data());
    statistics_.events += count;
    return count;
  }

  /// Appends to `events` and `triggers`. @return bytes decoded: the whole words
  std::size_t decode(std::span<const std::byte> bytes, std::vector<Event>& events,
                     std::vector<TriggerEvent>& triggers) {
    return decode_append(*this, bytes, events, triggers);
  }

  const RecordingStatistics& statistics() const noexcept { return statistics_; }

 private:
  std::size_t decode_event(std::uint32_t word, Event& event) noexcept {
    if (!time_known_) return ++statistics_.dropped_before_time, 0;
    const std::uint32_t x = (word >> 11U) & 0x7FFU, y = word & 0x7FFU;
    if (!size_.contains(static_cast<int>(x), static_cast<int>(y))) return ++statistics_.off_sensor, 0;
    const Timestamp t = time_high_ | ((word >> 22U) & 0x3FU);
    statistics_.time_steps_back += t < last_ ? 1U : 0U;
    last_ = t;
    event = {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(word >> 28U), t};
    return 1;
  }

  void decode_trigger(std::uint32_t word, std::vector<TriggerEvent>& triggers) {
    if (!time_known_) {
      ++statistics_.dropped_before_time;
      return;
    }
    ++statistics_.triggers;
    triggers.push_back(
        {static_cast<int>((word >> 8U) & 0x1FU), (word & 1U) != 0, time_high_ | ((word >> 22U) & 0x3FU)});
  }

  SensorSize size_;
  TimeHighDecoder<28> high_;
  Timestamp time_high_ = 0, last_ = 0;
  bool time_known_ = false;
  RecordingStatistics statistics_;
};

/// Writes events as EVT2 words. The caller has checked that they lie on a sensor of at most 2048 x 2048 px.
class Evt2Encoder {
 public:
  /// Appends the words of the events, in their order. @throws std::invalid_argument naming a time that EVT2 cannot hold
  void encode(std::span<const Event> events, std::vector<std::byte>& bytes) {
    for (const Event& event : events) {
      go_to(event.t, bytes);
      const auto type = static_cast<std::uint32_t>(event.p > 0 ? Evt2Word::cd_on : Evt2Word::cd_off);
      append_word<std::uint32_t>(
          bytes, type << 28U | time_low(event.t) << 22U | std::uint32_t{event.x} << 11U | std::uint32_t{event.y});
    }
  }

  /// @throws std::invalid_argument where the id is not in 0..31 or EVT2 cannot hold the time
  void encode(const TriggerEvent& trigger, std::vector<std::byte>& bytes) {
    if (trigger.id < 0 || trigger.id > 31)
      throw std::invalid_argument("trigger: id is " + std::to_string(trigger.id) + ", EVT2 holds 0..31");
    go_to(trigger.t, bytes);
    append_word<std::uint32_t>(bytes, static_cast<std::uint32_t>(Evt2Word::trigger) << 28U |
                                          time_low(trigger.t) << 22U | static_cast<std::uint32_t>(trigger.id) << 8U |
                                          (trigger.rising ? 1U : 0U));
  }

 private:
  static std::uint32_t time_low(Timestamp t) noexcept { return static_cast<std::uint32_t>(t & 0x3F); }

  void go_to(Timestamp t, std::vector<std::byte>& bytes) {
    if (t < 0) throw std::invalid_argument("EVT2: t is " + std::to_string(t) + " us, must not be negative");
    try {
      high_.go_to(t >> 6, [&](std::uint32_t high) {
        append_word<std::uint32_t>(bytes, static_cast<std::uint32_t>(Evt2Word::time_high) << 28U | high);
      });
    } catch (const std::invalid_argument& reason) {
      throw std::invalid_argument("EVT2: t is " + std::to_string(t) + " us, which " + reason.what());
    }
  }

  TimeHighEncoder<28> high_;
};

}  // namespace evmarker::io
