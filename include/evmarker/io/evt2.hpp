#pragma once
// Prophesee EVT2, one event in each 32-bit word, and EVT2.1, up to 32 events of a row in each 64-bit word.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/event_checks.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

/// Type of an EVT2 word, its bits 31..28.
enum class Evt2Word : std::uint32_t { cd_off = 0, cd_on = 1, time_high = 8, trigger = 10, others = 14, continued = 15 };

/// Decodes a stream of EVT2 words (4 bytes) or EVT2.1 words (8 bytes), piece by piece; all events are on the sensor.
///
/// The upper half of an EVT2.1 word is an EVT2 word. In its lower half, bit i is set where pixel (x + i, y) has an
/// event.
template <std::size_t WordBytes>
class BasicEvt2Decoder {
  static constexpr bool kHasMask = WordBytes == 8;

 public:
  static constexpr std::size_t kWordBytes = WordBytes;
  static constexpr std::size_t kMaxEventsPerWord = kHasMask ? 32 : 1;

  explicit BasicEvt2Decoder(SensorSize size) : size_(size) {}

  /// @param halves_swapped true for `endianness=legacy`: the upper half of each word comes first
  BasicEvt2Decoder(SensorSize size, bool halves_swapped) requires(kHasMask)
      : size_(size), upper_half_at_(halves_swapped ? 0 : 4) {}

  /// Decodes the whole words of `bytes` into `buffer`, which has space for kMaxEventsPerWord events a word, and appends
  /// to `triggers`.
  /// @param following the bytes behind `bytes`, as far as they are known: they show whether a time word is garbled
  /// @return number of events
  std::size_t decode(std::span<const std::byte> bytes, std::span<Event> buffer, std::vector<TriggerEvent>& triggers,
                     std::span<const std::byte> following = {}) {
    Event* out = buffer.data();
    const std::byte* const end = bytes.data() + bytes.size() / kWordBytes * kWordBytes;
    for (const std::byte* at = bytes.data(); at != end; at += kWordBytes) {
      const auto word = load_word<std::uint32_t>(at + upper_half_at_);
      switch (static_cast<Evt2Word>(word >> 28U)) {
        case Evt2Word::cd_off:
        case Evt2Word::cd_on:
          out = decode_events(word, kHasMask ? load_word<std::uint32_t>(at + (4 - upper_half_at_)) : 1, out);
          break;
        case Evt2Word::time_high: decode_time_high(word, {at + kWordBytes, end}, following); break;
        case Evt2Word::trigger: decode_trigger(word, triggers); break;
        case Evt2Word::others:
        case Evt2Word::continued: break;
        default: ++statistics_.unknown_words;
      }
    }
    const auto count = static_cast<std::size_t>(out - buffer.data());
    statistics_.events += count;
    return count;
  }

  RecordingStatistics statistics() const noexcept {
    RecordingStatistics statistics = statistics_;
    statistics.garbled_times += time_high_decoder_.undone();
    return statistics;
  }

 private:
  Timestamp time_of(std::uint32_t word) const noexcept { return time_high_ | (word >> 22U & 0x3FU); }

  void decode_time_high(std::uint32_t word, std::span<const std::byte> rest, std::span<const std::byte> following) {
    const std::uint32_t high = word & kTimeHighMask;
    const auto find_next = [&] {
      const auto next = find_time_high(rest);
      return next ? next : find_time_high(following);
    };
    if (time_high_decoder_.is_garbled(high, find_next)) [[unlikely]] {
      ++statistics_.garbled_times;
      return;
    }
    time_high_ = time_high_decoder_.unwrap(high) * 64;
    time_known_ = true;
  }

  std::optional<std::uint32_t> find_time_high(std::span<const std::byte> bytes) const noexcept {
    for (; bytes.size() >= kWordBytes; bytes = bytes.subspan(kWordBytes)) {
      const auto word = load_word<std::uint32_t>(bytes.data() + upper_half_at_);
      if (static_cast<Evt2Word>(word >> 28U) == Evt2Word::time_high) return word & kTimeHighMask;
    }
    return std::nullopt;
  }

