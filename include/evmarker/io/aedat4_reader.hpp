#pragma once
// AEDAT 4 recordings, as DV writes them, as a source of events.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/aedat4_header.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/compression.hpp"
#include "evmarker/io/decompression.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/flatbuffer.hpp"
#include "evmarker/io/packed_events.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/streaming_reader.hpp"

namespace evmarker::io {

/// Reads AEDAT 4 recordings: a header that lists the streams, then packets, each of one stream. Reads the first stream
/// of events and the first of triggers; packets of others, such as frames and inertial measurements, are skipped. An
/// edge at the camera's input becomes a trigger of id 0, and so does a pulse, as a rising edge.
class Aedat4Reader final : public StreamingReader {
 public:
  /// @throws RecordingError where the file cannot be read, has no stream of events, or is compressed by a library that
  /// this build leaves out
  explicit Aedat4Reader(std::filesystem::path path, const RecordingOptions& options = {})
      : Aedat4Reader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit Aedat4Reader(BlockReader blocks, const RecordingOptions& options = {})
      : StreamingReader(std::move(blocks), options) {
    constexpr std::string_view first_line = "#!AER-DAT4.0\r\n";
    if (!bytes_.peek_text(first_line.size()).starts_with(first_line))
      throw RecordingError(bytes_.path(), "not an AEDAT 4 recording: no first line '#!AER-DAT4.0'", 0);
    bytes_.skip(first_line.size());
    const Aedat4Header header = read_header();
    const auto events = std::ranges::find(header.streams, "EVTS", &Aedat4Stream::type);
    if (events == header.streams.end())
      throw RecordingError(bytes_.path(), "header: no stream of events (typeIdentifier EVTS) in it");
    event_stream_ = events->id;
    if (const auto triggers = std::ranges::find(header.streams, "TRIG", &Aedat4Stream::type);
        triggers != header.streams.end())
      trigger_stream_ = triggers->id;
    if (header.end_of_packets >= 0) end_of_packets_ = static_cast<std::uint64_t>(header.end_of_packets);
    decompressor_ = make_decompressor(header.compression, "packets", bytes_.path());
    collector_.set_sensor_size(choose_sensor_size(events->size, options, 1 << 15, "AEDAT 4", bytes_.path()));
  }

 private:
  static constexpr std::size_t kPacketHeaderBytes = 8, kEventBytes = 16;

  Aedat4Header read_header() {
    const auto size = bytes_.peek(4);
    const std::uint64_t length = size.size() < 4 ? 0 : load_word<std::uint32_t>(size.data());
    bytes_.skip(std::min<std::size_t>(size.size(), 4));
    if (length == 0 || !read_bytes(length, "header"))
      throw RecordingError(bytes_.path(), "cut off inside its header", bytes_.position());
    try {
      return parse_aedat4_header(packet_);
    } catch (const std::exception& error) {
      throw RecordingError(bytes_.path(), std::string("header: ") + error.what(), 18);
    }
  }

  bool read_piece() override {
    if (undelivered_.empty()) return read_packet();
    const auto piece = undelivered_.first(std::min(undelivered_.size(), kPieceEvents * kEventBytes));
    undelivered_ = undelivered_.subspan(piece.size());
    collector_.add_each(piece.size() / kEventBytes, [&](std::size_t i) {
      const std::byte* const event = &piece[kEventBytes * i];
      const auto data = load_word<std::uint64_t>(event + 8);  // x, y, ON; negative is beyond any sensor
      return packed_event(data & 0xFFFFU, data >> 16U & 0xFFFFU, data >> 32U & 0xFFU,
                          static_cast<Timestamp>(load_word<std::uint64_t>(event)));
    });
    return true;
  }

  // Reads a packet of events or triggers, or skips one of another stream; false at the end of the packets.
  bool read_packet() {
    if (bytes_.position() >= end_of_packets_) {  // an index follows: a pipe must be read to its end
      skip_bytes(~std::uint64_t{0});
      return false;
    }
    const auto header = bytes_.peek(kPacketHeaderBytes);
    if (header.size() < kPacketHeaderBytes) return end_of_file();
    const std::uint64_t begin = bytes_.position();
    const auto stream = static_cast<std::int32_t>(load_word<std::uint32_t>(&header[0]));
    const auto length = static_cast<std::int32_t>(load_word<std::uint32_t>(&header[4]));
    if (length < 0)
      throw RecordingError(bytes_.path(), "packet: size is " + std::to_string(length) + ", must not be negative",
                           begin);
    bytes_.skip(kPacketHeaderBytes);
    const auto bytes = static_cast<std::uint64_t>(length);
    const bool of_interest = stream == event_stream_ || stream == trigger_stream_;
    const bool whole = of_interest ? read_bytes(bytes, "packet") : skip_bytes(bytes);
    if (!whole) {
      collector_.statistics.truncated_bytes += bytes_.position() - begin;
      return false;
    }
    if (of_interest) decode_packet(stream, begin);
    return true;
  }

  void decode_packet(int stream, std::uint64_t begin) {
    try {
      const auto content = decompressor_ ? decompressor_->decompress(packet_) : packet_;
      constexpr std::size_t size_prefix = 4;
      if (content.size() < size_prefix) throw std::runtime_error("it has no size");
      const FlatTable packet(content.subspan(size_prefix));
      if (stream == event_stream_)
        undelivered_ = packet.vector(0, kEventBytes);
      else
        packet.for_each_table(0, [&](const FlatTable& trigger) { add_trigger(trigger); });
    } catch (const RecordingError&) {
      throw;
    } catch (const std::exception& error) {
      throw RecordingError(bytes_.path(), std::string("packet: ") + error.what(), begin);
    }
  }

  // Leaves out triggers that are no signals at the input: resets of the clock, pulses of the camera's own generator,
  // exposures of frames.
  void add_trigger(const FlatTable& trigger) {
    constexpr int kRisingEdge = 1, kFallingEdge = 2, kPulse = 3;
    const int type = trigger.number<std::int8_t>(1, 0);
    if (type == kRisingEdge || type == kFallingEdge || type == kPulse)
      collector_.add(TriggerEvent{0, type != kFallingEdge, trigger.number<std::int64_t>(0, 0)});
  }

  int event_stream_ = 0;
  std::optional<int> trigger_stream_;
  std::uint64_t end_of_packets_ = ~std::uint64_t{0};
  std::unique_ptr<Decompressor> decompressor_;  // null if packets are not compressed
  std::span<const std::byte> undelivered_;      // events of the last packet
};

}  // namespace evmarker::io
