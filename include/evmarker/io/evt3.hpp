#pragma once
// Prophesee EVT3: 16-bit words that change a state; events that share row, time and polarity share words.
#include <algorithm>
#include <bit>
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

/// Type of an EVT3 word, its bits 15..12.
enum class Evt3Word : std::uint32_t {
  addr_y = 0,
  addr_x = 2,
  vect_base_x = 3,
  vect_12 = 4,
  vect_8 = 5,
  time_low = 6,
  continued_4 = 7,
  time_high = 8,
  trigger = 10,
  others = 14,
  continued_12 = 15
};

/// Decodes a stream of EVT3 words, piece by piece. Never yields an event off the sensor.
class Evt3Decoder {
 public:
  static constexpr std::size_t kWordBytes = 2;
  static constexpr std::size_t kMaxEventsPerWord = 12;

  explicit Evt3Decoder(SensorSize size) : size_(size) {}

  /// Decodes the whole words of `bytes` into `room`, which holds kMaxEventsPerWord for each of them.
  /// @return number of events
  std::size_t decode(std::span<const std::byte> bytes, std::span<Event> room, std::vector<TriggerEvent>& triggers) {
    const std::byte* at = bytes.data();
    const std::byte* const end = at + bytes.size() / kWordBytes * kWordBytes;
    if (!time_known_) at = find_time(at, end);
    const std::size_t count = decode_timed(at, end, room.data(), triggers);
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
  // Everything before the first TIME_HIGH is dropped: its time is unknown.
  const std::byte* find_time(const std::byte* at, const std::byte* end) noexcept {
    for (; at != end; at += kWordBytes) {
      const std::uint32_t word = load_word<std::uint16_t>(at);
      switch (static_cast<Evt3Word>(word >> 12U)) {
        case Evt3Word::time_high: time_known_ = true; return at;
        case Evt3Word::addr_x:
        case Evt3Word::trigger: ++statistics_.dropped_before_time; break;
        case Evt3Word::vect_12: statistics_.dropped_before_time += count_bits(word & 0xFFFU); break;
        case Evt3Word::vect_8: statistics_.dropped_before_time += count_bits(word & 0xFFU); break;
        default: break;
      }
    }
    return at;
  }

  // The state is kept in locals: the compiler cannot keep members in registers across the stores of events.
  std::size_t decode_timed(const std::byte* at, const std::byte* end, Event* const begin,
                           std::vector<TriggerEvent>& triggers) {
    Event* out = begin;
    std::uint32_t y = y_, row_width = row_width_, base = base_, high = high_word_;
    std::int16_t base_p = base_p_;
    Timestamp t = t_, last = last_;
    const auto width = static_cast<std::uint32_t>(size_.width), height = static_cast<std::uint32_t>(size_.height);
    std::uint64_t off_sensor = 0, steps_back = 0;

    const auto emit_vector = [&](std::uint32_t mask, std::uint32_t length) {
      if (base + length > row_width) [[unlikely]] {
        const std::uint32_t visible = base < row_width ? mask & ((1U << (row_width - base)) - 1U) : 0;
        off_sensor += count_bits(mask ^ visible);
        mask = visible;
      }
      for (; mask != 0; mask &= mask - 1)
        *out++ = make_event(base + static_cast<std::uint32_t>(std::countr_zero(mask)), y, base_p, t);
      base += length;
    };

    for (; at != end; at += kWordBytes) {
      const std::uint32_t word = load_word<std::uint16_t>(at), payload = word & 0xFFFU, address = word & 0x7FFU;
      const auto type = static_cast<Evt3Word>(word >> 12U);
      // Which of these three comes next cannot be foreseen: no branch between them.
      const bool row = type == Evt3Word::addr_y, column = type == Evt3Word::addr_x, low = type == Evt3Word::time_low;
      if (row | column | low) [[likely]] {
        y = row ? address : y;
        row_width = row ? (address < height ? width : 0) : row_width;
        t = low ? (t & ~Timestamp{0xFFF}) | payload : t;
        *out = make_event(address, y, static_cast<std::int16_t>(payload >> 11U), t);
        const bool visible = column & (address < row_width);
        out += visible ? 1 : 0;
        off_sensor += (column & !visible) ? 1U : 0U;
        continue;
      }
      switch (type) {
        case Evt3Word::vect_base_x:
          base = address;
          base_p = static_cast<std::int16_t>(payload >> 11U);
          break;
        case Evt3Word::vect_12: emit_vector(payload, 12); break;
        case Evt3Word::vect_8: emit_vector(payload & 0xFFU, 8); break;
        case Evt3Word::time_high:
          if (payload == high) break;  // repeated: the low part goes on
          t = time_high_.unroll(high = payload) * 4096;
          break;
        case Evt3Word::trigger:
          ++statistics_.triggers;
          triggers.push_back({static_cast<int>((payload >> 8U) & 0xFU), (payload & 1U) != 0, t});
          break;
        case Evt3Word::addr_y:
        case Evt3Word::addr_x:
        case Evt3Word::time_low:
        case Evt3Word::continued_4:
        case Evt3Word::others:
        case Evt3Word::continued_12: break;
        default: ++statistics_.unknown_words;
      }
    }
    for (const Event* event = begin; event != out; ++event) {
      steps_back += event->t < last ? 1U : 0U;
      last = event->t;
    }
    statistics_.time_steps_back += steps_back;
    y_ = y, row_width_ = row_width, base_ = base, high_word_ = high;
    base_p_ = base_p;
    t_ = t, last_ = last;
    statistics_.off_sensor += off_sensor;
    return static_cast<std::size_t>(out - begin);
  }

  static Event make_event(std::uint32_t x, std::uint32_t y, std::int16_t p, Timestamp t) noexcept {
    return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), p, t};
  }
  static std::uint32_t count_bits(std::uint32_t mask) noexcept {
    return static_cast<std::uint32_t>(std::popcount(mask));
  }

  SensorSize size_;
  bool time_known_ = false;
  std::uint32_t y_ = 0;
  std::uint32_t row_width_ = 0;     // columns of the present row that lie on the sensor; none before the first row
  std::uint32_t base_ = 1U << 12U;  // off every sensor before the first VECT_BASE_X
  std::uint32_t high_word_ = ~0U;   // unlike any word
  std::int16_t base_p_ = 0;
  TimeHighDecoder<12> time_high_;
  Timestamp t_ = 0, last_ = 0;
  RecordingStatistics statistics_;
};

