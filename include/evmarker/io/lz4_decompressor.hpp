#pragma once
// LZ4 frames, where the build has liblz4: with the component `lz4`.
#include <memory>
#include <span>
#include <stdexcept>
#include <string>

#include "evmarker/io/decompression.hpp"

#ifdef EVMARKER_HAS_LZ4
#include <lz4frame.h>
#endif

namespace evmarker::io {

#ifdef EVMARKER_HAS_LZ4
class Lz4Decompressor final : public Decompressor {
 public:
  Lz4Decompressor() {
    LZ4F_dctx* context = nullptr;
    require_good(LZ4F_createDecompressionContext(&context, LZ4F_VERSION));
    context_.reset(context);
  }

 private:
  struct Free {
    void operator()(LZ4F_dctx* context) const { LZ4F_freeDecompressionContext(context); }
  };

  static std::size_t require_good(std::size_t result) {
    if (LZ4F_isError(result) != 0) throw std::runtime_error(std::string("LZ4: ") + LZ4F_getErrorName(result));
    return result;
  }

  Step advance(std::span<const std::byte> input, std::span<std::byte> output) override {
    Step step{input.size(), output.size(), false};
    step.complete = require_good(LZ4F_decompress(context_.get(), output.data(), &step.produced, input.data(),
                                                 &step.consumed, nullptr)) == 0;
    return step;
  }

  std::unique_ptr<LZ4F_dctx, Free> context_;
};

#endif

/// What decompresses LZ4 frames; nothing where this build leaves it out.
inline std::unique_ptr<Decompressor> make_lz4_decompressor() {
#ifdef EVMARKER_HAS_LZ4
  return std::make_unique<Lz4Decompressor>();
#else
  return nullptr;
#endif
}

}  // namespace evmarker::io
