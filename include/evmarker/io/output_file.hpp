#pragma once
// A file that appears under its name only when it is complete; unbuffered, and behind a buffer.
#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// The file that a path leads to by way of symlinks, whether it exists or not.
inline std::filesystem::path link_target(std::filesystem::path path) {
  constexpr int kMostLinks = 40;  // as many as Linux follows
  std::error_code error;
  for (int i = 0; i < kMostLinks && std::filesystem::is_symlink(path, error); ++i)
    path = path.parent_path() / std::filesystem::read_symlink(path, error);
  return path;
}

/// Where an OutputFile of this path writes until it is complete.
inline std::filesystem::path part_of(const std::filesystem::path& path) { return link_target(path).concat(".part"); }

/// Writes to `path.part` and renames it to `path` in `close()`; if that is never called, as after an exception, the
/// destructor removes the part. A symlink stays, its target is replaced. Devices and pipes are written directly.
class OutputFile {
 public:
  /// @throws RecordingError where the file cannot be created
  explicit OutputFile(std::filesystem::path path) : path_(std::move(path)), target_(path_), written_(path_) {
    std::error_code error;
    const auto status = std::filesystem::status(path_, error);
    if (std::filesystem::is_directory(status)) throw RecordingError(path_, "is a directory");
    if (!std::filesystem::status_known(status)) throw RecordingError(path_, "cannot create: " + error.message());
    if (!std::filesystem::exists(status) || std::filesystem::is_regular_file(status)) {
      target_ = link_target(path_);
      written_ = part_of(path_);
    }
    errno = 0;
    file_.open(written_, std::ios::binary | std::ios::trunc);
    if (!file_) throw failure("cannot create");
  }

  ~OutputFile() { discard(); }
  OutputFile(OutputFile&&) = default;
  OutputFile& operator=(OutputFile&& other) noexcept {
    discard();
    path_ = std::move(other.path_);
    target_ = std::move(other.target_);
    written_ = std::move(other.written_);
    file_ = std::move(other.file_);
    return *this;
  }

  /// @throws RecordingError where the disk is full or the file was closed
  void write(std::span<const std::byte> bytes) {
    errno = 0;
    if (!file_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size())))
      throw failure("cannot write");
  }
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }

  /// Renames the file to its final name; calling it again does nothing.
  /// @throws RecordingError where the disk is full or the file cannot be renamed
  void close() {
    if (!file_.is_open()) return;
    errno = 0;
    file_.close();
    if (!file_) {
      const RecordingError error = failure("cannot write");
      remove_part();
      throw error;
    }
    if (written_ == target_) return;
    std::error_code error;
    std::filesystem::rename(written_, target_, error);
    if (!error) return;
    remove_part();
    throw RecordingError(path_, "cannot rename " + written_.filename().string() + ": " + error.message());
  }

  bool is_open() const noexcept { return file_.is_open(); }
  const std::filesystem::path& path() const noexcept { return path_; }

 private:
  RecordingError failure(const std::string& what) const {
    return {path_, errno == 0 ? what : what + ": " + std::generic_category().message(errno)};
  }

  void discard() noexcept {
    if (!file_.is_open()) return;
    file_.close();
    remove_part();
  }

  void remove_part() noexcept {
    std::error_code ignored;
    if (written_ != target_) std::filesystem::remove(written_, ignored);
  }

  std::filesystem::path path_, target_, written_;
  std::ofstream file_;
};

/// An OutputFile behind a buffer, for writers that produce a few bytes at a time.
/// @tparam Buffer std::string or std::vector<std::byte>
template <typename Buffer>
class BufferedOutput {
 public:
  /// @throws RecordingError where the file cannot be created
  explicit BufferedOutput(std::filesystem::path path) : file_(std::move(path)) {}

  /// What is not written yet; append to it.
  /// @throws RecordingError where the file was closed
  Buffer& buffer() {
    if (!file_.is_open()) throw RecordingError(file_.path(), "cannot write: the file was closed");
    return buffer_;
  }

  /// @throws RecordingError where the disk is full or the file was closed
  void flush_if_large() {
    if (buffer_.size() >= kFlushBytes) flush();
  }

  /// Writes the rest and closes the file as OutputFile does; calling it again does nothing.
  /// @throws RecordingError where the disk is full or the file cannot be renamed
  void close() {
    if (!file_.is_open()) return;
    flush();
    file_.close();
  }

 private:
  static constexpr std::size_t kFlushBytes = std::size_t{1} << 16;

  void flush() {
    file_.write(buffer_);
    buffer_.clear();
  }

  OutputFile file_;
  Buffer buffer_;
};

}  // namespace evmarker::io