/// Writes events as EVT3 words, in vectors where neighbours in the given order allow it: decoding yields the same
/// sequence. The caller has checked that they lie on a sensor of at most 2048 x 2048 px.
class Evt3Encoder {
 public:
  /// @param width of the sensor: no vector reaches beyond it
  explicit Evt3Encoder(int width) : width_(static_cast<std::uint32_t>(width)) {}

  /// Appends the words of the events. @throws std::invalid_argument naming a time that EVT3 cannot hold
  void encode(std::span<const Event> events, std::vector<std::byte>& bytes) {
    while (!events.empty()) {
      const Event& first = events.front();
      go_to(first.t, bytes);
      if (first.y != y_) put(bytes, Evt3Word::addr_y, y_ = first.y);
      const std::uint32_t base = std::min<std::uint32_t>(first.x, width_ - std::min(width_, kVectorLength));
      const std::size_t count = width_ < kVectorLength ? 0 : events_within(events, base);
      if (count > kVectorWords) {
        encode_vector(events.first(count), base, bytes);
        events = events.subspan(count);
      } else {
        put(bytes, Evt3Word::addr_x, address(first.x, first.p));
        events = events.subspan(1);
      }
    }
  }

  /// @throws std::invalid_argument where the id is not in 0..15 or EVT3 cannot hold the time
  void encode(const TriggerEvent& trigger, std::vector<std::byte>& bytes) {
    if (trigger.id < 0 || trigger.id > 15)
      throw std::invalid_argument("trigger: id is " + std::to_string(trigger.id) + ", EVT3 holds 0..15");
    go_to(trigger.t, bytes);
    put(bytes, Evt3Word::trigger, static_cast<std::uint32_t>(trigger.id) << 8U | (trigger.rising ? 1U : 0U));
  }

 private:
  static constexpr std::uint32_t kVectorLength = 32;
  static constexpr std::size_t kVectorWords = 4;  // its base and three masks

  static void put(std::vector<std::byte>& bytes, Evt3Word type, std::uint32_t payload) {
    append_word(bytes, static_cast<std::uint16_t>(static_cast<std::uint32_t>(type) << 12U | payload));
  }
  static std::uint32_t address(std::uint32_t x, std::int16_t p) noexcept { return x | (p > 0 ? 1U << 11U : 0U); }

  // Number of events from the first on that share row, time and polarity, go right, and lie in a vector from `base`.
  static std::size_t events_within(std::span<const Event> events, std::uint32_t base) noexcept {
    std::size_t count = 0;
    for (; count < events.size(); ++count) {
      const Event &first = events.front(), &event = events[count];
      if (event.t != first.t || event.y != first.y || (event.p > 0) != (first.p > 0)) break;
      if (event.x < base || event.x >= base + kVectorLength) break;
      if (count > 0 && event.x <= events[count - 1].x) break;
    }
    return count;
  }

  // Always 12, 12 and 8 columns: the camera writes no others, and OpenEB takes the three words as one.
  static void encode_vector(std::span<const Event> events, std::uint32_t base, std::vector<std::byte>& bytes) {
    std::uint32_t mask = 0;
    for (const Event& event : events) mask |= 1U << (event.x - base);
    put(bytes, Evt3Word::vect_base_x, address(base, events.front().p));
    put(bytes, Evt3Word::vect_12, mask & 0xFFFU);
    put(bytes, Evt3Word::vect_12, mask >> 12U & 0xFFFU);
    put(bytes, Evt3Word::vect_8, mask >> 24U);
  }

  void go_to(Timestamp t, std::vector<std::byte>& bytes) {
    if (t == t_) return;
    if (t < 0) throw std::invalid_argument("EVT3: t is " + std::to_string(t) + " us, must not be negative");
    bool new_high = false;
    try {
      high_.go_to(t >> 12, [&](std::uint32_t high) {
        put(bytes, Evt3Word::time_high, high);
        new_high = true;
      });
    } catch (const std::invalid_argument& reason) {
      throw std::invalid_argument("EVT3: t is " + std::to_string(t) + " us, which " + reason.what());
    }
    if (new_high || (t & 0xFFF) != (t_ & 0xFFF)) put(bytes, Evt3Word::time_low, static_cast<std::uint32_t>(t & 0xFFF));
    t_ = t;
  }

  std::uint32_t width_;
  TimeHighEncoder<12> high_;
  Timestamp t_ = -1;
  std::uint32_t y_ = ~0U;
};

}  // namespace evmarker::io
