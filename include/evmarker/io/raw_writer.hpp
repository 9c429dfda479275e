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
#include "evmarker/io/recording_writer.hpp"

namespace evmarker::io {

/// Writes a recording that decodes to the same events in the same order.
class RawWriter final : public RecordingWriter {
 public:
  /// @param size at most 2048 x 2048 px
  /// @throws std::invalid_argument for a size or format that cannot be written
  /// @throws RecordingError where the file cannot be created
  RawWriter(std::filesystem::path path, SensorSize size, RawFormat format = RawFormat::evt3)
      : size_(checked(size, format)), output_(std::move(path)) {
    if (format == RawFormat::evt3) encoder_ = Evt3Encoder(size.width);
    const std::string header = make_raw_header(format, size);
    const auto bytes = std::as_bytes(std::span(header));
    output_.buffer().assign(bytes.begin(), bytes.end());
  }

  /// @throws std::invalid_argument naming an event that is off the sensor or before time 0, in which case none is
  /// written, or one that is further back in time than the format can express
  /// @throws RecordingError where the disk is full
  void write(std::span<const Event> events) override {
    require_writable(events, size_, events_written_);
    while (!events.empty()) {
      const auto piece = events.first(std::min(events.size(), kPieceEvents));
      std::visit([&](auto& encoder) { encoder.encode(piece, output_.buffer()); }, encoder_);
      events_written_ += piece.size();
      events = events.subspan(piece.size());
      output_.flush_if_large();
    }
  }
  void write(const Event& event) { write(std::span(&event, 1)); }

  /// Writes a trigger event between the events written before and after this call.
  /// @throws std::invalid_argument where the format cannot express its id or time
  /// @throws RecordingError where the disk is full
  void write_trigger(const TriggerEvent& trigger) override {
    std::visit([&](auto& encoder) { encoder.encode(trigger, output_.buffer()); }, encoder_);
    output_.flush_if_large();
  }

  void close() override { output_.close(); }

  std::size_t count_writable(std::span<const Event> events) const override {
    return std::visit([&](const auto& encoder) { return encoder.count_expressible(events); }, encoder_);
  }
  bool can_write(const TriggerEvent& trigger) const override {
    return std::visit([&](const auto& encoder) { return encoder.can_express(trigger); }, encoder_);
  }
  SensorSize sensor_size() const noexcept override { return size_; }
  std::uint64_t events_written() const noexcept override { return events_written_; }

 private:
  static constexpr std::size_t kPieceEvents = std::size_t{1} << 16;  // bounds the buffer, however many are written

  static SensorSize checked(SensorSize size, RawFormat format) {
    require_sensor_size(size, 2048);
    if (format == RawFormat::evt21) throw std::invalid_argument("RAW format EVT2.1 can be read, not written");
    return size;
  }

  SensorSize size_;
  BufferedOutput<std::vector<std::byte>> output_;
  std::variant<Evt2Encoder, Evt3Encoder> encoder_;
  std::uint64_t events_written_ = 0;
};

}  // namespace evmarker::io