  // Bit i of `mask` is set where column x + i has an event.
  Event* decode_events(std::uint32_t word, std::uint32_t mask, Event* out) noexcept {
    if (!time_known_) {
      statistics_.dropped_before_time += static_cast<std::uint32_t>(std::popcount(mask));
      return out;
    }
    const std::uint32_t x = word >> 11U & 0x7FFU, y = word & 0x7FFU;
    const Timestamp t = time_of(word);
    const Event* const first = out;
    for (; mask != 0; mask &= mask - 1) {
      const std::uint32_t column = x + static_cast<std::uint32_t>(std::countr_zero(mask));
      if (size_.contains(static_cast<int>(column), static_cast<int>(y)))
        *out++ = {static_cast<std::uint16_t>(column), static_cast<std::uint16_t>(y),
                  static_cast<std::int16_t>(word >> 28U), t};
      else
        ++statistics_.off_sensor;
    }
    if (out == first) return out;
    statistics_.time_steps_back += t < last_ ? 1U : 0U;
    last_ = t;
    return out;
  }

  void decode_trigger(std::uint32_t word, std::vector<TriggerEvent>& triggers) {
    if (!time_known_) {
      ++statistics_.dropped_before_time;
      return;
    }
    ++statistics_.triggers;
    triggers.push_back({static_cast<int>(word >> 8U & 0x1FU), (word & 1U) != 0, time_of(word)});
  }

  static constexpr std::uint32_t kTimeHighMask = 0x0FFFFFFF;

  SensorSize size_;
  std::size_t upper_half_at_ = kHasMask ? 4 : 0;  // offset of the EVT2 word in each word [bytes]
  TimeHighDecoder<28, 6> time_high_decoder_;
  Timestamp time_high_ = 0, last_ = 0;
  bool time_known_ = false;
  RecordingStatistics statistics_;
};

using Evt2Decoder = BasicEvt2Decoder<4>;
using Evt21Decoder = BasicEvt2Decoder<8>;

/// True if the upper half of each EVT2.1 word in `bytes` comes first: by the order in which more words from the first
/// TIME_HIGH on have a type that the format defines; where both have as many, as `presumed`.
inline bool are_halves_swapped(std::span<const std::byte> bytes, bool presumed) noexcept {
  const auto count_defined = [bytes](std::size_t upper_half_at) {
    std::size_t count = 0;
    for (std::size_t i = 0; i + 8 <= bytes.size(); i += 8) {
      switch (static_cast<Evt2Word>(load_word<std::uint32_t>(bytes.data() + i + upper_half_at) >> 28U)) {
        case Evt2Word::time_high: ++count; break;
        case Evt2Word::cd_off:
        case Evt2Word::cd_on:
        case Evt2Word::trigger:
        case Evt2Word::others:
        case Evt2Word::continued: count += count > 0 ? 1U : 0U; break;
      }
    }
    return count;
  };
  const std::size_t swapped = count_defined(0), little = count_defined(4);
  return swapped == little ? presumed : swapped > little;
}

/// Encodes events as EVT2 words. The caller has checked that they are on a sensor of at most 2048 x 2048 px.
class Evt2Encoder {
 public:
  /// Appends the words of the events, in their order.
  /// @throws std::invalid_argument naming a time that EVT2 cannot express
  void encode(std::span<const Event> events, std::vector<std::byte>& bytes) {
    for (const Event& event : events)
      put(event.p > 0 ? Evt2Word::cd_on : Evt2Word::cd_off, event.t, std::uint32_t{event.x} << 11U | event.y, bytes);
  }

  /// @throws std::invalid_argument where the id is not in 0..31 or EVT2 cannot express the time
  void encode(const TriggerEvent& trigger, std::vector<std::byte>& bytes) {
    require_trigger_id(trigger.id, kMaxTriggerId, "EVT2");
    put(Evt2Word::trigger, trigger.t, static_cast<std::uint32_t>(trigger.id) << 8U | (trigger.rising ? 1U : 0U), bytes);
  }

  /// How many of the events, from the first on, `encode` can express next.
  std::size_t count_expressible(std::span<const Event> events) const noexcept {
    return time_high_.count_expressible(events);
  }
  bool can_express(const TriggerEvent& trigger) const noexcept {
    return trigger.id >= 0 && trigger.id <= kMaxTriggerId && time_high_.can_express(trigger.t);
  }

 private:
  static constexpr int kMaxTriggerId = 31;

  void put(Evt2Word type, Timestamp t, std::uint32_t payload, std::vector<std::byte>& bytes) {
    time_high_.advance_to(t, [&](std::uint32_t high) {
      append_word<std::uint32_t>(bytes, static_cast<std::uint32_t>(Evt2Word::time_high) << 28U | high);
    });
    const auto time_low = static_cast<std::uint32_t>(t & 0x3F);
    append_word<std::uint32_t>(bytes, static_cast<std::uint32_t>(type) << 28U | time_low << 22U | payload);
  }

  TimeHighEncoder<28, 6> time_high_{"EVT2"};
};

}  // namespace evmarker::io
