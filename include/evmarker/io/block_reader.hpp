#pragma once
// A file in blocks: while one is decoded, the next is read on another thread.
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <future>
#include <memory>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// Reads a file of any size through two buffers. Movable; not thread-safe.
class BlockReader {
 public:
  static constexpr std::size_t kBlockBytes = std::size_t{1} << 20;
  static constexpr std::size_t kMaxKeep = std::size_t{1} << 16;  ///< most bytes kept from the block before

  /// @throws RecordingError where the file is missing, is a directory or cannot be opened
  explicit BlockReader(std::filesystem::path path, std::size_t block_bytes = kBlockBytes)
      : state_(std::make_unique<State>()) {
    state_->path = std::move(path);
    state_->block_bytes = std::max<std::size_t>(block_bytes, 1);
    std::error_code error;
    if (std::filesystem::is_directory(state_->path, error))
      throw RecordingError(state_->path, "is a directory, not a recording");
    errno = 0;
    state_->file.open(state_->path, std::ios::binary);
    if (!state_->file) throw RecordingError(state_->path, "cannot open: " + std::generic_category().message(errno));
    const auto bytes = std::filesystem::file_size(state_->path, error);
    if (!error) bytes_total_ = bytes;
    read_ahead();
  }

  /// The last `keep` bytes (at most kMaxKeep) of the block before and the next block, which is empty at the end of the
  /// file; valid until the next call.
  /// @throws RecordingError where reading fails
  std::span<const std::byte> next(std::size_t keep = 0) {
    keep = std::min({keep, block_.size(), kMaxKeep});
    const auto kept = block_.last(keep);
    const std::size_t bytes = state_->ahead.valid() ? state_->ahead.get() : 0;
    at_end_ = bytes == 0;
    if (at_end_) return block_ = kept;
    std::byte* const begin = state_->buffers[state_->filling].data() + kMaxKeep;
    std::copy(kept.begin(), kept.end(), begin - keep);
    block_ = {begin - keep, keep + bytes};
    state_->filling ^= 1U;
    read_ahead();
    return block_;
  }

  /// True after a call of `next` that reached the end of the file.
  bool at_end() const noexcept { return at_end_; }
  const std::filesystem::path& path() const noexcept { return state_->path; }
  /// Size of the file when it was opened [bytes]; 0 where it has none, like a pipe.
  std::uint64_t bytes_total() const noexcept { return bytes_total_; }

 private:
  // On the heap, so that moving the reader does not move what the other thread uses. The future is the last member, so
  // that it is destroyed first: its destructor waits for that thread.
  struct State {
    std::filesystem::path path;
    std::size_t block_bytes = 0;
    std::ifstream file;
    std::uint64_t position = 0;
    std::array<std::vector<std::byte>, 2> buffers;
    std::size_t filling = 0;
    std::future<std::size_t> ahead;
  };

  void read_ahead() {
    // With both policies, a system that cannot start a thread reads in next() instead.
    state_->ahead = std::async(std::launch::async | std::launch::deferred, [state = state_.get()] {
      auto& buffer = state->buffers[state->filling];
      buffer.resize(kMaxKeep + state->block_bytes);
      errno = 0;
      state->file.read(reinterpret_cast<char*>(buffer.data() + kMaxKeep),
                       static_cast<std::streamsize>(state->block_bytes));
      if (state->file.bad())
        throw RecordingError(state->path, "cannot read: " + std::generic_category().message(errno), state->position);
      const auto bytes = static_cast<std::size_t>(state->file.gcount());
      state->position += bytes;
      return bytes;
    });
  }

  std::unique_ptr<State> state_;
  std::span<const std::byte> block_;
  std::uint64_t bytes_total_ = 0;
  bool at_end_ = false;
};

}  // namespace evmarker::io
