#pragma once
// Text recordings with one event in each line, as a source of events.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/decimal.hpp"
#include "evmarker/io/line_reader.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/recording_statistics.hpp"
#include "evmarker/io/text_fields.hpp"
#include "evmarker/io/text_layout.hpp"
#include "evmarker/io/time_shift.hpp"

namespace evmarker::io {

struct CsvReaderOptions {
  /// For files without sensor size; the size in a file has precedence.
  std::optional<SensorSize> sensor_size = std::nullopt;
  /// True to subtract the time of the first event from all.
  bool shift_first_time_to_zero = false;
  TextLayout layout = {};
};

/// Reads text recordings of any length in constant memory; an `EventSource`. These are Metavision CSV (`x,y,p,t`, t in
/// microseconds, optionally `%geometry:W,H` before), RPG text (`t x y p`, t in seconds) and similar ones: order of
/// columns and unit of time are by names in a first line, else by what the first events can be. Polarities are 0 and 1,
/// -1 and 1, or True and False.
class CsvReader final : public RecordingReader {
 public:
  /// @throws RecordingError where the file is missing or empty, or its columns, unit of time or sensor size cannot be
  /// found
  /// @throws std::invalid_argument where the columns or the sensor size of the options are unusable
  explicit CsvReader(std::filesystem::path path, const CsvReaderOptions& options = {})
      : CsvReader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit CsvReader(BlockReader blocks, const CsvReaderOptions& options = {})
      : lines_(std::move(blocks)), shift_(options.shift_first_time_to_zero) {
    if (lines_.lookahead().empty()) throw RecordingError(lines_.path(), "the file is empty");
    text_ = recognize_text(lines_.lookahead(), options.layout, options.sensor_size);
    require_columns(options.layout);
    if (!text_.fault.empty()) throw RecordingError(lines_.path(), text_.fault);
    if (!text_.size) text_.size = options.sensor_size;
    if (!text_.size)
      throw RecordingError(lines_.path(),
                           "no sensor size: give it, --size 640,480 (in the options: sensor_size) or, for x,y,p,t in "
                           "us, in a first line "
                           "'%geometry:WIDTH,HEIGHT'");
    if (text_.size->width < 1 || text_.size->height < 1 || text_.size->width > SensorSize::kMaxSide ||
        text_.size->height > SensorSize::kMaxSide)
      throw std::invalid_argument("sensor_size is " + std::to_string(text_.size->width) + " x " +
                                  std::to_string(text_.size->height) + ", must be in 1.." +
                                  std::to_string(SensorSize::kMaxSide) + " a side");
    for (std::size_t i = 0; i < text_.leading_lines; ++i) lines_.next();
    batch_.reserve(kBatchEvents);
  }

  SensorSize sensor_size() const override { return *text_.size; }
  const RecognizedText& layout() const noexcept { return text_; }

  /// @throws RecordingError naming line and value of a malformed line, once all events before it are delivered
  std::span<const Event> next_batch() override {
    batch_.clear();
    if (failure_) throw *failure_;
    while (batch_.size() < kBatchEvents) {
      const auto line = lines_.next();
      if (!line) break;
      try {
        read(*line);
      } catch (const RecordingError& error) {
        if (!lines_.line_ended()) {  // the recording was cut off within this line
          statistics_.truncated_bytes += line->size();
          break;
        }
        failure_ = error;
        if (batch_.empty()) throw;
        break;
      }
    }
    statistics_.events += batch_.size();
    return batch_;
  }

  /// None: text recordings have no triggers.
  std::span<const TriggerEvent> triggers() const override { return {}; }
  RecordingStatistics statistics() const override { return statistics_; }
  std::uint64_t bytes_read() const override { return lines_.bytes_read(); }
  std::uint64_t bytes_total() const override { return lines_.bytes_total(); }

 private:
  static constexpr std::size_t kBatchEvents = 8192;

  struct Fields {
    std::int64_t x = 0, y = 0, p = 0;
    Timestamp t = 0;
  };

  void require_columns(const TextLayout& requested) const {
    if (requested.columns.empty()) return;
    const bool letters = text_.columns.find_first_not_of("xypt-") == std::string::npos;
    if (!letters || !NamedColumns{text_.columns}.complete())
      throw std::invalid_argument("columns is '" + requested.columns +
                                  "', must hold x, y, p and t once each, and - for any other column");
  }

