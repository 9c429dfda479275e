#pragma once
// Prophesee EVT3: 16-bit words, each of which sets a part of the state (row, time) or yields events.
#include <algorithm>
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

/// Decodes a stream of EVT3 words, piece by piece. Events off the sensor are left out and counted.
class Evt3Decoder {
 public:
  static constexpr std::size_t kWordBytes = 2;
  static constexpr std::size_t kMaxEventsPerWord = 12;

  explicit Evt3Decoder(SensorSize size) : size_(size) {}

  /// Decodes the whole words of `bytes` into `buffer`, which has space for kMaxEventsPerWord events a word, and appends
  /// to `triggers`.
  /// @param following the bytes that follow, as far as they are known: they show whether a time word is garbled
  /// @return number of events
  std::size_t decode(std::span<const std::byte> bytes, std::span<Event> buffer, std::vector<TriggerEvent>& triggers,
                     std::span<const std::byte> following = {}) {
    const std::byte* at = bytes.data();
    const std::byte* const end = at + bytes.size() / kWordBytes * kWordBytes;
    if (!time_known_) at = skip_to_first_time(at, end);

    State state = state_;
    Event* out = buffer.data();
    while ((at = decode_frequent_words(at, end, state, out)) != end) {
      const std::uint32_t word = load_word<std::uint16_t>(at);
      at += kWordBytes;
      out = decode_other(word, {at, end}, following, state, out, triggers);
    }
    state_ = state;

    const auto events = buffer.first(static_cast<std::size_t>(out - buffer.data()));
    statistics_.events += events.size();
    statistics_.off_sensor = state.off_sensor;
    count_steps_back(events);
    return events.size();
  }

  RecordingStatistics statistics() const noexcept {
    RecordingStatistics statistics = statistics_;
    statistics.garbled_times += time_high_decoder_.undone();  // those that were taken until the next one showed it
    return statistics;
  }

 private:
  static constexpr std::uint32_t kOffEverySensor = 1U << 12U;

  // What the words so far have set.
  struct State {
    std::uint32_t y = 0;
    std::uint32_t row_width = 0;               // number of columns of row y on the sensor; 0 off it, and at first
    std::uint32_t vector_x = kOffEverySensor;  // first column of the next vector; off every sensor before VECT_BASE_X
    std::int16_t vector_p = 0;
    std::uint32_t time_high = ~0U;  // the last TIME_HIGH; until the first, a value that none has
    Timestamp t = 0;
    std::uint64_t off_sensor = 0;  // number of events off the sensor so far
  };

