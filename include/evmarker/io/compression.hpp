#pragma once
// How parts of recordings are compressed, and what a build decompresses.
#include <filesystem>
#include <memory>
#include <string>

#include "evmarker/io/decompression.hpp"
#include "evmarker/io/lz4_decompressor.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/zstd_decompressor.hpp"

namespace evmarker::io {

enum class Compression { none, lz4, zstd };

/// What decompresses the parts of a recording; nothing where they are not compressed.
/// @param parts their name in errors, like `packets`
/// @throws RecordingError where this build cannot decompress them
inline std::unique_ptr<Decompressor> make_decompressor(Compression compression, const std::string& parts,
                                                       const std::filesystem::path& path) {
  if (compression == Compression::none) return nullptr;
  const bool lz4 = compression == Compression::lz4;
  if (auto decompressor = lz4 ? make_lz4_decompressor() : make_zstd_decompressor()) return decompressor;
  const std::string library = lz4 ? "lz4" : "zstd";
  throw RecordingError(path, "its " + parts + " are compressed by " + (lz4 ? "LZ4" : "ZSTD") +
                                 ", which this build leaves out: install lib" + library +
                                 "-dev and build with evmarker's component " + library);
}

}  // namespace evmarker::io
