#pragma once
// What AEDAT 4 recordings have in front of their packets: compression, length, streams.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/compression.hpp"
#include "evmarker/io/flatbuffer.hpp"
#include "evmarker/io/header_lines.hpp"

namespace evmarker::io {

struct Aedat4Stream {
  int id = 0;
  std::string type;  ///< `EVTS` for events
  std::optional<SensorSize> size;
};

struct Aedat4Header {
  Compression compression = Compression::none;
  std::int64_t end_of_packets = -1;  ///< position in the file [bytes]; -1 where it is unknown
  std::vector<Aedat4Stream> streams;
};

namespace detail {

/// The streams in the header's XML: the nodes in `outInfo`, with a `typeIdentifier`, and `sizeX` and `sizeY` in `info`.
inline std::vector<Aedat4Stream> read_streams(std::string_view xml) {
  const auto attribute = [](std::string_view tag, std::string_view name) {
    const auto begin = tag.find(" " + std::string(name) + "=\"");
    if (begin == tag.npos) return std::string_view();
    tag.remove_prefix(begin + name.size() + 3);
    return tag.substr(0, tag.find('"'));
  };
  std::vector<std::string_view> nodes;
  std::vector<Aedat4Stream> streams;
  int width = 0;
  for (auto open = xml.find('<'); open != xml.npos; open = xml.find('<')) {
    xml.remove_prefix(open + 1);
    const auto close = xml.find('>');
    if (close == xml.npos) break;
    const std::string_view tag = xml.substr(0, close), value = xml.substr(close + 1, xml.find('<', close) - close - 1);
    if (tag.starts_with("node ") && !tag.ends_with('/')) {
      nodes.push_back(attribute(tag, "name"));
      width = 0;
      if (nodes.size() == 2 && nodes[0] == "outInfo")
        streams.push_back({nodes[1] == "0" ? 0 : parse_positive(nodes[1]).value_or(-1), "", std::nullopt});
    } else if (tag == "/node" && !nodes.empty()) {
      nodes.pop_back();
    } else if (tag.starts_with("attr ") && !streams.empty()) {
      const std::string_view key = attribute(tag, "key");
      if (nodes.size() == 2 && key == "typeIdentifier") streams.back().type = value;
      if (nodes.size() != 3 || nodes[2] != "info") continue;
      if (key == "sizeX") width = parse_positive(value).value_or(0);
      const auto height = key == "sizeY" ? parse_positive(value) : std::nullopt;
      if (width > 0 && height) streams.back().size = SensorSize{width, *height};
    }
  }
  return streams;
}

}  // namespace detail

/// Decodes the flatbuffer behind the first line and its size.
/// @throws std::runtime_error, std::out_of_range where it is garbled
inline Aedat4Header parse_aedat4_header(std::span<const std::byte> flatbuffer) {
  const FlatTable table(flatbuffer);
  Aedat4Header header;
  const int compression = table.number<std::int32_t>(0, 0);
  if (compression < 0 || compression > 4)
    throw std::runtime_error("compression is " + std::to_string(compression) +
                             ", which is not supported (0, none, 1 and 2, LZ4, and 3 and 4, ZSTD, are)");
  header.compression = compression == 0 ? Compression::none : compression <= 2 ? Compression::lz4 : Compression::zstd;
  header.end_of_packets = table.number<std::int64_t>(1, -1);
  header.streams = detail::read_streams(table.text(2));
  return header;
}

}  // namespace evmarker::io
