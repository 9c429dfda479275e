#pragma once
// The error of all readers and writers, with file, position and reason.
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace evmarker::io {

/// Thrown where a recording or pose file cannot be read or written; `what()` is one line: `path: reason (byte n)`.
class RecordingError : public std::runtime_error {
 public:
  /// @param byte_offset position in the file; nothing where the error concerns the whole file
  RecordingError(std::filesystem::path path, std::string reason,
                 std::optional<std::uint64_t> byte_offset = std::nullopt)
      : std::runtime_error(path.string() + ": " + reason +
                           (byte_offset ? " (byte " + std::to_string(*byte_offset) + ")" : "")),
        path_(std::move(path)),
        reason_(std::move(reason)),
        byte_offset_(byte_offset) {}

  const std::filesystem::path& path() const noexcept { return path_; }
  const std::string& reason() const noexcept { return reason_; }
  std::optional<std::uint64_t> byte_offset() const noexcept { return byte_offset_; }

 private:
  std::filesystem::path path_;
  std::string reason_;
  std::optional<std::uint64_t> byte_offset_;
};

/// What `read()` returns; of what it throws, a RecordingError that names the file, the part and its position.
/// @param part its name in errors, like `chunk`
template <std::invocable Read>
auto read_part(const std::filesystem::path& path, const char* part, std::optional<std::uint64_t> byte_offset,
               const Read& read) {
  try {
    return read();
  } catch (const RecordingError&) {
    throw;
  } catch (const std::runtime_error& error) {
    throw RecordingError(path, std::string(part) + ": " + error.what(), byte_offset);
  }
}

}  // namespace evmarker::io
