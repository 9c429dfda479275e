#pragma once
// MCAP recordings of ROS, as rosbag2 writes them, as a source of events.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/io/bag_reader.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/compression.hpp"
#include "evmarker/io/decompression.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/field_cursor.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"

namespace evmarker::io {

/// Reads the events of one topic of an MCAP recording (https://mcap.dev/spec), in the order of the file. Its topics are
/// known from the summary at its end; of a pipe, or where there is none, each where it begins.
class McapReader final : public BagReader {
 public:
  /// @throws RecordingError where the file cannot be read, the topic is not there or not the only one, or its chunks
  /// are compressed by a library that this build leaves out
  explicit McapReader(std::filesystem::path path, const RecordingOptions& options = {})
      : McapReader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit McapReader(BlockReader blocks, const RecordingOptions& options = {})
      : BagReader(std::move(blocks), options) {
    if (!bytes_.peek_text(kMagic.size()).starts_with(kMagic))
      throw RecordingError(bytes_.path(), "not an MCAP recording: it does not begin with '\\x89MCAP0'", 0);
    bytes_.skip(kMagic.size());
    find_first_message(read_summary());
  }

 private:
  static constexpr std::string_view kMagic = "\x89MCAP0\r\n";
  static constexpr std::size_t kHeaderBytes = 9;

  enum class Record : unsigned char { footer = 2, schema = 3, channel = 4, message = 5, chunk = 6, data_end = 15 };

  bool read_record_of_file() override {
    const auto header = bytes_.peek(kHeaderBytes);
    if (header.size() < kHeaderBytes) return end_of_file();
    begin_ = bytes_.position();
    const auto type = static_cast<Record>(header[0]);
    const auto length = load_word<std::uint64_t>(&header[1]);
    if (header[0] == std::byte{0})
      throw RecordingError(bytes_.path(), "record: its type is 0, which none has: garbled", begin_);
    bytes_.skip(kHeaderBytes);
    if (type == Record::data_end || type == Record::footer) {  // an index follows: a pipe must be read to its end
      skip_bytes(~std::uint64_t{0});
      return false;
    }
    if (type == Record::chunk ? read_chunk_record(length) : read_or_skip(type, length)) return true;
    collector_.statistics.truncated_bytes += bytes_.position() - begin_;
    return false;
  }

  // False where the file ends before the end of the record.
  bool read_or_skip(Record type, std::uint64_t length) {
    const auto id = bytes_.peek(2);
    const bool is_message = type == Record::message && length >= 2 && id.size() >= 2;
    if (is_message && !topics_.find(load_word<std::uint16_t>(id.data()))) return skip_bytes(length);
    if (type != Record::schema && type != Record::channel && type != Record::message) return skip_bytes(length);
    if (!read_bytes(length, "record")) return false;
    use(type, packet_);
    return true;
  }

  // Reads a chunk that is compressed. The records of one that is not follow its header like any others. False where the
  // file ends before the end of the chunk.
  bool read_chunk_record(std::uint64_t length) {
    constexpr std::size_t kLongestHeader = 64;
    auto ahead = bytes_.peek(kLongestHeader);
    ahead = ahead.first(std::min(ahead.size(), kLongestHeader));
    if (ahead.size() < std::min<std::uint64_t>(kLongestHeader, length)) return skip_bytes(length);
    return read_part(bytes_.path(), "chunk", begin_, [&] {
      FieldCursor fields(ahead);
      fields.bytes(28);  // times, size, checksum
      const std::string compression(fields.text());
      const auto bytes = fields.number<std::uint64_t>();
      bytes_.skip(fields.position());
      if (compression.empty() || bytes == 0) return true;
      if (compression != "lz4" && compression != "zstd")
        throw std::runtime_error("compression is '" + compression + "', which is not supported (lz4 and zstd are)");
      return read_chunk(compression == "lz4" ? Compression::lz4 : Compression::zstd, bytes);
    });
  }

  void read_record_of_chunk() override {
    FieldCursor fields(chunk_);
    const auto type = static_cast<Record>(fields.number<std::uint8_t>());
    const auto content = fields.bytes(fields.number<std::uint64_t>());
    chunk_ = chunk_.subspan(fields.position());
    use(type, content);
  }

  void use(Record type, std::span<const std::byte> content) {
    read_part(bytes_.path(), "record", begin_, [&] {
      FieldCursor fields(content);
      if (type == Record::message) {
        const auto format = topics_.find(fields.number<std::uint16_t>());
        if (!format) return;
        fields.bytes(20);  // number, times
        messages_.begin(content.subspan(fields.position()), *format, begin_);
      } else if (add_topic(type, fields)) {
        topics_.require_one();
      }
    });
  }

  // True for a channel.
  bool add_topic(Record type, FieldCursor fields) {
    if (type != Record::schema && type != Record::channel) return false;
    const auto id = fields.number<std::uint16_t>();
    if (type == Record::schema) {
      types_[id] = fields.text().substr(0, 100);  // longer than any that has events
      return false;
    }
    const std::string type_name = types_[fields.number<std::uint16_t>()];
    const std::string_view name = fields.text(), encoding = fields.text();
    const bool is_of_ros = encoding == "cdr" || encoding == "ros1";
    topics_.add(id, name, is_of_ros ? type_name : "", encoding == "cdr");
    return true;
  }

  // Adds the topics of the summary in front of the footer, at the end of a file; false where there is none.
  bool read_summary() {
    constexpr std::size_t kFooterBytes = kHeaderBytes + 20;
    const std::uint64_t total = bytes_.bytes_total();
    if (total < kFooterBytes + kMagic.size()) return false;
    const std::uint64_t footer = total - kMagic.size() - kFooterBytes;
    const auto end = read_ahead(footer, total);
    if (!std::ranges::equal(std::span(end).last(kMagic.size()), std::as_bytes(std::span(kMagic)))) return false;
    const auto begin = load_word<std::uint64_t>(&end[kHeaderBytes]);
    if (begin >= footer || footer - begin > Decompressor::kMaxBytes) return false;
    const auto summary = read_ahead(begin, footer);
    bool any = false;
    try {
      for (FieldCursor records(summary); !records.empty();) {
        const auto type = static_cast<Record>(records.number<std::uint8_t>());
        any |= add_topic(type, FieldCursor(records.bytes(records.number<std::uint64_t>())));
      }
    } catch (const std::runtime_error&) {
      return false;  // a garbled one is none: what is in front of it may be good
    }
    return any;
  }

  std::map<std::uint16_t, std::string> types_;  // of the schemas
};

}  // namespace evmarker::io
