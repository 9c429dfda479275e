#pragma once
// What AEDAT 2 and 3 recordings have in front of their data: lines of text, and the name of the chip.
#include <algorithm>
#include <array>
#include <cctype>
#include <optional>
#include <string>
#include <string_view>

#include "evmarker/events/event.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/byte_stream.hpp"
#include "evmarker/io/header_lines.hpp"

namespace evmarker::io::detail {

/// Reads the lines that begin with `#`, however long they are together, and passes over them.
/// @throws RecordingError where the file ends within a line
inline HeaderLines read_aedat_header(ByteStream& bytes) {
  HeaderLines header;
  while (const auto line =
             find_header_line(bytes.peek_text(BlockReader::kMaxKeep), "#", bytes.path(), bytes.position())) {
    add_header_line(header, *line, "#");
    bytes.skip(line->size());
    const auto& [key, value] = header.fields.back();
    if (key == "!END-HEADER" || (key == "End" && value == "Of ASCII Header")) break;
  }
  return header;
}

/// A chip with its address layout.
struct AedatChip {
  bool is_davis = false;  ///< or a DVS128
  std::optional<SensorSize> size;
};

/// The chip of a name, which may be that of a class of jAER, or of a source of cAER; nothing where it is neither a
/// DVS128 nor a DAVIS.
inline std::optional<AedatChip> find_chip(std::string_view name) {
  std::string lower(name);
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto holds = [&](const char* part) { return lower.find(part) != std::string::npos; };
  if (holds("dvs128") || holds("tmpdiff128")) return AedatChip{false, SensorSize{128, 128}};
  if (!holds("davis")) return std::nullopt;
  struct Model {
    const char* number;
    SensorSize size;
  };
  constexpr std::array<Model, 5> models{
      {{"128", {128, 128}}, {"208", {208, 192}}, {"240", {240, 180}}, {"346", {346, 260}}, {"640", {640, 480}}}};
  for (const auto& [number, size] : models)
    if (holds(number)) return AedatChip{true, size};
  return AedatChip{true, std::nullopt};
}

}  // namespace evmarker::io::detail
