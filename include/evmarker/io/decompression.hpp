#pragma once
// Compressed packets, by the libraries that a build has.
#include <algorithm>
#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace evmarker::io {

/// Decompresses one frame after another into memory that does not grow beyond a limit, whatever a frame says.
class Decompressor {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{64} << 20;  // 4 million events, a second of a busy camera

  virtual ~Decompressor() = default;

  /// The content of a whole frame, valid until the next call.
  /// @throws std::runtime_error where it is garbled, incomplete or longer than kMaxBytes
  std::span<const std::byte> decompress(std::span<const std::byte> frame) {
    std::size_t bytes = 0;
    for (bool complete = false; !complete;) {
      if (bytes == content_.size()) grow();
      const Step step = advance(frame, std::span(content_).subspan(bytes));
      if (step.consumed + step.produced == 0 && !step.complete) throw std::runtime_error("its compressed data is cut");
      frame = frame.subspan(step.consumed);
      bytes += step.produced;
      complete = step.complete;
    }
    return std::span(content_).first(bytes);
  }

 protected:
  struct Step {
    std::size_t consumed = 0, produced = 0;  // bytes of the input and of the output
    bool complete = false;
  };

 private:
  /// Decompresses as much as there is input and space.
  /// @throws std::runtime_error
  virtual Step advance(std::span<const std::byte> input, std::span<std::byte> output) = 0;

  void grow() {
    if (content_.size() == kMaxBytes)
      throw std::runtime_error("it is longer than " + std::to_string(kMaxBytes) + " bytes when decompressed");
    content_.resize(std::clamp(2 * content_.size(), std::size_t{1} << 16, kMaxBytes));
  }

  std::vector<std::byte> content_;
};

}  // namespace evmarker::io
