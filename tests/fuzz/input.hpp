#pragma once
// The bytes of a fuzzed input as numbers, and as a file.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace evmarker::fuzz {

/// A property that the library promises does not hold.
struct BrokenPromise : std::logic_error {
  using std::logic_error::logic_error;
};

inline void require_that(bool holds, const char* promise) {
  if (!holds) throw BrokenPromise(promise);
}

/// How many events, poses and files the targets have had from what they fuzz: where none arrive, nothing is checked.
inline std::atomic<std::uint64_t> arrived = 0;

/// Reads numbers from the bytes of an input; zeros where it has ended.
class Numbers {
 public:
  explicit Numbers(std::string_view bytes) : bytes_(bytes), size_(bytes.size()) {}

  bool empty() const noexcept { return bytes_.empty(); }
  std::string_view rest() const noexcept { return bytes_; }
  /// Goes on at this byte of the input, or stays behind it.
  void go_to(std::size_t at) noexcept {
    const std::size_t read = size_ - bytes_.size();
    if (read < at) bytes_.remove_prefix(std::min(at - read, bytes_.size()));
  }

  std::uint64_t bits(std::size_t bytes) noexcept {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < bytes; ++i)
      value |= std::uint64_t{i < bytes_.size() ? static_cast<std::uint8_t>(bytes_[i]) : std::uint8_t{0}} << (8 * i);
    bytes_.remove_prefix(std::min(bytes, bytes_.size()));
    return value;
  }
  std::uint8_t byte() noexcept { return static_cast<std::uint8_t>(bits(1)); }
  bool flag() noexcept { return byte() % 2 == 1; }
  /// One of 0 to count - 1; the first for the byte 0.
  std::size_t index(std::size_t count) noexcept { return byte() % count; }
  /// In [low, high], in 255 steps.
  double uniform(double low, double high) noexcept { return low + (high - low) * byte() / 255; }
  /// A positive number: 1 for the byte 0, up to `factor` times more or less, in equal ratios.
  double around_one(double factor) noexcept {
    return std::pow(factor, static_cast<double>(static_cast<std::int8_t>(byte())) / 127);
  }

 private:
  std::string_view bytes_;
  std::size_t size_;
};

/// A file in memory with this content, for functions that read files.
class MemoryFile {
 public:
  explicit MemoryFile(std::string_view content) : file_(::memfd_create("fuzz", MFD_CLOEXEC)) {
    if (file_ < 0 || ::write(file_, content.data(), content.size()) != static_cast<ssize_t>(content.size()))
      throw std::runtime_error("no file in memory");
  }
  ~MemoryFile() { ::close(file_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  std::filesystem::path path() const { return "/proc/self/fd/" + std::to_string(file_); }

 private:
  int file_;
};

/// A file on disk with this content, for libhdf5, which asks for its real path.
class DiskFile {
 public:
  explicit DiskFile(std::string_view content)
      : path_((std::filesystem::temp_directory_path() / "evmarker_fuzz_XXXXXX").string()) {
    const int file = ::mkstemp(path_.data());
    const bool written =
        file >= 0 && ::write(file, content.data(), content.size()) == static_cast<ssize_t>(content.size());
    if (file >= 0) ::close(file);
    if (!written) throw std::runtime_error("no temporary file " + path_);
  }
  ~DiskFile() { ::unlink(path_.c_str()); }
  DiskFile(const DiskFile&) = delete;
  DiskFile& operator=(const DiskFile&) = delete;

  std::filesystem::path path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace evmarker::fuzz
