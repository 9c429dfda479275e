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

/// Base of the readers that pass through a file, a pipe or a FIFO once.
class StreamingReader : public CollectingReader {
 public:
  std::uint64_t bytes_read() const final { return bytes_.position(); }
  std::uint64_t bytes_total() const final { return bytes_.bytes_total(); }

 protected:
  /// @param blocks of which none but the first may have been read
  StreamingReader(BlockReader blocks, const RecordingOptions& options)
      : CollectingReader(blocks.path(), options), bytes_(std::move(blocks)) {}

  /// Whole records of `bytes_each`, at most `most` and no more than a piece; none at the end of the file.
  std::span<const std::byte> records_ahead(std::size_t bytes_each, std::size_t most = kPieceEvents) {
    const auto ahead = bytes_.ahead(bytes_each);
    return ahead.first(std::min({most, kPieceEvents, ahead.size() / bytes_each}) * bytes_each);
  }

  /// Reads a part into `packet_`, if it is no longer than a limit, so that a garbled length takes no memory; false
  /// where the file ends before its end.
  /// @param what its name in errors
  bool read_whole(std::uint64_t bytes, const char* what) {
    if (bytes > Decompressor::kMaxBytes)
      throw RecordingError(bytes_.path(),
                           std::string(what) + " of " + std::to_string(bytes) + " bytes, of which at most " +
                               std::to_string(Decompressor::kMaxBytes) + " are read: garbled?",
                           bytes_.position());
    packet_.clear();
    const std::uint64_t read = bytes_.pass(
        bytes, [&](std::span<const std::byte> piece) { packet_.insert(packet_.end(), piece.begin(), piece.end()); });
    return read == bytes;
  }
  /// Passes over a part; false where the file ends before its end.
  bool pass_whole(std::uint64_t bytes) {
    return bytes_.pass(bytes, [](std::span<const std::byte>) {}) == bytes;
  }

  /// Counts what is left behind the last whole record; false, as there is no further piece.
  bool end() {
    collector_.statistics.truncated_bytes += bytes_.skip_rest();
    return false;
  }

  ByteStream bytes_;
  std::vector<std::byte> packet_;  // what was read whole
};

}  // namespace evmarker::io
