#pragma once
// Events from ROS messages of one topic.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "evmarker/events/event.hpp"
#include "evmarker/io/compression.hpp"
#include "evmarker/io/decompression.hpp"
#include "evmarker/io/event_collector.hpp"
#include "evmarker/io/event_message.hpp"
#include "evmarker/io/event_packet_decoder.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"

namespace evmarker::io {

/// Decodes message after message, each piece by piece. The sensor has the size that the first message states.
class EventMessages {
 public:
  /// @param path only named in errors
  EventMessages(std::filesystem::path path, const RecordingOptions& options)
      : path_(std::move(path)), options_(options) {}

  /// Begins with a message, whose bytes live until it is `done`.
  /// @throws RecordingError where it is garbled or nothing decodes it
  /// @param byte_offset of the message in the file, as far as it is known
  void begin(std::span<const std::byte> bytes, EventMessageFormat format,
             std::optional<std::uint64_t> byte_offset = std::nullopt) {
    message_ = {};
    read_part(path_, kPart, byte_offset, [&] {
      const EventMessage message = parse_event_message(decompressed(bytes, format), format);
      begin_decoder(message, format);
      message_ = message;
    });
  }

  /// True where all events of the message are decoded.
  bool done() const noexcept { return message_.data.empty() && message_.count == 0; }
  /// True once there was a message.
  bool any() const noexcept { return size_.has_value(); }
  /// @throws RecordingError where no message was there and the options name no size
  SensorSize sensor_size() const { return size_ ? *size_ : choose_size(std::nullopt); }

  /// Decodes a bounded number of the message's events.
  /// @throws RecordingError where it ends before them
  void decode_piece(EventCollector& collector) {
    if (message_.count > 0) return decode_list(collector);
    std::visit(
        [&](auto& decoder) {
          const std::size_t whole = message_.data.size() / decoder.kWordBytes * decoder.kWordBytes;
          const auto words = message_.data.first(std::min(whole, kPieceBytes));
          message_.data = message_.data.subspan(words.size());
          decoder.decode(words, message_.data, collector);
          if (words.empty()) collector.statistics.truncated_bytes += std::exchange(message_.data, {}).size();
        },
        *decoder_);
  }

 private:
  static constexpr std::size_t kPieceBytes = std::size_t{1} << 14;  // its events stay in the cache
  static constexpr std::uint32_t kPieceEvents = 8192;
  static constexpr const char* kPart = "message of events";

  SensorSize choose_size(std::optional<SensorSize> recorded) const {
    return choose_sensor_size(recorded, options_, 1 << 15, "ROS", path_);
  }

  // rosbag2 may compress each message, and marks none of these: but none that is not begins with such a number.
  std::span<const std::byte> decompressed(std::span<const std::byte> bytes, EventMessageFormat format) {
    constexpr std::uint32_t zstd = 0xFD2FB528;
    if (!format.is_cdr || bytes.size() < 4 || load_word<std::uint32_t>(bytes.data()) != zstd) return bytes;
    if (!decompressor_) decompressor_ = make_decompressor(Compression::zstd, "messages", path_);
    return decompressor_->decompress(bytes);
  }

  void begin_decoder(const EventMessage& message, EventMessageFormat format) {
    const SensorSize size = message.size;
    const bool known = size.width > 0 && size.height > 0;
    if (!size_) size_ = choose_size(known ? std::optional(size) : std::nullopt);
    if (known && size != *size_)
      throw std::runtime_error("its sensor has " + std::to_string(size.width) + " x " + std::to_string(size.height) +
                               " px, that of the first message " + std::to_string(size_->width) + " x " +
                               std::to_string(size_->height));
    if (!format.is_packet) return;
    if (!decoder_ || encoding_ != message.encoding) {
      decoder_ = make_event_packet_decoder(message.encoding, *size_, message.data);
      encoding_ = message.encoding.substr(0, 100);  // of one that is not there, no more than an error shows
    }
    if (!decoder_)
      throw std::runtime_error("encoding is '" + encoding_ +
                               "', which is not supported (evt3, evt21, mono, libcaer and libcaer_cmp are)");
    std::visit([&](auto& decoder) { decoder.begin(message.time_base); }, *decoder_);
  }

  void decode_list(EventCollector& collector) {
    std::uint32_t count = std::min(message_.count, kPieceEvents);
    message_.count -= count;
    read_part(path_, kPart, std::nullopt, [&] {
      for (FieldCursor& event = message_.list; count > 0; --count) {
        const auto x = event.number<std::uint16_t>(), y = event.number<std::uint16_t>();
        const auto s = event.number<std::uint32_t>(), ns = event.number<std::uint32_t>();
        collector.add(x, y, event.number<std::uint8_t>() != 0, Timestamp{s} * 1000000 + ns / 1000);
      }
    });
  }

  std::filesystem::path path_;
  RecordingOptions options_;
  std::optional<SensorSize> size_;
  EventMessage message_;
  std::unique_ptr<Decompressor> decompressor_;  // none where messages are not compressed
  std::string encoding_;
  std::optional<EventPacketDecoder> decoder_;
};

}  // namespace evmarker::io
