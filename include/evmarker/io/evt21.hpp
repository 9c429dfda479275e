#pragma once
// Prophesee EVT2.1, reading only: 64-bit words of up to 32 events in a row.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

/// Decodes a stream of EVT2.1 words, piece by piece. Never yields an event off the sensor.
class Evt21Decoder {
 public:
  static constexpr std::size_t kWordBytes = 8;
  static constexpr std::size_t kMaxEventsPerWord = 32;

  /// @param halves_swapped the `legacy` byte order: the upper 32 bits of each word come first
  explicit Evt21Decoder(SensorSize size, bool halves_swapped = false) : size_(size), halves_swapped_(halves_swapped) {}

  /// Decodes the whole words of `bytes` into `room`, which holds kMaxEventsPerWord for each of them.
  /// @return number of events
  std::size_t decode(std::span<const std::byte> bytes, std::span<Event> room, std::vector<TriggerEvent>& triggers) {
    Event* out = room.data();
    const std::byte* const end = bytes.data() + bytes.size() / kWordBytes * kWordBytes;
    for (const std::byte* at = bytes.data(); at != end; at += kWordBytes) {
      std::uint64_t word = load_word<std::uint64_t>(at);
      if (halves_swapped_) word = std::rotl(word, 32);
      switch (static_cast<Evt2Word>(word >> 60U)) {
        case Evt2Word::cd_off:
        case Evt2Word::cd_on: out = decode_events(word, out); break;
        case Evt2Word::time_high:
          time_high_ = high_.unroll(static_cast<std::uint32_t>(word >> 32U) & 0x0FFFFFFFU) * 64;
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
  Timestamp time_of(std::uint64_t word) const noexcept {
    return time_high_ | static_cast<Timestamp>((word >> 54U) & 0x3FU);
  }

  Event* decode_events(std::uint64_t word, Event* out) noexcept {
    auto valid = static_cast<std::uint32_t>(word);
    if (!time_known_) {
      statistics_.dropped_before_time += static_cast<std::uint64_t>(std::popcount(valid));
      return out;
    }
    const int x = static_cast<int>((word >> 43U) & 0x7FFU), y = static_cast<int>((word >> 32U) & 0x7FFU);
    const Timestamp t = time_of(word);
    const Event* const first = out;
    for (; valid != 0; valid &= valid - 1) {
      const int column = x + std::countr_zero(valid);
      if (size_.contains(column, y))
        *out++ = {static_cast<std::uint16_t>(column), static_cast<std::uint16_t>(y),
                  static_cast<std::int16_t>(word >> 60U), t};
      else
        ++statistics_.off_sensor;
    }
    if (out == first) return out;
    statistics_.time_steps_back += t < last_ ? 1U : 0U;
    last_ = t;
    return out;
  }

  void decode_trigger(std::uint64_t word, std::vector<TriggerEvent>& triggers) {
    if (!time_known_) {
      ++statistics_.dropped_before_time;
      return;
    }
    ++statistics_.triggers;
    triggers.push_back({static_cast<int>((word >> 40U) & 0x1FU), ((word >> 32U) & 1U) != 0, time_of(word)});
  }

  SensorSize size_;
  bool halves_swapped_;
  TimeHighDecoder<28> high_;
  Timestamp time_high_ = 0, last_ = 0;
  bool time_known_ = false;
  RecordingStatistics statistics_;
};

}  // namespace evmarker::io
