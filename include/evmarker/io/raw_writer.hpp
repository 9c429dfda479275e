#pragma once
// Writes events as a Prophesee RAW recording.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/event_checks.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/output_file.hpp"
#include "evmarker/io/raw_header.hpp"

namespace evmarker::io {

/// Writes a recording that decodes to the same events in the same order. The file appears under its name in `close()`;
/// a writer that is destroyed before leaves nothing.
class RawWriter {
 public:
  /// @param size at most 2048 x 2048 px
  /// @throws std::invalid_argument for a size or format that cannot be written, RecordingError where the file cannot
  RawWriter(std::filesystem::path path, SensorSize size, RawFormat format = RawFormat::evt3)
      : size_(checked(size, format)), file_(std::move(path)) {
    if (format == RawFormat::evt3) encoder_ = Evt3Encoder(size.width);
    file_.write(make_raw_header(format, size));
  }

  /// @throws std::invalid_argument naming the event that is off the sensor, before time 0 or further back in time than
  /// the format can express; none of `events` is written for the first two. RecordingError where the disk is full
  void write(std::span<const Event> events) {
    require_writable(events, size_, events_written_);
    while (!events.empty()) {
      const auto piece = events.first(std::min(events.size(), kPieceEvents));
      std::visit([&](auto& encoder) { encoder.encode(piece, bytes_); }, encoder_);
      events_written_ += piece.size();
      events = events.subspan(piece.size());
      if (bytes_.size() >= kFlushBytes) flush();
    }
  }
  void write(const Event& event) { write(std::span(&event, 1)); }

  /// A trigger event stands between the events written before and after it.
  void write_trigger(const TriggerEvent& trigger) {
    std::visit([&](auto& encoder) { encoder.encode(trigger, bytes_); }, encoder_);
    if (bytes_.size() >= kFlushBytes) flush();
  }

  /// Completes the file. Calling it again does nothing. @throws RecordingError where the disk is full
  void close() {
    if (!file_.is_open()) return;
    flush();
    file_.close();
  }

  SensorSize sensor_size() const noexcept { return size_; }
  std::uint64_t events_written() const noexcept { return events_written_; }

 private:
  static constexpr std::size_t kFlushBytes = std::size_t{1} << 18;
  static constexpr std::size_t kPieceEvents = std::size_t{1} << 16;

  static SensorSize checked(SensorSize size, RawFormat format) {
    require_sensor_size(size, 2048);
    if (format == RawFormat::evt21) throw std::invalid_argument("RAW format EVT2.1 can be read, not written");
    return size;
  }

  void flush() {
    file_.write(bytes_);
    bytes_.clear();
  }

  SensorSize size_;
  OutputFile file_;
  std::variant<Evt2Encoder, Evt3Encoder> encoder_;
  std::vector<std::byte> bytes_;
  std::uint64_t events_written_ = 0;
};

}  // namespace evmarker::io
