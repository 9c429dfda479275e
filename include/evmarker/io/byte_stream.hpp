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
  /// @param blocks of which none but the first may have been read
  explicit ByteStream(BlockReader blocks) : blocks_(std::move(blocks)) {}

  /// All bytes in memory: at least `bytes` (at most BlockReader::kMaxKeep), or those up to the end of the file.
  /// Valid until the next call.
  /// @throws RecordingError where reading fails
  std::span<const std::byte> ahead(std::size_t bytes = 1) {
    while (rest_.size() < bytes && !blocks_.at_end()) rest_ = blocks_.next(rest_.size());
    return rest_;
  }
  std::string_view text_ahead(std::size_t bytes = 1) {
    const auto rest = ahead(bytes);
    return {reinterpret_cast<const char*>(rest.data()), rest.size()};
  }

  /// Passes over bytes that are in memory.
  void skip(std::size_t bytes) noexcept {
    rest_ = rest_.subspan(bytes);
    position_ += bytes;
  }

  /// Passes over `bytes` bytes, however many, and calls `use(span)` with each piece of them.
  /// @return their number, less only where the file ends before
  template <typename Use>
  std::uint64_t pass(std::uint64_t bytes, const Use& use) {
    std::uint64_t passed = 0;
    while (passed < bytes && !ahead().empty()) {
      const auto piece = rest_.first(static_cast<std::size_t>(std::min<std::uint64_t>(rest_.size(), bytes - passed)));
      use(piece);
      skip(piece.size());
      passed += piece.size();
    }
    return passed;
  }

  /// Passes over all that is left.
  /// @return its length [bytes], less than a block where `ahead` has reached the end
  std::size_t skip_rest() noexcept {
    const std::size_t bytes = rest_.size();
    skip(bytes);
    return bytes;
  }

  /// Number of bytes passed.
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
