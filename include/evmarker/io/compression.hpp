#pragma once
// How parts of recordings are compressed, and what a build decompresses.
#include <filesystem>
#include <memory>
#include <string>

#include "evmarker/io/bz2_decompressor.hpp"
#include "evmarker/io/decompression.hpp"
#include "evmarker/io/lz4_decompressor.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/zstd_decompressor.hpp"

namespace evmarker::io {

enum class Compression { none, lz4, zstd, bz2 };

/// Also the name of the component, and of its library.
constexpr const char* to_string(Compression compression) noexcept {
  switch (compression) {
    case Compression::none: return "none";
    case Compression::lz4: return "lz4";
    case Compression::zstd: return "zstd";
    case Compression::bz2: return "bz2";
  }
  return "?";
}

namespace detail {

inline std::unique_ptr<Decompressor> find_decompressor(Compression compression) {
  switch (compression) {
    case Compression::none: return nullptr;
    case Compression::lz4: return make_lz4_decompressor();
    case Compression::zstd: return make_zstd_decompressor();
    case Compression::bz2: return make_bz2_decompressor();
  }
  return nullptr;
}

}  // namespace detail

/// What decompresses the parts of a recording; nothing where they are not compressed.
/// @param parts their name in errors, like `packets`
/// @throws RecordingError where this build cannot decompress them
inline std::unique_ptr<Decompressor> make_decompressor(Compression compression, const std::string& parts,
                                                       const std::filesystem::path& path) {
  auto decompressor = detail::find_decompressor(compression);
  if (decompressor || compression == Compression::none) return decompressor;
  const std::string name = to_string(compression);
  throw RecordingError(path, "its " + parts + " are compressed by " + name +
                                 ", which this build leaves out: install lib" + name +
                                 "-dev and build with evmarker's component " + name);
}

}  // namespace evmarker::io
