#pragma once
// Prophesee's encodings read plainly, as their descriptions say: what the library's decoders are compared with.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/raw_header.hpp"

namespace evmarker::fuzz {

/// Decodes words of any of the encodings. Times are right unless a time word jumps.
class PlainDecoder {
 public:
  PlainDecoder(io::RawFormat format, SensorSize size) : format_(format), size_(size) {}

  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
  std::uint64_t not_delivered = 0;  ///< events off the sensor, and events and triggers before the first time

  void decode(std::string_view bytes) {
    const std::size_t word_bytes = format_ == io::RawFormat::evt2 ? 4 : format_ == io::RawFormat::evt21 ? 8 : 2;
    for (; bytes.size() >= word_bytes; bytes.remove_prefix(word_bytes)) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes.data(), word_bytes);
      if (format_ == io::RawFormat::evt2) evt2(word, 1);
      if (format_ == io::RawFormat::evt21) evt2(word >> 32U, word & 0xFFFFFFFF);
      if (format_ == io::RawFormat::evt3) evt3(word);
    }
  }

 private:
  void evt2(std::uint64_t word, std::uint64_t mask) {
    const std::uint64_t type = word >> 28U;
    const Timestamp t = high_ * 64 + static_cast<Timestamp>(word >> 22U & 63);
    if (type == 0 || type == 1) add(word >> 11U & 2047, word & 2047, type, t, mask);
    if (type == 8) set_time_high(word & 0xFFFFFFF, std::uint64_t{1} << 28U);
    if (type == 10) add_trigger(word >> 8U & 31, word, t);
  }

  void evt3(std::uint64_t word) {
    const std::uint64_t type = word >> 12U, payload = word & 0xFFF;
    const auto add_vector = [&](std::uint64_t length) {
      add(x_, y_, p_, t_, payload & ((1U << length) - 1));
      if (high_known_) x_ += length;
    };
    if (type == 8) {
      const bool repeated = high_known_ && payload == last_high_;
      set_time_high(payload, 4096);
      if (!repeated) t_ = high_ * 4096;
    }
    if (type == 4) add_vector(12);
    if (type == 5) add_vector(8);
    if (type == 2) add(payload & 2047, y_, payload >> 11U, t_, 1);
    if (type == 10) add_trigger(payload >> 8U, payload, t_);
    if (!high_known_) return;  // what comes before the first time is not used
    if (type == 0) y_ = payload & 2047;
    if (type == 3) {
      x_ = payload & 2047;
      p_ = payload >> 11U;
    }
    if (type == 6) t_ = high_ * 4096 + static_cast<Timestamp>(payload);
  }

  // Bit i of the mask is an event at x + i.
  void add(std::uint64_t x, std::uint64_t y, std::uint64_t p, Timestamp t, std::uint64_t mask) {
    for (; mask != 0; mask >>= 1U, ++x) {
      if (mask % 2 == 0) continue;
      if (high_known_ && x < static_cast<std::uint64_t>(size_.width) && y < static_cast<std::uint64_t>(size_.height))
        events.push_back(
            {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(p), t});
      else
        ++not_delivered;
    }
  }

  void add_trigger(std::uint64_t id, std::uint64_t level, Timestamp t) {
    if (high_known_)
      triggers.push_back({static_cast<int>(id), level % 2 == 1, t});
    else
      ++not_delivered;
  }

  void set_time_high(std::uint64_t high, std::uint64_t range) {
    if (high_known_ && high + range / 2 <= last_high_) wraps_ += range;
    high_ = static_cast<Timestamp>(wraps_ + high);
    last_high_ = high;
    high_known_ = true;
  }

  static constexpr std::uint64_t kNoRow = 1U << 20U, kNoColumn = 1U << 20U;

  io::RawFormat format_;
  SensorSize size_;
  bool high_known_ = false;
  std::uint64_t last_high_ = 0, wraps_ = 0;
  Timestamp high_ = 0, t_ = 0;
  std::uint64_t x_ = kNoColumn, y_ = kNoRow, p_ = 0;
};

}  // namespace evmarker::fuzz
