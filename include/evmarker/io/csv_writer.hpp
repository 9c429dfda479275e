#pragma once
// Writes events as Metavision CSV.
#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/io/event_checks.hpp"
#include "evmarker/io/output_file.hpp"
#include "evmarker/io/recording_writer.hpp"

namespace evmarker::io {

/// Writes `%geometry:W,H` and for each event a line `x,y,p,t`, with p 0 or 1 and t in microseconds; no
/// triggers.
class CsvWriter final : public RecordingWriter {
 public:
  /// @throws std::invalid_argument for a sensor without pixels, RecordingError where the file cannot be created
  CsvWriter(std::filesystem::path path, SensorSize size) : size_(checked(size)), output_(std::move(path)) {
    output_.buffer() = "%geometry:" + std::to_string(size.width) + "," + std::to_string(size.height) + "\n";
  }

  /// @throws std::invalid_argument naming an event that is off the sensor or before time 0; then none is written
  /// @throws RecordingError where the disk is full
  void write(std::span<const Event> events) override {
    require_writable(events, size_, events_written_);
    for (const Event& event : events) {
      append(event.x, ',');
      append(event.y, ',');
      append(event.p > 0 ? 1 : 0, ',');
      append(event.t, '\n');
      output_.flush_if_large();
    }
    events_written_ += events.size();
  }
  void write(const Event& event) { write(std::span(&event, 1)); }

  void close() override { output_.close(); }

  std::size_t count_writable(std::span<const Event> events) const override {
    const auto negative = std::ranges::find_if(events, [](const Event& event) { return event.t < 0; });
    return static_cast<std::size_t>(negative - events.begin());
  }
  SensorSize sensor_size() const noexcept override { return size_; }
  std::uint64_t events_written() const noexcept override { return events_written_; }

 private:
  static SensorSize checked(SensorSize size) {
    require_sensor_size(size, SensorSize::kMaxSide);
    return size;
  }

  void append(std::int64_t value, char end) {
    char digits[24];
    output_.buffer().append(digits, std::to_chars(digits, digits + sizeof(digits), value).ptr);
    output_.buffer() += end;
  }

  SensorSize size_;
  BufferedOutput<std::string> output_;
  std::uint64_t events_written_ = 0;
};

}  // namespace evmarker::io
