#pragma once
// Zstandard frames, where the build has libzstd: with the component `zstd`.
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>

#include "evmarker/io/decompression.hpp"

#ifdef EVMARKER_HAS_ZSTD
#include <zstd.h>
#endif

namespace evmarker::io {

#ifdef EVMARKER_HAS_ZSTD
class ZstdDecompressor final : public Decompressor {
 public:
  ZstdDecompressor() : context_(ZSTD_createDCtx()) {
    if (!context_) throw std::bad_alloc();
    constexpr int most_log2 = 26;  // a window as large as what is decompressed: it is memory, too
    ZSTD_DCtx_setParameter(context_.get(), ZSTD_d_windowLogMax, most_log2);
  }

 private:
  struct Free {
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
  };

  Step advance(std::span<const std::byte> input, std::span<std::byte> output) override {
    ZSTD_inBuffer in{input.data(), input.size(), 0};
    ZSTD_outBuffer out{output.data(), output.size(), 0};
    const std::size_t left = ZSTD_decompressStream(context_.get(), &out, &in);
    if (ZSTD_isError(left) != 0) throw std::runtime_error(std::string("ZSTD: ") + ZSTD_getErrorName(left));
    return {in.pos, out.pos, left == 0};
  }

  std::unique_ptr<ZSTD_DCtx, Free> context_;
};

#endif

/// What decompresses Zstandard frames; nothing where this build leaves it out.
inline std::unique_ptr<Decompressor> make_zstd_decompressor() {
#ifdef EVMARKER_HAS_ZSTD
  return std::make_unique<ZstdDecompressor>();
#else
  return nullptr;
#endif
}

}  // namespace evmarker::io
