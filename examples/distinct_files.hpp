#pragma once
// Refuses to write a file that is also read, or written twice.
#include <evmarker/io/output_file.hpp>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

/// A file of the command line; not given where the path is empty.
struct FileOption {
  std::string name;  ///< of the option
  std::filesystem::path path;
};

/// True for one regular file, by whatever path, symlink or hard link, and for one that does not exist yet.
inline bool same_file(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code error;
  if (std::filesystem::exists(a, error) && std::filesystem::exists(b, error))
    return std::filesystem::is_regular_file(a, error) && std::filesystem::equivalent(a, b, error);
  const auto place = [&](const auto& path) {
    return std::filesystem::weakly_canonical(std::filesystem::absolute(evmarker::io::link_target(path), error), error);
  };
  const std::filesystem::path place_of_a = place(a);  // empty where it cannot be found
  return !place_of_a.empty() && place_of_a == place(b);
}

/// Call it before anything is written.
/// @throws std::invalid_argument naming both options where a file that is to be written, or the `.part` that it is
/// until it is complete, is another file of the command line or what the standard output goes to
inline void require_distinct(std::vector<FileOption> read, const std::vector<FileOption>& written) {
  read.push_back({"the standard output", "/dev/stdout"});
  const auto check = [](const FileOption& output, const FileOption& other) {
    if (output.path.empty() || other.path.empty()) return;
    if (same_file(output.path, other.path) || same_file(evmarker::io::part_of(output.path), other.path))
      throw std::invalid_argument(output.name + " " + output.path.string() + " would overwrite " + other.name + " " +
                                  other.path.string());
  };
  for (auto output = written.begin(); output != written.end(); ++output) {
    for (const FileOption& other : read) check(*output, other);
    for (auto other = written.begin(); other != output; ++other) check(*output, *other);
  }
}