  void read(std::string_view line) {
    const auto first = line.find_first_not_of(" \t");
    if (first == std::string_view::npos || line[first] == '#' || line[first] == '%') return;
    const Fields fields = parse(line);
    if (fields.x < 0 || fields.x >= text_.size->width || fields.y < 0 || fields.y >= text_.size->height) {
      ++statistics_.off_sensor;
      return;
    }
    if (has_last_ && fields.t < last_) ++statistics_.time_steps_back;
    has_last_ = true;
    last_ = fields.t;
    batch_.push_back({static_cast<std::uint16_t>(fields.x), static_cast<std::uint16_t>(fields.y),
                      static_cast<std::int16_t>(fields.p > 0 ? 1 : 0), shifted(fields.t)});
  }

  Timestamp shifted(Timestamp t) {
    const auto since_first = shift_(t);
    if (!since_first) throw lines_.error(shift_.fault(t));
    return *since_first;
  }

  Fields parse(std::string_view line) const {
    Fields fields;
    for (const char column : text_.columns) {
      const std::string_view field = consume_field(line);
      switch (column) {
        case 'x': fields.x = parse_coordinate(field, "x"); break;
        case 'y': fields.y = parse_coordinate(field, "y"); break;
        case 'p': fields.p = parse_polarity(field); break;
        case 't': fields.t = parse_time(field); break;
        default: break;
      }
    }
    if (!detail::trimmed(line).empty())
      throw lines_.error("more than the " + std::to_string(text_.columns.size()) + " columns '" + text_.columns +
                         "': '" + shortened(detail::trimmed(line)) + "'");
    return fields;
  }

  // Removes the first field from the line.
  std::string_view consume_field(std::string_view& line) const {
    const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
    const bool blank = is_blank(text_.separator);
    const auto ends = [&](char c) { return blank ? is_blank(c) : c == text_.separator; };
    const char* begin = line.data();
    const char* const stop = begin + line.size();
    while (begin != stop && is_blank(*begin)) ++begin;
    const char* end = begin;
    while (end != stop && !ends(*end)) ++end;
    const char* const next = end == stop ? stop : end + 1;
    while (end != begin && is_blank(end[-1])) --end;
    line = {next, static_cast<std::size_t>(stop - next)};
    return {begin, static_cast<std::size_t>(end - begin)};
  }

  static std::optional<std::int64_t> parse_integer(std::string_view field) {
    const auto value = detail::parse_as<std::int64_t>(field);
    return value ? value : parse_whole(field);
  }

  std::int64_t parse_coordinate(std::string_view field, const char* name) const {
    const auto value = parse_integer(field);
    if (!value || *value >= SensorSize::kMaxSide) throw malformed(name, field);
    return *value;
  }

  std::int64_t parse_polarity(std::string_view field) const {
    const auto value = parse_integer(field);
    if (value && *value >= -1 && *value <= 1) return *value;
    if (const auto truth = detail::parse_truth(field)) return *truth;
    throw malformed("p", field);
  }

  Timestamp parse_time(std::string_view field) const {
    if (text_.time_unit == TimeUnit::microseconds)
      if (const auto whole = parse_integer(field)) return *whole;
    const auto exact = parse_decimal(field, places_to_microseconds(text_.time_unit));
    if (!exact) throw malformed("t", field);
    return *exact;
  }

  static std::string shortened(std::string_view text) {
    return std::string(text.substr(0, 40)) + (text.size() > 40 ? "..." : "");
  }

  RecordingError malformed(const char* name, std::string_view value) const {
    if (value.empty()) return lines_.error(std::string("no ") + name + " (columns '" + text_.columns + "')");
    return lines_.error(std::string(name) + " is '" + shortened(value) + "'");
  }

  LineReader lines_;
  TimeShift shift_;
  RecognizedText text_;
  std::vector<Event> batch_;
  std::optional<RecordingError> failure_;
  RecordingStatistics statistics_;
  bool has_last_ = false;
  Timestamp last_ = 0;
};

}  // namespace evmarker::io
