#pragma once
// The lines of text in front of a recording's binary data.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/text_fields.hpp"

namespace evmarker::io {

/// The text in front of the first byte of data.
struct HeaderLines {
  std::vector<std::pair<std::string, std::string>> fields;  ///< every line as key and value, parted by the first blank
  std::size_t bytes = 0;                                    ///< length of the header

  /// Value of the last line with this key; empty where there is none.
  std::string_view field(std::string_view key) const {
    const auto found = std::find_if(fields.rbegin(), fields.rend(), [&](const auto& f) { return f.first == key; });
    return found == fields.rend() ? std::string_view() : std::string_view(found->second);
  }
  bool has(std::string_view key) const {
    return std::any_of(fields.begin(), fields.end(), [&](const auto& f) { return f.first == key; });
  }
};

namespace detail {

inline std::optional<int> parse_positive(std::string_view text) {
  const auto value = parse_as<int>(text);
  return value && *value >= 1 ? value : std::nullopt;
}

/// Size from `1280x720` or, with a comma as separator, `1280,720`.
inline std::optional<SensorSize> parse_geometry(std::string_view text, char separator) {
  const auto cut = text.find(separator);
  if (cut == std::string_view::npos) return std::nullopt;
  const auto width = parse_positive(text.substr(0, cut)), height = parse_positive(text.substr(cut + 1));
  if (!width || !height) return std::nullopt;
  return SensorSize{*width, *height};
}

/// True for header lines. The first data behind a header without end line may begin as one, but is not text.
inline bool is_text(std::string_view line) {
  return std::ranges::none_of(line, [](char c) { return static_cast<unsigned char>(c) < 0x20 && c != '\t'; });
}

/// The header line, with its end, at the beginning of `rest`; nothing where there is none that begins with `prefix`.
/// @param offset of `rest` in the file, which is named in errors
/// @throws RecordingError where the file ends within the line
inline std::optional<std::string_view> find_header_line(std::string_view rest, std::string_view prefix,
                                                        const std::filesystem::path& path, std::uint64_t offset) {
  if (!rest.starts_with(prefix)) return std::nullopt;
  const auto length = rest.find('\n');
  std::string_view line = rest.substr(0, length);
  if (line.ends_with('\r')) line.remove_suffix(1);
  if (!is_text(line)) return std::nullopt;
  if (length == std::string_view::npos) throw RecordingError(path, "cut off inside its header", offset);
  return rest.substr(0, length + 1);
}

/// Appends a line that was found.
inline void add_header_line(HeaderLines& header, std::string_view line, std::string_view prefix) {
  header.bytes += line.size();
  line.remove_prefix(prefix.size());
  while (line.ends_with('\n') || line.ends_with('\r')) line.remove_suffix(1);
  line.remove_prefix(std::min(line.find_first_not_of(' '), line.size()));
  const auto blank = std::min(line.find(' '), line.size());
  header.fields.emplace_back(line.substr(0, blank), line.substr(std::min(blank + 1, line.size())));
}

/// Reads the lines of a Prophesee header, which begin with `% `.
inline HeaderLines read_header_lines(std::string_view data, const std::filesystem::path& path) {
  HeaderLines header;
  while (const auto line = find_header_line(data.substr(header.bytes), "% ", path, header.bytes)) {
    add_header_line(header, *line, "% ");
    if (header.fields.back() != std::pair<std::string, std::string>("end", "")) continue;
    header.fields.pop_back();
    break;
  }
  return header;
}

}  // namespace detail

}  // namespace evmarker::io
