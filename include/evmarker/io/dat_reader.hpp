#pragma once
// Prophesee DAT recordings, versions 1 and 2, as a source of events.
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/header_lines.hpp"
#include "evmarker/io/packed_events.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/streaming_reader.hpp"
#include "evmarker/io/wrapping_clock.hpp"

namespace evmarker::io {

/// Reads DAT recordings of events or of triggers: header lines, the type and the size of a record, and records of a
/// 32-bit time [us], which wraps after 71.6 minutes, and 32 bits of data. A header without version is one of version 1.
class DatReader final : public StreamingReader {
 public:
  /// @throws RecordingError where the file cannot be read, or version, type or size of its records is unknown
  explicit DatReader(std::filesystem::path path, const RecordingOptions& options = {})
      : DatReader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit DatReader(BlockReader blocks, const RecordingOptions& options = {})
      : StreamingReader(std::move(blocks), options) {
    if (bytes_.peek().empty()) throw RecordingError(bytes_.path(), "the file is empty");
    const HeaderLines header = detail::read_header_lines(bytes_.peek_text(), bytes_.path());
    if (header.fields.empty())
      throw RecordingError(bytes_.path(), "not a DAT recording: it does not begin with header lines '% '", 0);
    const auto version = header.field("Version");
    if (!version.empty() && version != "1" && version != "2")
      throw RecordingError(bytes_.path(), "DAT version '" + std::string(version) + "' is not supported (1 and 2 are)");
    has_wide_columns_ = version == "2";
    bytes_.skip(header.bytes);
    read_record_type();
    collector_.set_sensor_size(
        choose_sensor_size(size_of(header), options, has_wide_columns_ ? 1 << 14 : 1 << 9, "DAT", bytes_.path()));
  }

 private:
  static constexpr std::size_t kRecordBytes = 8;

  static std::optional<SensorSize> size_of(const HeaderLines& header) {
    const auto width = detail::parse_positive(header.field("Width")),
               height = detail::parse_positive(header.field("Height"));
    if (width && height) return SensorSize{*width, *height};
    return detail::parse_geometry(header.field("geometry"), 'x');
  }

  void read_record_type() {
    const auto bytes = bytes_.peek(2);
    if (bytes.size() < 2) throw RecordingError(bytes_.path(), "cut off behind its header", bytes_.position());
    const int type = static_cast<int>(bytes[0]), size = static_cast<int>(bytes[1]);
    if (type != kEvents && type != kContrastEvents && type != kTriggers)
      throw RecordingError(bytes_.path(),
                           "DAT records of type " + std::to_string(type) +
                               " are not supported (0 and 12, events, and 14, triggers, are)",
                           bytes_.position());
    if (size != kRecordBytes)
      throw RecordingError(bytes_.path(), "size of a DAT record is " + std::to_string(size) + " bytes, must be 8",
                           bytes_.position() + 1);
    has_triggers_ = type == kTriggers;
    bytes_.skip(2);
  }

  bool read_piece() override {
    const auto records = peek_records(kRecordBytes);
    if (records.empty()) return end_of_file();
    const std::size_t count = records.size() / kRecordBytes;
    WrappingClock clock = clock_;  // a copy, which nothing else can refer to, stays in registers
    const auto time = [&](std::size_t i) { return clock.unwrap(load_word<std::uint32_t>(&records[kRecordBytes * i])); };
    const auto data = [&](std::size_t i) { return load_word<std::uint32_t>(&records[kRecordBytes * i + 4]); };
    if (has_triggers_)
      for (std::size_t i = 0; i < count; ++i)
        collector_.add(TriggerEvent{static_cast<int>(data(i) >> 26U), (data(i) & 1U) != 0, time(i)});
    else if (has_wide_columns_)
      collector_.add_each(count, [&](std::size_t i) {
        return packed_event(data(i) & 0x3FFFU, data(i) >> 14U & 0x3FFFU, data(i) >> 28U == 1, time(i));
      });
    else
      collector_.add_each(count, [&](std::size_t i) {
        return packed_event(data(i) & 0x1FFU, data(i) >> 9U & 0xFFU, data(i) >> 17U & 1U, time(i));
      });
    clock_ = clock;
    bytes_.skip(records.size());
    return true;
  }

  static constexpr int kEvents = 0, kContrastEvents = 12, kTriggers = 14;

  bool has_wide_columns_ = true;  // version 2: 14 bits for each coordinate
  bool has_triggers_ = false;
  WrappingClock clock_{false};
};

}  // namespace evmarker::io
