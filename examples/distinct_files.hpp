#pragma once
// Refuses to write a file that is also read, written twice, or named as one of another kind.
#include <algorithm>
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

/// Endings of what OpenCV's FileStorage writes.
inline const std::vector<std::string> kCalibrationEndings{".yml", ".yaml", ".xml", ".json"};
/// Endings of what evmarker::io::save_board writes.
inline const std::vector<std::string> kBoardEndings{".yml", ".yaml"};

/// Call it before anything is written: a name that ends otherwise may be that of a recording, given by mistake.
/// @throws std::invalid_argument naming the option where its file ends in none of `endings`; devices and pipes may
inline void require_ending(const FileOption& output, const std::vector<std::string>& endings) {
  std::error_code error;
  const bool device =
      std::filesystem::exists(output.path, error) && !std::filesystem::is_regular_file(output.path, error);
  if (output.path.empty() || device || std::ranges::count(endings, output.path.extension().string()) > 0) return;
  std::string list;
  for (const std::string& ending : endings)
    list += (list.empty() ? "" : ending == endings.back() ? " or " : ", ") + ending;
  throw std::invalid_argument(output.name + ' ' + output.path.string() + ": must end in " + list);
}
