#pragma once
// What the readers of ROS recordings share that are sequences of records and compressed chunks of these.
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/compression.hpp"
#include "evmarker/io/decompression.hpp"
#include "evmarker/io/event_messages.hpp"
#include "evmarker/io/event_topics.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/streaming_reader.hpp"

namespace evmarker::io {

/// Passes through the records of a file and of its compressed chunks up to each message of events, which it decodes.
class BagReader : public StreamingReader {
 protected:
  /// @param blocks of which none but the first may have been read
  BagReader(BlockReader blocks, const RecordingOptions& options)
      : StreamingReader(std::move(blocks), options),
        topics_(bytes_.path(), options.topic),
        messages_(bytes_.path(), options) {}

  /// Reads on to the first message, by which the size of the sensor is known.
  /// @param index_read true where an index has shown all topics that there are
  /// @throws RecordingError where the topic is not there, or not the only one
  void find_first_message(bool index_read) {
    if (index_read) topics_.require_chosen();
    topics_.require_one();
    while (!messages_.any() && read_record())
      ;
    if (!messages_.any()) topics_.require_chosen();
    collector_.set_sensor_size(messages_.sensor_size());
  }

  /// Reads a chunk that is compressed; false where the file ends before its end.
  /// @throws RecordingError where it is garbled, or this build cannot decompress it
  bool read_chunk(Compression compression, std::uint64_t bytes) {
    if (!decompressor_ || compression != compression_) {
      decompressor_ = make_decompressor(compression, "chunks", bytes_.path());
      compression_ = compression;
    }
    if (!read_bytes(bytes, "chunk")) return false;
    chunk_ = read_part(bytes_.path(), "chunk", begin_, [&] { return decompressor_->decompress(packet_); });
    packet_ = {};
    // A message of the chunk may take as much again.
    if (pieces_.size() > kMostKept) pieces_ = std::vector<std::byte>();
    return true;
  }

  /// A part of a file, before the stream reaches it; what is behind the end of the file is zero.
  std::vector<std::byte> read_ahead(std::uint64_t begin, std::uint64_t end) const {
    std::ifstream file(bytes_.path(), std::ios::binary);
    std::vector<std::byte> bytes(static_cast<std::size_t>(end - begin));
    file.seekg(static_cast<std::streamoff>(begin));
    file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return bytes;
  }

  EventTopics topics_;
  EventMessages messages_;
  std::span<const std::byte> chunk_;  // records of a compressed chunk that are not read yet
  std::uint64_t begin_ = 0;           // of the record, or chunk, in the file

 private:
  static constexpr std::size_t kMostKept = std::size_t{8} << 20;

  /// Reads a record of the file, or passes over it; false at the end of the data.
  virtual bool read_record_of_file() = 0;
  /// Reads the first record of `chunk_`.
  virtual void read_record_of_chunk() = 0;

  bool read_piece() final {
    if (messages_.done()) return read_record();
    messages_.decode_piece(collector_);
    return true;
  }

  bool read_record() {
    if (chunk_.empty()) return read_record_of_file();
    read_part(bytes_.path(), "chunk", begin_, [&] { read_record_of_chunk(); });
    return true;
  }

  Compression compression_ = Compression::none;
  std::unique_ptr<Decompressor> decompressor_;
};

}  // namespace evmarker::io