  // Drops everything before the first TIME_HIGH, since its time is unknown.
  const std::byte* skip_to_first_time(const std::byte* at, const std::byte* end) noexcept {
    for (; at != end; at += kWordBytes) {
      const std::uint32_t word = load_word<std::uint16_t>(at);
      switch (type_of(word)) {
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

  static bool is_row_column_or_time_low(std::uint32_t word) noexcept {
    const Evt3Word type = type_of(word);
    return (type == Evt3Word::addr_y) | (type == Evt3Word::addr_x) | (type == Evt3Word::time_low);
  }

  // Decodes rows, columns and low times up to a word of another type, and returns where that is.
  const std::byte* decode_frequent_words(const std::byte* at, const std::byte* end, State& state,
                                         Event*& events) const noexcept {
    State local = state;  // a copy, which no store to `events` can change: it stays in registers
    Event* out = events;
    for (; at != end; at += kWordBytes) {
      const std::uint32_t word = load_word<std::uint16_t>(at);
      if (!is_row_column_or_time_low(word)) [[unlikely]]
        break;
      out = decode_row_column_or_time_low(word, local, out);
    }
    state = local;
    events = out;
    return at;
  }

  // The three most frequent words, without branches: which of them comes next cannot be predicted.
  Event* decode_row_column_or_time_low(std::uint32_t word, State& state, Event* out) const noexcept {
    const auto width = static_cast<std::uint32_t>(size_.width), height = static_cast<std::uint32_t>(size_.height);
    const Evt3Word type = type_of(word);
    const bool row = type == Evt3Word::addr_y, column = type == Evt3Word::addr_x, low = type == Evt3Word::time_low;
    const std::uint32_t address = address_of(word);
    state.y = row ? address : state.y;
    state.row_width = row ? (address < height ? width : 0) : state.row_width;
    state.t = low ? (state.t & ~Timestamp{0xFFF}) | payload_of(word) : state.t;
    // Written for every word: there is always room for one event more, and if the word is none, the next overwrites it.
    *out = make_event(address, state.y, polarity_of(word), state.t);
    const bool visible = column & (address < state.row_width);
    state.off_sensor += (column & !visible) ? 1U : 0U;
    return out + (visible ? 1 : 0);
  }

  Event* decode_other(std::uint32_t word, std::span<const std::byte> rest, std::span<const std::byte> following,
                      State& state, Event* out, std::vector<TriggerEvent>& triggers) {
    const std::uint32_t payload = payload_of(word);
    switch (type_of(word)) {
      case Evt3Word::vect_base_x:
        state.vector_x = address_of(word);
        state.vector_p = polarity_of(word);
        break;
      case Evt3Word::vect_12: return decode_vector(payload, 12, state, out);
      case Evt3Word::vect_8: return decode_vector(payload & 0xFFU, 8, state, out);
      case Evt3Word::time_high:
        // Cameras repeat it within its 4096 us: the low part stays, or time would step back.
        if (payload == state.time_high) {
          time_high_decoder_.confirm();
        } else if (const auto t = time_at(payload, rest, following)) {
          state.time_high = payload;
          state.t = *t;
        }
        break;
      case Evt3Word::trigger:
        ++statistics_.triggers;
        triggers.push_back({static_cast<int>(payload >> 8U & 0xFU), (payload & 1U) != 0, state.t});
        break;
      case Evt3Word::continued_4:
      case Evt3Word::others:
      case Evt3Word::continued_12: break;
      default: ++statistics_.unknown_words;
    }
    return out;
  }

  // Time at a TIME_HIGH; nothing where it is garbled.
  std::optional<Timestamp> time_at(std::uint32_t high, std::span<const std::byte> rest,
                                   std::span<const std::byte> following) noexcept {
    const auto find_next = [&] {
      const auto next = find_time_high(rest);
      return next ? next : find_time_high(following);
    };
    if (!time_high_decoder_.is_garbled(high, find_next)) return time_high_decoder_.unwrap(high) * 4096;
    ++statistics_.garbled_times;
    return std::nullopt;
  }

  static std::optional<std::uint32_t> find_time_high(std::span<const std::byte> bytes) noexcept {
    for (; bytes.size() >= kWordBytes; bytes = bytes.subspan(kWordBytes)) {
      const std::uint32_t word = load_word<std::uint16_t>(bytes.data());
      if (type_of(word) == Evt3Word::time_high) return payload_of(word);
    }
    return std::nullopt;
  }

  // Bit i of `mask` is set where column vector_x + i has an event.
  static Event* decode_vector(std::uint32_t mask, std::uint32_t length, State& state, Event* out) noexcept {
    const std::uint32_t x = state.vector_x;
    if (x + length > state.row_width) [[unlikely]] {
      const std::uint32_t visible = x < state.row_width ? mask & ((1U << (state.row_width - x)) - 1U) : 0;
      state.off_sensor += count_bits(mask ^ visible);
      mask = visible;
      state.vector_x = std::min(x, kOffEverySensor);  // or a run of vectors would wrap it around
    }
    for (; mask != 0; mask &= mask - 1)
      *out++ = make_event(x + static_cast<std::uint32_t>(std::countr_zero(mask)), state.y, state.vector_p, state.t);
    state.vector_x += length;
    return out;
  }

  void count_steps_back(std::span<const Event> events) noexcept {
    std::uint64_t count = 0;
    Timestamp last = last_;
    for (const Event& event : events) {
      count += event.t < last ? 1U : 0U;
      last = event.t;
    }
    statistics_.time_steps_back += count;
    last_ = last;
  }

  static Evt3Word type_of(std::uint32_t word) noexcept { return static_cast<Evt3Word>(word >> 12U); }
  static std::uint32_t payload_of(std::uint32_t word) noexcept { return word & 0xFFFU; }
  static std::uint32_t address_of(std::uint32_t word) noexcept { return word & 0x7FFU; }
  static std::int16_t polarity_of(std::uint32_t word) noexcept { return static_cast<std::int16_t>(word >> 11U & 1U); }
  static Event make_event(std::uint32_t x, std::uint32_t y, std::int16_t p, Timestamp t) noexcept {
    return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), p, t};
  }
  static std::uint32_t count_bits(std::uint32_t mask) noexcept {
    return static_cast<std::uint32_t>(std::popcount(mask));
  }

  SensorSize size_;
  State state_;
  TimeHighDecoder<12, 12> time_high_decoder_;
  bool time_known_ = false;
  Timestamp last_ = 0;  // of the last event
  RecordingStatistics statistics_;
};

/// Encodes events as EVT3 words that decode to the same sequence, polarity 0 or 1, in vectors where that saves words.
/// The caller has checked that they are on a sensor of at most 2048 x 2048 px.
class Evt3Encoder {
 public:
  /// @param width of the sensor; vectors do not extend beyond it
  explicit Evt3Encoder(int width) : width_(static_cast<std::uint32_t>(width)) {}

