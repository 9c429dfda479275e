#pragma once
// Streams of bzip2, where the build has libbz2: with the component `bz2`.
#include <algorithm>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>

#include "evmarker/io/decompression.hpp"

#ifdef EVMARKER_HAS_BZ2
#include <bzlib.h>
#endif

namespace evmarker::io {

#ifdef EVMARKER_HAS_BZ2
class Bz2Decompressor final : public Decompressor {
 public:
  Bz2Decompressor() { begin(); }
  ~Bz2Decompressor() override { BZ2_bzDecompressEnd(&stream_); }
  Bz2Decompressor(const Bz2Decompressor&) = delete;
  Bz2Decompressor& operator=(const Bz2Decompressor&) = delete;

 private:
  void begin() {
    stream_ = {};
    if (BZ2_bzDecompressInit(&stream_, 0, 0) != BZ_OK) throw std::bad_alloc();
  }

  Step advance(std::span<const std::byte> input, std::span<std::byte> output) override {
    constexpr std::size_t most = std::numeric_limits<unsigned>::max();
    // Its input is not const, but it does not change it.
    stream_.next_in = const_cast<char*>(reinterpret_cast<const char*>(input.data()));
    stream_.avail_in = static_cast<unsigned>(std::min(input.size(), most));
    stream_.next_out = reinterpret_cast<char*>(output.data());
    stream_.avail_out = static_cast<unsigned>(std::min(output.size(), most));
    const unsigned in = stream_.avail_in, out = stream_.avail_out;
    const int result = BZ2_bzDecompress(&stream_);
    if (result != BZ_OK && result != BZ_STREAM_END)
      throw std::runtime_error("bzip2: garbled, error " + std::to_string(result));
    const Step step{in - stream_.avail_in, out - stream_.avail_out, result == BZ_STREAM_END};
    if (step.complete) {  // it decompresses one stream alone
      BZ2_bzDecompressEnd(&stream_);
      begin();
    }
    return step;
  }

  bz_stream stream_{};
};

#endif

/// What decompresses bzip2 streams; nothing where this build leaves it out.
inline std::unique_ptr<Decompressor> make_bz2_decompressor() {
#ifdef EVMARKER_HAS_BZ2
  return std::make_unique<Bz2Decompressor>();
#else
  return nullptr;
#endif
}

}  // namespace evmarker::io
