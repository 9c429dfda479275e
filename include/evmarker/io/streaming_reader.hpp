#pragma once
// A reader of records or packets that follow each other in a file.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/byte_stream.hpp"
#include "evmarker/io/collecting_reader.hpp"
#include "evmarker/io/decompression.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"

namespace evmarker::io {

/// Base of the readers that read a file, a pipe or a FIFO once, from its begin to its end.
class StreamingReader : public CollectingReader {
 public:
  std::uint64_t bytes_read() const final { return bytes_.position(); }
  std::uint64_t bytes_total() const final { return bytes_.bytes_total(); }

 protected:
  /// @param blocks of a file, of which at most the first has been read
  StreamingReader(BlockReader blocks, const RecordingOptions& options)
      : CollectingReader(blocks.path(), options), bytes_(std::move(blocks)) {}

  /// The next whole records of `bytes_each` bytes, which stay unread: at most `most`, and no more than fit a piece;
  /// none at the end of the file.
  std::span<const std::byte> peek_records(std::size_t bytes_each, std::size_t most = kPieceEvents) {
    const auto ahead = bytes_.peek(bytes_each);
    return ahead.first(std::min({most, kPieceEvents, ahead.size() / bytes_each}) * bytes_each);
  }

  /// Reads a record or packet, which `packet_` shows until the next call or `peek`; false if the file ends inside of
  /// it.
  /// @param what its name in errors
  /// @throws RecordingError where it is longer than Decompressor::kMaxBytes, as a garbled length may say
  bool read_bytes(std::uint64_t bytes, const char* what) {
    if (bytes > Decompressor::kMaxBytes)
      throw RecordingError(bytes_.path(),
                           std::string(what) + " of " + std::to_string(bytes) + " bytes, of which at most " +
                               std::to_string(Decompressor::kMaxBytes) + " are read: garbled?",
                           bytes_.position());
    if (const auto ahead = bytes_.peek(); ahead.size() >= bytes) {  // in one block: it need not be copied
      packet_ = ahead.first(static_cast<std::size_t>(bytes));
      bytes_.skip(packet_.size());
      return true;
    }
    pieces_.clear();
    const std::uint64_t read = bytes_.pass(
        bytes, [&](std::span<const std::byte> piece) { pieces_.insert(pieces_.end(), piece.begin(), piece.end()); });
    packet_ = pieces_;
    return read == bytes;
  }
  /// Skips a record or packet; false if the file ends inside of it.
  bool skip_bytes(std::uint64_t bytes) {
    return bytes_.pass(bytes, [](std::span<const std::byte>) {}) == bytes;
  }

  /// Counts the bytes of a last record that is cut off. Returns false: there is no further piece.
  bool end_of_file() {
    collector_.statistics.truncated_bytes += bytes_.skip_rest();
    return false;
  }

  ByteStream bytes_;
  std::span<const std::byte> packet_;  // the last record or packet that was read
  std::vector<std::byte> pieces_;      // of a packet that lies across blocks
};

}  // namespace evmarker::io
