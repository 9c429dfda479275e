#pragma once
// A file in blocks: while one is decoded, the next is read on another thread.
#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// Reads a file of any size, a pipe or a FIFO once, from beginning to end, through two buffers. Movable; not
/// thread-safe.
class BlockReader {
 public:
  static constexpr std::size_t kBlockBytes = std::size_t{1} << 20;
  /// Most bytes in a block of a pipe, FIFO or device, which is not delivered before it is full.
  static constexpr std::size_t kPipeBlockBytes = std::size_t{1} << 16;
  static constexpr std::size_t kMaxKeep = std::size_t{1} << 16;  ///< most bytes kept from the block before

  /// @param stop must outlive the reader, which looks at it from another thread, too: once it is true, reading ends as
  /// at the end of the file, also while a pipe is silent or nobody writes to a FIFO; may be null
  /// @throws RecordingError where the file is missing, is a directory or cannot be opened
  explicit BlockReader(std::filesystem::path path, std::size_t block_bytes = kBlockBytes,
                       const std::atomic<bool>* stop = nullptr)
      : state_(std::make_unique<State>()) {
    state_->path = std::move(path);
    state_->block_bytes = std::max<std::size_t>(block_bytes, 1);
    state_->stop = stop;
    std::error_code error;
    const auto status = std::filesystem::status(state_->path, error);
    if (std::filesystem::is_directory(status)) throw RecordingError(state_->path, "is a directory, not a recording");
    if (!std::filesystem::is_regular_file(status)) state_->block_bytes = std::min(state_->block_bytes, kPipeBlockBytes);
    // Without O_NONBLOCK, opening a FIFO would wait until somebody writes to it, whatever `stop` says.
    state_->file = ::open(state_->path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (state_->file >= 0) ::fcntl(state_->file, F_SETFL, 0);
    if (state_->file < 0) throw RecordingError(state_->path, "cannot open: " + std::generic_category().message(errno));
    const auto bytes = std::filesystem::file_size(state_->path, error);
    if (!error) bytes_total_ = bytes;
    // One byte more: a file that fits into a block is known to end there.
    if (bytes_total_ > 0) state_->block_bytes = std::min<std::uint64_t>(state_->block_bytes, bytes_total_ + 1);
    read_ahead(std::launch::deferred);  // no thread for what may be no longer than a block, as most files of poses
  }

  /// The first block, which the first call of `next` returns again: to recognise what the file is.
  /// @throws RecordingError where reading fails
  std::span<const std::byte> first() {
    next();
    first_is_next_ = true;
    return block_;
  }

  /// The next block, with the last `keep` bytes (at most kMaxKeep) of what the call before returned in front of it; at
  /// the end of the file, only these. Valid until the next call.
  /// @throws RecordingError where reading fails, once all before it has been returned
  std::span<const std::byte> next(std::size_t keep = 0) {
    if (std::exchange(first_is_next_, false)) return block_;
    keep = std::min({keep, block_.size(), kMaxKeep});
    const auto kept = block_.last(keep);
    const std::size_t bytes = state_->ahead.valid() ? state_->ahead.get() : 0;
    if (bytes == 0 && state_->failure) throw *state_->failure;
    at_end_ = bytes == 0;
    if (at_end_) return block_ = kept;
    std::byte* const begin = state_->buffers[state_->filling].data() + kMaxKeep;
    std::copy(kept.begin(), kept.end(), begin - keep);
    block_ = {begin - keep, keep + bytes};
    state_->filling ^= 1U;
    // With both policies, a system that cannot start a thread reads in next() instead.
    if (bytes == state_->block_bytes) read_ahead(std::launch::async | std::launch::deferred);
    return block_;
  }

  /// True after a call of `next` that reached the end of the file.
  bool at_end() const noexcept { return at_end_; }
  const std::filesystem::path& path() const noexcept { return state_->path; }
  /// Size of the file when it was opened [bytes]; 0 where it has none, like a pipe.
  std::uint64_t bytes_total() const noexcept { return bytes_total_; }

 private:
  // On the heap, so that moving the reader does not move what the other thread uses.
  struct State {
    State() = default;
    State(const State&) = delete;
    State& operator=(const State&) = delete;
    ~State() {
      closing = true;
      if (ahead.valid()) ahead.wait();  // also runs a read that is deferred, which then reads nothing
      if (file >= 0) ::close(file);
    }

    // Fills the buffer; less only at the end of the file, at a failure, or once reading is to stop.
    std::size_t read(std::span<std::byte> buffer) {
      std::size_t bytes = 0;
      while (bytes < buffer.size() && wait_for_bytes()) {
        const auto count = ::read(file, buffer.data() + bytes, buffer.size() - bytes);
        if (count < 0 && errno == EINTR) continue;
        if (count < 0)
          failure.emplace(path, "cannot read: " + std::generic_category().message(errno), position + bytes);
        if (count <= 0) break;
        bytes += static_cast<std::size_t>(count);
      }
      position += bytes;
      return bytes;
    }

    // Waits for bytes or the end of the file; false if reading is to stop, which a silent pipe must not prevent.
    bool wait_for_bytes() const {
      constexpr int kLongestWait_ms = 50;
      pollfd waiting{file, POLLIN, 0};
      int ready = 0;
      while (ready == 0 || (ready < 0 && errno == EINTR)) {
        if (closing || (stop != nullptr && *stop)) return false;
        ready = ::poll(&waiting, 1, kLongestWait_ms);
      }
      return true;
    }

    std::filesystem::path path;
    std::size_t block_bytes = 0;
    const std::atomic<bool>* stop = nullptr;
    std::atomic<bool> closing = false;
    int file = -1;
    std::uint64_t position = 0;
    std::optional<RecordingError> failure;  // after the bytes that were read
    std::array<std::vector<std::byte>, 2> buffers;
    std::size_t filling = 0;
    std::future<std::size_t> ahead;
  };

  void read_ahead(std::launch policy) {
    state_->ahead = std::async(policy, [state = state_.get()] {
      auto& buffer = state->buffers[state->filling];
      buffer.resize(kMaxKeep + state->block_bytes);
      return state->read(std::span(buffer).subspan(kMaxKeep));
    });
  }

  std::unique_ptr<State> state_;
  std::span<const std::byte> block_;
  std::uint64_t bytes_total_ = 0;
  bool at_end_ = false, first_is_next_ = false;
};

}  // namespace evmarker::io
