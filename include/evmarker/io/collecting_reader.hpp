#pragma once
// A reader that gathers its batches piece by piece.
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/event_collector.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"

namespace evmarker::io {

/// Base of the readers that decode records one by one: a derived class reads pieces into `collector_`.
class CollectingReader : public RecordingReader {
 public:
  SensorSize sensor_size() const final { return collector_.sensor_size(); }

  std::span<const Event> next_batch() final {
    collector_.start_batch();
    if (failure_) throw *failure_;
    try {
      while (collector_.events().empty() && read_piece())
        ;
    } catch (const RecordingError& error) {
      failure_ = error;
      if (collector_.events().empty()) throw;
    }
    return collector_.events();
  }

  std::span<const TriggerEvent> triggers() const final { return collector_.triggers(); }
  RecordingStatistics statistics() const final { return collector_.statistics; }

 protected:
  static constexpr std::size_t kPieceEvents = 8192;  // which stay in the cache

  CollectingReader(std::filesystem::path path, const RecordingOptions& options)
      : collector_(std::move(path), options.shift_first_time_to_zero) {}

  EventCollector collector_;

 private:
  /// Adds a bounded number of events and triggers to the collector; false at the end of the recording.
  virtual bool read_piece() = 0;

  std::optional<RecordingError> failure_;
};

}  // namespace evmarker::io
