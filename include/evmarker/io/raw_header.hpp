#pragma once
// The text header of Prophesee RAW recordings: encoding and sensor size.
#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "evmarker/events/event.hpp"
#include "evmarker/io/header_lines.hpp"
#include "evmarker/io/recording_error.hpp"

namespace evmarker::io {

/// Encoding of a Prophesee RAW recording.
enum class RawFormat { evt2, evt21, evt3 };

constexpr const char* to_string(RawFormat format) noexcept {
  switch (format) {
    case RawFormat::evt2: return "EVT2";
    case RawFormat::evt21: return "EVT2.1";
    case RawFormat::evt3: return "EVT3";
  }
  return "?";
}

/// The text in front of the first event word.
struct RawHeader : HeaderLines {
  RawFormat format = RawFormat::evt3;
  std::optional<SensorSize> size;  ///< nothing where the header has neither a geometry nor a listed system_ID
  bool halves_swapped = false;     ///< EVT2.1: the upper half of each word comes first, `endianness=legacy`
  bool word_order_stated = false;  ///< false where `halves_swapped` is what cameras write that do not state it
};

namespace detail {

/// What a camera writes whose header does not say so.
struct CameraSystem {
  RawFormat format;
  SensorSize size;
};

/// The camera with this system_ID; nothing for one that is not listed.
inline std::optional<CameraSystem> find_system(std::string_view id) {
  constexpr std::array evt2_vga{21, 23, 25, 28, 29, 33, 34, 35, 41, 151, 153, 161, 162};
  constexpr std::array evt3_vga{40};
  constexpr std::array evt2_hd{26, 31, 39};
  constexpr std::array evt3_hd{30, 46, 48, 49, 50};
  constexpr SensorSize vga{640, 480}, hd{1280, 720};
  const int system = parse_positive(id).value_or(0);
  const auto is_in = [&](const auto& ids) { return std::ranges::find(ids, system) != ids.end(); };
  if (is_in(evt2_vga)) return CameraSystem{RawFormat::evt2, vga};
  if (is_in(evt3_vga)) return CameraSystem{RawFormat::evt3, vga};
  if (is_in(evt2_hd)) return CameraSystem{RawFormat::evt2, hd};
  if (is_in(evt3_hd)) return CameraSystem{RawFormat::evt3, hd};
  return std::nullopt;
}

/// The encoding of a name like `EVT3` or `3.0`; nothing where it is unknown.
inline std::optional<RawFormat> format_of(std::string_view name) {
  if (name == "EVT2" || name == "2.0") return RawFormat::evt2;
  if (name == "EVT21" || name == "2.1") return RawFormat::evt21;
  if (name == "EVT3" || name == "3.0") return RawFormat::evt3;
  return std::nullopt;
}

/// Value of `option`, like `;height=`, in a format line like `EVT3;height=720;width=1280`; empty where it is missing.
inline std::string_view option_of(std::string_view format, std::string_view option) {
  const auto at = format.rfind(option);
  if (at == std::string_view::npos) return {};
  const std::string_view value = format.substr(at + option.size());
  return value.substr(0, value.find(';'));
}

/// True unless the header names another maker of the camera or of the software that wrote the recording.
inline bool is_by_prophesee(const RawHeader& header) {
  std::string_view camera = header.field("camera_integrator_name"), plugin = header.field("plugin_integrator_name");
  if (camera.empty() && plugin.empty()) camera = plugin = header.field("integrator_name");
  return (camera.empty() && plugin.empty()) || (camera == "Prophesee" && plugin == "Prophesee");
}

/// Sets the order of the halves of an EVT2.1 word. Where the header does not state it, cameras before the one with
/// system_ID 55 swap them: the rule of OpenEB.
inline void set_word_order(RawHeader& header, std::string_view endianness) {
  if (endianness.empty()) endianness = header.field("endianness");
  header.word_order_stated = !endianness.empty();
  const std::string_view id = header.field("system_ID");
  const bool old_system = id.empty() || parse_positive(id).value_or(55) < 55;
  header.halves_swapped = header.word_order_stated ? endianness == "legacy" : is_by_prophesee(header) && old_system;
}

/// Sensor size by the format line, else by the geometry, else by the camera's system_ID.
inline std::optional<SensorSize> size_of(const RawHeader& header, const std::filesystem::path& path) {
  const std::string_view format = header.field("format"), geometry = header.field("geometry");
  const auto width = parse_positive(option_of(format, ";width=")),
             height = parse_positive(option_of(format, ";height="));
  if (width && height) return SensorSize{*width, *height};
  const auto system = find_system(header.field("system_ID"));
  if (geometry.empty()) return system ? std::optional(system->size) : std::nullopt;
  const auto size = parse_geometry(geometry, 'x');
  if (!size) throw RecordingError(path, "header: geometry is '" + std::string(geometry) + "', not like 1280x720", 0);
  return size;
}

}  // namespace detail

/// Parses the header at the beginning of `data`.
/// @param data at least the whole header, usually the first block of the file
/// @param path only named in errors
/// @throws RecordingError where this is no RAW recording or its encoding is not supported
inline RawHeader parse_raw_header(std::string_view data, const std::filesystem::path& path) {
  RawHeader header;
  static_cast<HeaderLines&>(header) = detail::read_header_lines(data, path);
  const std::string_view format = header.field("format");
  std::string_view name = format.substr(0, format.find(';'));
  if (name.empty()) name = header.field("evt");
  if (const auto system = detail::find_system(header.field("system_ID")); name.empty() && system)
    name = to_string(system->format);
  if (name.empty())
    throw RecordingError(path,
                         "not a Prophesee RAW recording: its header has no line '% format' or '% evt', nor a "
                         "'% system_ID' that tells the encoding",
                         0);
  const auto encoding = detail::format_of(name);
  if (!encoding)
    throw RecordingError(path, "RAW encoding '" + std::string(name) + "' is not supported (EVT2, EVT2.1 and EVT3 are)",
                         0);
  header.format = *encoding;
  if (header.format == RawFormat::evt21) detail::set_word_order(header, detail::option_of(format, ";endianness="));
  header.size = detail::size_of(header, path);
  return header;
}

/// Header of a recording, with the fields by which OpenEB selects the decoder.
inline std::string make_raw_header(RawFormat format, SensorSize size) {
  const std::string width = std::to_string(size.width), height = std::to_string(size.height);
  const bool evt21 = format == RawFormat::evt21;
  const std::string name = evt21 ? "EVT21" : to_string(format);
  const std::string version = format == RawFormat::evt2 ? "2.0" : evt21 ? "2.1" : "3.0";
  return "% camera_integrator_name Prophesee\n% evt " + version + "\n% format " + name + ";height=" + height +
         ";width=" + width + (evt21 ? ";endianness=little" : "") + "\n% geometry " + width + "x" + height +
         "\n% plugin_integrator_name Prophesee\n% plugin_name hal_plugin_prophesee\n% end\n";
}

}  // namespace evmarker::io
