#pragma once
// The encodings of events in packets of ROS.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/event_collector.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/packed_events.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

/// `evt3`, `evt21`: the camera's own words, of which packets are parts. Times are the camera's.
template <typename Decoder>
class EvtPackets {
 public:
  static constexpr std::size_t kWordBytes = Decoder::kWordBytes;

  explicit EvtPackets(Decoder decoder) : decoder_(std::move(decoder)) {}

  void begin(std::uint64_t) {}
  void decode(std::span<const std::byte> words, std::span<const std::byte> following, EventCollector& collector) {
    const RecordingStatistics before = decoder_.statistics();
    triggers_.clear();
    const auto room = collector.room(words.size() / kWordBytes * Decoder::kMaxEventsPerWord);
    const std::size_t count = decoder_.decode(words, room, triggers_, following);
    const RecordingStatistics after = decoder_.statistics();
    collector.statistics.dropped_before_time += after.dropped_before_time - before.dropped_before_time;
    collector.statistics.off_sensor += after.off_sensor - before.off_sensor;
    collector.statistics.unknown_words += after.unknown_words - before.unknown_words;
    collector.statistics.garbled_times += after.garbled_times - before.garbled_times;
    collector.add_filled(count);
    for (const TriggerEvent& trigger : triggers_) collector.add(trigger);
  }

 private:
  Decoder decoder_;
  std::vector<TriggerEvent> triggers_;
};

/// `mono`: words of a time since the packet's [ns], column, row and polarity.
class MonoPackets {
 public:
  static constexpr std::size_t kWordBytes = 8;

  void begin(std::uint64_t time_base) { time_base_ = time_base; }
  void decode(std::span<const std::byte> words, std::span<const std::byte>, EventCollector& collector) {
    collector.add_each(words.size() / kWordBytes, [&](std::size_t i) {
      const auto word = load_word<std::uint64_t>(&words[kWordBytes * i]);
      const std::uint64_t since_microsecond = time_base_ % 1000 + (word & 0xFFFFFFFFU);
      return packed_event(word >> 32U & 0xFFFFU, word >> 48U & 0x7FFFU, word >> 63U,
                          static_cast<Timestamp>(time_base_ / 1000 + since_microsecond / 1000));
    });
  }

 private:
  std::uint64_t time_base_ = 0;
};

/// `libcaer`: events as in packets of AEDAT 3.1, of a 31-bit time since the packet's [us]. Those that are marked
/// invalid are left out.
class LibcaerPackets {
 public:
  static constexpr std::size_t kWordBytes = 8;

  void begin(std::uint64_t time_base) {
    time_base_ = static_cast<Timestamp>(time_base / 1000);
    last_ = 0;
  }
  void decode(std::span<const std::byte> words, std::span<const std::byte>, EventCollector& collector) {
    for (; !words.empty(); words = words.subspan(kWordBytes)) {
      const auto data = load_word<std::uint32_t>(&words[0]), time = load_word<std::uint32_t>(&words[4]) & (kWrap - 1);
      if (last_ >= time + kWrap / 2) time_base_ += kWrap;
      last_ = time;
      if ((data & 1U) != 0) collector.add(data >> 17U, data >> 2U & 0x7FFFU, (data >> 1U & 1U) != 0, time_base_ + time);
    }
  }

 private:
  static constexpr std::uint32_t kWrap = std::uint32_t{1} << 31U;

  Timestamp time_base_ = 0;
  std::uint32_t last_ = 0;
};

/// `libcaer_cmp`: words of 16 bits, each of which sets a part of the state (column, time since the packet's [us]) or
/// yields events.
class LibcaerCmpPackets {
 public:
  static constexpr std::size_t kWordBytes = 2;

  void begin(std::uint64_t time_base) {
    time_base_ = static_cast<Timestamp>(time_base / 1000);
    time_high_ = time_low_ = 0;
  }
  void decode(std::span<const std::byte> words, std::span<const std::byte>, EventCollector& collector) {
    for (; !words.empty(); words = words.subspan(kWordBytes)) {
      const std::uint32_t word = load_word<std::uint16_t>(words.data()), payload = word & 0xFFFU;
      switch (static_cast<Word>(word >> 12U)) {
        case Word::time_high: time_high_ = payload; break;
        case Word::time_low: time_low_ = payload; break;
        case Word::addr_x: x_ = payload & 0x7FFU; break;
        case Word::addr_y: collector.add(x_, payload & 0x7FFU, payload >> 11U != 0, time()); break;
        case Word::vect_base_y:
          vector_y_ = payload & 0x7FFU;
          vector_is_on_ = payload >> 11U != 0;
          break;
        case Word::vect_8:
          for (std::uint32_t mask = payload & 0xFFU; mask != 0; mask &= mask - 1)
            collector.add(x_, vector_y_ + std::countr_zero(mask), vector_is_on_, time());
          vector_y_ += 8;
          break;
        default: ++collector.statistics.unknown_words;
      }
    }
  }

 private:
  enum class Word : std::uint32_t { time_high, time_low, addr_x, addr_y, vect_base_y, vect_8 };

  Timestamp time() const noexcept { return time_base_ + (time_high_ << 12U | time_low_); }

  Timestamp time_base_ = 0;
  std::uint32_t time_high_ = 0, time_low_ = 0;
  std::int64_t x_ = 0, vector_y_ = 0;
  bool vector_is_on_ = false;
};

/// What decodes the packets of a topic, one after the other.
using EventPacketDecoder =
    std::variant<EvtPackets<Evt3Decoder>, EvtPackets<Evt21Decoder>, MonoPackets, LibcaerPackets, LibcaerCmpPackets>;

/// The decoder of an encoding by its name; nothing where it is unknown.
/// @param data of the first packet, by which the order of the halves of EVT2.1's words is recognised
inline std::optional<EventPacketDecoder> make_event_packet_decoder(std::string_view encoding, SensorSize size,
                                                                   std::span<const std::byte> data) {
  if (encoding == "evt3") return EvtPackets(Evt3Decoder(size));
  if (encoding == "evt21") return EvtPackets(Evt21Decoder(size, are_halves_swapped(data, false)));
  if (encoding == "mono") return MonoPackets();
  if (encoding == "libcaer") return LibcaerPackets();
  if (encoding == "libcaer_cmp") return LibcaerCmpPackets();
  return std::nullopt;
}

}  // namespace evmarker::io
