#pragma once
// The bytes of a file in their order, as records and packets need them.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>
#include <utility>

#include "evmarker/io/block_reader.hpp"

namespace evmarker::io {

/// Passes through a file, a pipe or a FIFO once, in constant memory. Movable; not thread-safe.
class ByteStream {
 public:
  /// @param blocks of a file, of which at most the first has been read
  explicit ByteStream(BlockReader blocks) : blocks_(std::move(blocks)) {}

  /// The next bytes, which stay unread: at least `bytes` (at most BlockReader::kMaxKeep), fewer only at the end of the
  /// file. Valid until the next call.
  /// @throws RecordingError where reading fails
  std::span<const std::byte> peek(std::size_t bytes = 1) {
    while (rest_.size() < bytes && !blocks_.at_end()) rest_ = blocks_.next(rest_.size());
    return rest_;
  }
  std::string_view peek_text(std::size_t bytes = 1) {
    const auto rest = peek(bytes);
    return {reinterpret_cast<const char*>(rest.data()), rest.size()};
  }

  /// Skips bytes that `peek` has returned.
  void skip(std::size_t bytes) noexcept {
    rest_ = rest_.subspan(bytes);
    position_ += bytes;
  }

  /// Reads any number of bytes and calls `use(span)` with each piece of them.
  /// @return how many were read: fewer than `bytes` only at the end of the file
  template <typename Use>
  std::uint64_t pass(std::uint64_t bytes, const Use& use) {
    std::uint64_t passed = 0;
    while (passed < bytes && !peek().empty()) {
      const auto piece = rest_.first(static_cast<std::size_t>(std::min<std::uint64_t>(rest_.size(), bytes - passed)));
      use(piece);
      skip(piece.size());
      passed += piece.size();
    }
    return passed;
  }

  /// Skips the bytes that are in memory, all that is left once `peek` has reached the end of the file.
  /// @return their number
  std::size_t skip_rest() noexcept {
    const std::size_t bytes = rest_.size();
    skip(bytes);
    return bytes;
  }

  /// Number of bytes read or skipped.
  std::uint64_t position() const noexcept { return position_; }
  /// Size of the file when it was opened [bytes]; 0 where it has none, like a pipe.
  std::uint64_t bytes_total() const noexcept { return blocks_.bytes_total(); }
  const std::filesystem::path& path() const noexcept { return blocks_.path(); }

 private:
  BlockReader blocks_;
  std::span<const std::byte> rest_;
  std::uint64_t position_ = 0;
};

}  // namespace evmarker::io
