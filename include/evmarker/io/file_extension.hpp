#pragma once
// The extension of a file's name, by which its format may be recognised.
#include <cctype>
#include <filesystem>
#include <string>

namespace evmarker::io {

/// The extension in lower case, with its dot; empty where there is none.
inline std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

}  // namespace evmarker::io
