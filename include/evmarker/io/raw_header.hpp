#pragma once
// The text header of Prophesee RAW recordings: encoding and sensor size.
#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// Encodings of Prophesee RAW recordings.
enum class RawFormat { evt2, evt21, evt3 };

constexpr const char* to_string(RawFormat format) noexcept {
  switch (format) {
    case RawFormat::evt2: return "EVT2";
    case RawFormat::evt21: return "EVT2.1";
    case RawFormat::evt3: return "EVT3";
  }
  return "?";
}

/// What stands before the first event word.
struct RawHeader {
  RawFormat format = RawFormat::evt3;
  std::optional<SensorSize> size;  ///< nothing where neither geometry nor a known system_ID is given
  bool halves_swapped = false;     ///< EVT2.1 with `endianness=legacy`: the 32-bit halves of each word change places
  std::vector<std::pair<std::string, std::string>> fields;  ///< every line as key and value
  std::size_t bytes = 0;                                    ///< length of the header
};

namespace detail {

inline std::optional<int> parse_positive(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || value < 1) return std::nullopt;
  return value;
}

/// `1280x720` or `1280,720`.
inline std::optional<SensorSize> parse_geometry(std::string_view text, char separator) {
  const auto cut = text.find(separator);
  if (cut == std::string_view::npos) return std::nullopt;
  const auto width = parse_positive(text.substr(0, cut)), height = parse_positive(text.substr(cut + 1));
  if (!width || !height) return std::nullopt;
  return SensorSize{*width, *height};
}

inline std::optional<SensorSize> size_of_system(std::string_view id) {
  constexpr std::array vga{21, 23, 25, 28, 29, 33, 34, 35, 40, 41};
  constexpr std::array hd{26, 30, 31, 39, 46, 48, 49, 50};
  const int system = parse_positive(id).value_or(0);
  if (std::ranges::find(vga, system) != vga.end()) return SensorSize{640, 480};
  if (std::ranges::find(hd, system) != hd.end()) return SensorSize{1280, 720};
  return std::nullopt;
}

/// Header lines are text; the first event word of a header without end line may look like `% ` but not go on as text.
inline bool is_text(std::string_view line) {
  return std::ranges::none_of(line, [](char c) { return static_cast<unsigned char>(c) < 0x20 && c != '\t'; });
}

/// Sets the encoding from `EVT3`, `3.0` and the like; false where the name is unknown.
inline bool set_format(RawHeader& header, std::string_view name) {
  constexpr std::array<std::pair<std::string_view, RawFormat>, 6> names{{{"EVT2", RawFormat::evt2},
                                                                         {"2.0", RawFormat::evt2},
                                                                         {"EVT21", RawFormat::evt21},
                                                                         {"2.1", RawFormat::evt21},
                                                                         {"EVT3", RawFormat::evt3},
                                                                         {"3.0", RawFormat::evt3}}};
  const auto* const found = std::ranges::find(names, name, &std::pair<std::string_view, RawFormat>::first);
  if (found == names.end()) return false;
  header.format = found->second;
  return true;
}

}  // namespace detail

/// Reads the header at the begin of `data`.
/// @param data at least the whole header, usually the file's first block
/// @param path only named in errors
/// @throws RecordingError where this is no RAW recording or one of an encoding that is not supported
inline RawHeader parse_raw_header(std::string_view data, const std::filesystem::path& path) {
  RawHeader header;
  while (data.substr(header.bytes).starts_with("% ")) {
    const std::string_view rest = data.substr(header.bytes);
    const auto length = rest.find('\n');
    if (length == std::string_view::npos) {
      if (detail::is_text(rest)) throw RecordingError(path, "cut off inside its header", header.bytes);
      break;
    }
    std::string_view line = rest.substr(2, length - 2);
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (!detail::is_text(line)) break;
    header.bytes += length + 1;
    if (line == "end") break;
    const auto space = std::min(line.find(' '), line.size());
    header.fields.emplace_back(line.substr(0, space), line.substr(std::min(space + 1, line.size())));
  }

  std::string_view format, evt, geometry, system, height, width;
  for (const auto& [key, value] : header.fields) {
    if (key == "format") format = value;
    if (key == "evt") evt = value;
    if (key == "geometry") geometry = value;
    if (key == "system_ID") system = value;
    if (key == "endianness") header.halves_swapped = value == "legacy";
  }
  std::string_view name = format.substr(0, format.find(';'));
  while (format.find(';') != std::string_view::npos) {
    format.remove_prefix(format.find(';') + 1);
    const std::string_view option = format.substr(0, format.find(';'));
    if (option.starts_with("height=")) height = option.substr(7);
    if (option.starts_with("width=")) width = option.substr(6);
    if (option.starts_with("endianness=")) header.halves_swapped = option == "endianness=legacy";
  }
  if (name.empty()) name = evt;
  if (name.empty())
    throw RecordingError(path, "not a Prophesee RAW recording: its header has no line '% format' or '% evt'", 0);
  if (!detail::set_format(header, name))
    throw RecordingError(path, "RAW encoding '" + std::string(name) + "' is not supported (EVT2, EVT2.1 and EVT3 are)",
                         0);

  if (const auto w = detail::parse_positive(width), h = detail::parse_positive(height); w && h)
    header.size = SensorSize{*w, *h};
  else if (!geometry.empty() && !(header.size = detail::parse_geometry(geometry, 'x')))
    throw RecordingError(path, "header: geometry is '" + std::string(geometry) + "', not like 1280x720", 0);
  else if (!header.size)
    header.size = detail::size_of_system(system);
  return header;
}

/// The header of a recording, with the fields by which OpenEB finds the decoder.
inline std::string make_raw_header(RawFormat format, SensorSize size) {
  const std::string width = std::to_string(size.width), height = std::to_string(size.height);
  const std::string name = format == RawFormat::evt21 ? "EVT21" : to_string(format);
  const std::string version = format == RawFormat::evt2 ? "2.0" : format == RawFormat::evt21 ? "2.1" : "3.0";
  return "% camera_integrator_name Prophesee\n% evt " + version + "\n% format " + name + ";height=" + height +
         ";width=" + width + "\n% geometry " + width + "x" + height +
         "\n% plugin_integrator_name Prophesee\n% plugin_name hal_plugin_prophesee\n% end\n";
}

}  // namespace evmarker::io
