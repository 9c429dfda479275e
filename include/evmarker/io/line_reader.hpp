#pragma once
// A text file line by line, in constant memory.
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// Reads lines without their ends (`\n` or `\r\n`); each is valid until the next call.
class LineReader {
 public:
  /// @throws RecordingError where the file cannot be read
  explicit LineReader(std::filesystem::path path, std::size_t block_bytes = BlockReader::kBlockBytes)
      : LineReader(BlockReader(std::move(path), block_bytes)) {}

  /// Continues with a file that is open; of its blocks, none but the first may have been read.
  explicit LineReader(BlockReader blocks) : blocks_(std::move(blocks)), rest_(blocks_.next()) {
    constexpr std::string_view byte_order_mark = "\xEF\xBB\xBF";  // some programs begin UTF-8 with it
    if (!lookahead().starts_with(byte_order_mark)) return;
    offset_ = byte_order_mark.size();
    rest_ = rest_.subspan(offset_);
  }

  /// The next line, or nothing at the end of the file.
  /// @throws RecordingError where a line is longer than 64 KiB or reading fails
  std::optional<std::string_view> next() {
    const void* end = find_line_end();
    while (end == nullptr && !blocks_.at_end()) {
      if (rest_.size() > BlockReader::kMaxKeep)
        throw error_at(line_number_ + 1, offset_, "longer than 65536 characters: not a text file?");
      rest_ = blocks_.next(rest_.size());
      end = find_line_end();
    }
    if (end == nullptr && rest_.empty()) return std::nullopt;
    ended_ = end != nullptr;
    const char* const begin = reinterpret_cast<const char*>(rest_.data());
    const std::size_t length = ended_ ? static_cast<std::size_t>(static_cast<const char*>(end) - begin) : rest_.size();
    const std::size_t consumed = length + (ended_ ? 1 : 0);
    rest_ = rest_.subspan(consumed);
    line_offset_ = offset_;
    offset_ += consumed;
    ++line_number_;
    std::string_view line(begin, length);
    if (line.ends_with('\r')) line.remove_suffix(1);
    return line;
  }

  /// The text behind the last line as far as it is in memory: all of it where the file is shorter than a block.
  std::string_view lookahead() const noexcept { return {reinterpret_cast<const char*>(rest_.data()), rest_.size()}; }

  /// Number of the last line, from 1.
  std::uint64_t line_number() const noexcept { return line_number_; }
  /// Position of the last line in the file [bytes].
  std::uint64_t byte_offset() const noexcept { return line_offset_; }
  /// False where the file ends within the last line.
  bool line_ended() const noexcept { return ended_; }
  std::uint64_t bytes_read() const noexcept { return offset_; }
  std::uint64_t bytes_total() const noexcept { return blocks_.bytes_total(); }
  const std::filesystem::path& path() const noexcept { return blocks_.path(); }

  /// An error with number and position of the last line.
  RecordingError error(const std::string& reason) const { return error_at(line_number_, line_offset_, reason); }

 private:
  const void* find_line_end() const noexcept {
    return rest_.empty() ? nullptr : std::memchr(rest_.data(), '\n', rest_.size());
  }

  RecordingError error_at(std::uint64_t line, std::uint64_t offset, const std::string& reason) const {
    return {blocks_.path(), "line " + std::to_string(line) + ": " + reason, offset};
  }

  BlockReader blocks_;
  std::span<const std::byte> rest_;
  std::uint64_t offset_ = 0, line_offset_ = 0, line_number_ = 0;
  bool ended_ = true;
};

}  // namespace evmarker::io
