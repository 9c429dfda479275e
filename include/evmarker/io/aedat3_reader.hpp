#pragma once
// AEDAT 3.1 recordings, as cAER writes them, as a source of events.
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/aedat_header.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/header_lines.hpp"
#include "evmarker/io/packed_events.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/streaming_reader.hpp"

namespace evmarker::io {

/// Reads AEDAT 3.1 recordings: header lines, and packets of events of one type and source. Of several sources the first
/// in the header is read, or else that of the first packet of events; packets of frames and measurements are passed
/// over, events that are marked invalid left out. Edges and pulses at the camera's inputs are triggers, pulses rising.
class Aedat3Reader final : public StreamingReader {
 public:
  /// @throws RecordingError where the file cannot be read, or its format is not RAW
  explicit Aedat3Reader(std::filesystem::path path, const RecordingOptions& options = {})
      : Aedat3Reader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit Aedat3Reader(BlockReader blocks, const RecordingOptions& options = {})
      : StreamingReader(std::move(blocks), options) {
    const HeaderLines header = detail::read_aedat_header(bytes_);
    if (!header.has("!AER-DAT3.1"))
      throw RecordingError(bytes_.path(), "not an AEDAT 3.1 recording: no line '#!AER-DAT3.1'", 0);
    const std::string format(header.field("Format:"));
    if (!format.empty() && format != "RAW")
      throw RecordingError(bytes_.path(), "header: Format is '" + format + "', which is not supported (RAW is)");
    std::optional<SensorSize> size;
    for (const auto& [key, value] : header.fields) {
      const auto chip = key == "Source" ? detail::find_chip(value) : std::nullopt;
      if (!chip || source_) continue;
      source_ = std::atoi(value.c_str());
      size = chip->size;
    }
    collector_.set_sensor_size(choose_sensor_size(size, options, 1 << 15, "AEDAT 3.1", bytes_.path()));
  }

 private:
  static constexpr std::size_t kHeaderBytes = 28, kEventBytes = 8;
  static constexpr int kSpecial = 0, kPolarity = 1;

  bool read_piece() override {
    if (events_left_ == 0) return read_packet_header();
    const auto events = peek_records(kEventBytes, events_left_);
    if (events.empty()) return end_of_file();
    const std::size_t count = events.size() / kEventBytes;
    const auto data = [&](std::size_t i) { return load_word<std::uint32_t>(&events[kEventBytes * i]); };
    const auto time = [&](std::size_t i) {
      return time_base_ + static_cast<std::int32_t>(load_word<std::uint32_t>(&events[kEventBytes * i + 4]));
    };
    const auto is_valid = [&](std::size_t i) { return (data(i) & 1U) != 0; };
    if (type_ == kSpecial)
      for (std::size_t i = 0; i < count; ++i)
        if (is_valid(i)) add_special(data(i) >> 1U & 0x7FU, time(i));
    // Events that are marked invalid, which are few, are left out between the others.
    for (std::size_t begin = 0, end = 0; type_ == kPolarity && begin < count; begin = end + 1) {
      for (end = begin; end < count && is_valid(end);) ++end;
      collector_.add_each(end - begin, [&](std::size_t i) {
        const std::uint32_t event = data(begin + i);
        return packed_event(event >> 17U, event >> 2U & 0x7FFFU, event >> 1U & 1U, time(begin + i));
      });
    }
    bytes_.skip(events.size());
    events_left_ -= events.size() / kEventBytes;
    return true;
  }

  // Reads the header of a packet, and passes over the packet if it is not of interest.
  bool read_packet_header() {
    const auto header = bytes_.peek(kHeaderBytes);
    if (header.size() < kHeaderBytes) return end_of_file();
    const auto number_at = [&](std::size_t at) {
      return static_cast<std::int32_t>(load_word<std::uint32_t>(&header[at]));
    };
    type_ = static_cast<std::int16_t>(load_word<std::uint16_t>(&header[0]));
    const int source = load_word<std::uint16_t>(&header[2]);
    const int size = number_at(4), count = number_at(20);
    const bool of_interest = type_ == kSpecial || type_ == kPolarity;
    const auto require = [&](bool holds, const char* field, int value, const char* condition) {
      if (!holds)
        throw RecordingError(
            bytes_.path(), std::string("packet: ") + field + " is " + std::to_string(value) + ", must be " + condition,
            bytes_.position());
    };
    require(type_ >= 0, "eventType", type_, "0 or more (compressed packets are not supported)");
    require(of_interest ? size == kEventBytes : size >= 0, "eventSize", size, of_interest ? "8" : "0 or more");
    require(count >= 0, "eventNumber", count, "0 or more");
    time_base_ = number_at(12) * (Timestamp{1} << 31);
    bytes_.skip(kHeaderBytes);
    if (!source_ && type_ == kPolarity) source_ = source;
    if (of_interest && source_ == source) {
      events_left_ = static_cast<std::size_t>(count);
      return true;
    }
    const std::uint64_t length = static_cast<std::uint64_t>(size) * static_cast<std::uint64_t>(count);
    const std::uint64_t passed = bytes_.pass(length, [](std::span<const std::byte>) {});
    collector_.statistics.truncated_bytes += passed < length ? passed : 0;
    return true;
  }

  void add_special(std::uint32_t type, Timestamp t) {
    struct Edge {
      std::uint32_t type;
      int id;
      bool rising;
    };
    constexpr std::array<Edge, 9> edges{{{2, 0, true},
                                         {3, 0, false},
                                         {4, 0, true},
                                         {6, 1, true},
                                         {7, 1, false},
                                         {8, 1, true},
                                         {9, 2, true},
                                         {10, 2, false},
                                         {11, 2, true}}};
    for (const Edge& edge : edges)
      if (edge.type == type) collector_.add(TriggerEvent{edge.id, edge.rising, t});
  }

  std::optional<int> source_;
  int type_ = kPolarity;
  std::size_t events_left_ = 0;  // of the packet
  Timestamp time_base_ = 0;
};

}  // namespace evmarker::io
