#pragma once
// Recordings of ROS 1, rosbag version 2.0, as a source of events.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
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

namespace detail {

/// The fields `name=value` in front of a record of a rosbag, or in one of a connection.
class BagFields {
 public:
  /// @throws std::runtime_error where they are garbled
  explicit BagFields(std::span<const std::byte> bytes) : bytes_(bytes) {
    for (FieldCursor fields(bytes); !fields.empty();)
      if (parted(fields.sized_bytes()).first.empty()) throw std::runtime_error("garbled: a field without name");
  }

  /// @throws std::runtime_error where the field is there, but is no number of this size
  template <std::unsigned_integral Word>
  std::optional<Word> number(std::string_view name) const {
    const auto value = find(name);
    if (!value) return std::nullopt;
    if (value->size() != sizeof(Word))
      throw std::runtime_error("garbled: field " + std::string(name) + " of " + std::to_string(value->size()) +
                               " bytes, must be of " + std::to_string(sizeof(Word)));
    return load_word<Word>(value->data());
  }

  /// @throws std::runtime_error where the field is there, but is not one line
  std::string text(std::string_view name) const {
    const auto value = find(name).value_or(std::span<const std::byte>());
    const std::string text(reinterpret_cast<const char*>(value.data()), value.size());
    require_one_line(text);
    return text;
  }

 private:
  static std::pair<std::string_view, std::span<const std::byte>> parted(std::span<const std::byte> field) {
    const std::string_view text(reinterpret_cast<const char*>(field.data()), field.size());
    const auto name = std::min(text.find('='), text.size());
    return {text.substr(0, name), field.subspan(std::min(name + 1, field.size()))};
  }

  std::optional<std::span<const std::byte>> find(std::string_view name) const {
    for (FieldCursor fields(bytes_); !fields.empty();)
      if (const auto [key, value] = parted(fields.sized_bytes()); key == name) return value;
    return std::nullopt;
  }

  std::span<const std::byte> bytes_;
};

}  // namespace detail

/// Reads the events of one topic of a rosbag (http://wiki.ros.org/Bags/Format/2.0), in the order of the file. Its
/// topics are known from the index at its end; of a pipe, or where there is none, each where it begins.
class RosbagReader final : public BagReader {
 public:
  /// @throws RecordingError where the file cannot be read, the topic is not there or not the only one, or its chunks
  /// are encrypted, or compressed by a library that this build leaves out
  explicit RosbagReader(std::filesystem::path path, const RecordingOptions& options = {})
      : RosbagReader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit RosbagReader(BlockReader blocks, const RecordingOptions& options = {})
      : BagReader(std::move(blocks), options) {
    if (!bytes_.peek_text(kFirstLine.size()).starts_with(kFirstLine))
      throw RecordingError(bytes_.path(), "not a rosbag of version 2.0: no first line '#ROSBAG V2.0'", 0);
    bytes_.skip(kFirstLine.size());
    read_record_of_file();  // where the index is
    find_first_message(read_index());
  }

 private:
  static constexpr std::string_view kFirstLine = "#ROSBAG V2.0\n";
  static constexpr int kMessage = 2, kFileHeader = 3, kChunk = 5, kConnection = 7;

  // What the fields in front of a record say.
  struct Record {
    explicit Record(const detail::BagFields& fields)
        : type(fields.number<std::uint8_t>("op").value_or(0)),
          connection(fields.number<std::uint32_t>("conn").value_or(0)),
          topic(fields.text("topic")),
          compression(fields.text("compression")),
          encryptor(fields.text("encryptor")),
          index(fields.number<std::uint64_t>("index_pos").value_or(0)) {
      if (type == 0) throw std::runtime_error("garbled: no field op");
    }

    int type;
    std::uint32_t connection;
    std::string topic, compression, encryptor;
    std::uint64_t index;
  };

  bool read_record_of_file() override {
    constexpr std::size_t kSizeBytes = 4;
    begin_ = bytes_.position();
    const auto size = bytes_.peek(kSizeBytes);
    if (size.size() < kSizeBytes) return end_of_file();
    const std::size_t header_bytes = load_word<std::uint32_t>(size.data()), bytes = header_bytes + 2 * kSizeBytes;
    if (bytes > BlockReader::kMaxKeep)
      throw RecordingError(bytes_.path(),
                           "record: its fields have " + std::to_string(header_bytes) + " bytes: garbled?", begin_);
    const auto ahead = bytes_.peek(bytes);
    if (ahead.size() < bytes) return end_of_file();
    const auto record = read_part(bytes_.path(), "record", begin_,
                                  [&] { return Record(detail::BagFields(ahead.subspan(kSizeBytes, header_bytes))); });
    const auto length = load_word<std::uint32_t>(&ahead[bytes - kSizeBytes]);
    bytes_.skip(bytes);
    if (read_part(bytes_.path(), "record", begin_, [&] { return read_or_pass(record, length); })) return true;
    collector_.statistics.truncated_bytes += bytes_.position() - begin_;
    return false;
  }

  // False where the file ends before the end of the record.
  bool read_or_pass(const Record& record, std::uint32_t length) {
    if (record.type == kFileHeader) {
      index_ = record.index;
      if (!record.encryptor.empty())
        throw std::runtime_error("encryptor is '" + record.encryptor + "', which is not supported");
    }
    if (record.type == kChunk && length > 0) {
      if (record.compression == "none") return true;  // its records follow like any others
      if (record.compression != "lz4" && record.compression != "bz2")
        throw std::runtime_error("compression is '" + record.compression +
                                 "', which is not supported (none, lz4 and bz2 are)");
      return read_chunk(record.compression == "lz4" ? Compression::lz4 : Compression::bz2, length);
    }
    if (!is_of_interest(record)) return skip_bytes(length);
    if (!read_bytes(length, "record")) return false;
    use(record, packet_);
    return true;
  }

  void read_record_of_chunk() override {
    FieldCursor fields(chunk_);
    const Record record(detail::BagFields(fields.sized_bytes()));
    const auto content = fields.sized_bytes();
    chunk_ = chunk_.subspan(fields.position());
    if (is_of_interest(record)) use(record, content);
  }

  bool is_of_interest(const Record& record) const {
    return record.type == kConnection || (record.type == kMessage && topics_.find(record.connection));
  }

  void use(const Record& record, std::span<const std::byte> content) {
    if (record.type == kMessage) return messages_.begin(content, *topics_.find(record.connection), begin_);
    topics_.add(record.connection, record.topic, detail::BagFields(content).text("type"), false);
    topics_.require_one();
  }

  // Adds the topics of the index at the end of a file; false where there is none.
  bool read_index() {
    const std::uint64_t total = bytes_.bytes_total();
    if (index_ == 0 || index_ >= total || total - index_ > Decompressor::kMaxBytes) return false;
    const auto index = read_ahead(index_, total);
    bool any = false;
    try {
      for (FieldCursor records(index); !records.empty();) {
        const Record record(detail::BagFields(records.sized_bytes()));
        const auto content = records.sized_bytes();
        if (record.type != kConnection) continue;
        topics_.add(record.connection, record.topic, detail::BagFields(content).text("type"), false);
        any = true;
      }
    } catch (const std::runtime_error&) {
      return false;  // a garbled one is none: what is in front of it may be good
    }
    return any;
  }

  std::uint64_t index_ = 0;  // its position in the file [bytes]; 0 where it is unknown
};

}  // namespace evmarker::io
