#pragma once
// A file in blocks: the next one is read while the present one is decoded.
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
  static constexpr std::size_t kMaxKeep = std::size_t{1} << 16;  ///< longest piece carried over to the next block

  /// @throws RecordingError where the file is missing, a directory or not readable
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

  /// The next block, preceded by the last `keep` (at most kMaxKeep) bytes of the block before; only those at the end.
  /// Valid until the next call. @throws RecordingError where the device fails
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

  /// True once a call of `next` found nothing more to read.
  bool at_end() const noexcept { return at_end_; }
  const std::filesystem::path& path() const noexcept { return state_->path; }
  /// Size of the file when it was opened; 0 where it has none, as a pipe.
  std::uint64_t bytes_total() const noexcept { return bytes_total_; }

 private:
  // On the heap so that a read under way keeps its address when the reader is moved. The future comes last: it is
  // destroyed first and waits for that read.
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
    // Where the system has no thread to spare, this policy reads when the block is asked for.
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