  /// Appends the words of the events, in their order.
  /// @throws std::invalid_argument naming a time that EVT3 cannot express
  void encode(std::span<const Event> events, std::vector<std::byte>& bytes) {
    while (!events.empty()) {
      const Event& first = events.front();
      put_time(first.t, bytes);
      if (first.y != y_) put(bytes, Evt3Word::addr_y, y_ = first.y);
      // From the first event on, or farther left so that all 32 columns are on the sensor.
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

  /// @throws std::invalid_argument where the id is not in 0..15 or EVT3 cannot express the time
  void encode(const TriggerEvent& trigger, std::vector<std::byte>& bytes) {
    require_trigger_id(trigger.id, kMaxTriggerId, "EVT3");
    put_time(trigger.t, bytes);
    put(bytes, Evt3Word::trigger, static_cast<std::uint32_t>(trigger.id) << 8U | (trigger.rising ? 1U : 0U));
  }

  /// How many of the events, from the first on, `encode` can express next.
  std::size_t count_expressible(std::span<const Event> events) const noexcept {
    return time_high_.count_expressible(events);
  }
  bool can_express(const TriggerEvent& trigger) const noexcept {
    return trigger.id >= 0 && trigger.id <= kMaxTriggerId && time_high_.can_express(trigger.t);
  }

 private:
  static constexpr int kMaxTriggerId = 15;
  static constexpr std::uint32_t kVectorLength = 32;
  static constexpr std::size_t kVectorWords = 4;  // VECT_BASE_X and three masks

  static void put(std::vector<std::byte>& bytes, Evt3Word type, std::uint32_t payload) {
    append_word(bytes, static_cast<std::uint16_t>(static_cast<std::uint32_t>(type) << 12U | payload));
  }
  static std::uint32_t address(std::uint32_t x, std::int16_t p) noexcept { return x | (p > 0 ? 1U << 11U : 0U); }

  // Number of leading events that fit into one vector from column `base` on, without a change of their order.
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

  // Always 12, 12 and 8 columns, as cameras write them: OpenEB decodes the three words as one.
  static void encode_vector(std::span<const Event> events, std::uint32_t base, std::vector<std::byte>& bytes) {
    std::uint32_t mask = 0;
    for (const Event& event : events) mask |= 1U << (event.x - base);
    put(bytes, Evt3Word::vect_base_x, address(base, events.front().p));
    put(bytes, Evt3Word::vect_12, mask & 0xFFFU);
    put(bytes, Evt3Word::vect_12, mask >> 12U & 0xFFFU);
    put(bytes, Evt3Word::vect_8, mask >> 24U);
  }

  void put_time(Timestamp t, std::vector<std::byte>& bytes) {
    if (t == t_) return;
    bool new_high = false;
    time_high_.advance_to(t, [&](std::uint32_t high) {
      put(bytes, Evt3Word::time_high, high);
      new_high = true;
    });
    const auto time_low = static_cast<std::uint32_t>(t & 0xFFF);
    // t_ is set: the very first time always begins with a TIME_HIGH.
    if (new_high || time_low != (*t_ & 0xFFF)) put(bytes, Evt3Word::time_low, time_low);
    t_ = t;
  }

  std::uint32_t width_;
  TimeHighEncoder<12, 12> time_high_{"EVT3"};
  std::optional<Timestamp> t_;
  std::uint32_t y_ = ~0U;  // unlike any row
};

}  // namespace evmarker::io
