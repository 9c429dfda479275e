#pragma once
// Prophesee RAW recordings (EVT2, EVT2.1, EVT3) as a source of events.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/raw_header.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

struct RawReaderOptions {
  /// For recordings whose header has no sensor size; the size in a header has precedence.
  std::optional<SensorSize> sensor_size = std::nullopt;
  /// True to subtract the time of the first event or trigger from all, which is OpenEB's default.
  bool shift_first_time_to_zero = false;
};

/// Reads a recording of any length in constant memory; an `EventSource`. A recording that was cut off yields all events
/// before the cut; `statistics().truncated_bytes` is not 0 where the cut is within a word.
class RawReader {
 public:
  using event_type = Event;

  /// @throws RecordingError where the file is missing, empty, not a RAW recording or of an encoding that is not
  /// supported
  explicit RawReader(std::filesystem::path path, RawReaderOptions options = {})
      : RawReader(BlockReader(std::move(path)), options) {}

  /// The same of a file that is open; of its blocks, none but the first may have been read.
  explicit RawReader(BlockReader blocks, RawReaderOptions options = {})
      : blocks_(std::move(blocks)), options_(options), decoder_(Evt3Decoder({})) {
    rest_ = blocks_.next();
    if (rest_.empty()) throw RecordingError(blocks_.path(), "the file is empty");
    header_ = parse_raw_header({reinterpret_cast<const char*>(rest_.data()), rest_.size()}, blocks_.path());
    if (!header_.size) header_.size = options_.sensor_size;
    if (!header_.size)
      throw RecordingError(blocks_.path(), "its header has no sensor size: give it in the options (sensor_size)", 0);
    require_addressable(*header_.size);
    skip(header_.bytes);
    if (header_.format == RawFormat::evt21 && !header_.word_order_stated)
      header_.halves_swapped = are_halves_swapped(rest_, header_.halves_swapped);
    if (header_.format == RawFormat::evt2) decoder_ = Evt2Decoder(*header_.size);
    if (header_.format == RawFormat::evt21) decoder_ = Evt21Decoder(*header_.size, header_.halves_swapped);
    if (header_.format == RawFormat::evt3) decoder_ = Evt3Decoder(*header_.size);
    word_bytes_ = std::visit([](const auto& d) { return d.kWordBytes; }, decoder_);
    events_per_word_ = std::visit([](const auto& d) { return d.kMaxEventsPerWord; }, decoder_);
  }

  const RawHeader& header() const noexcept { return header_; }
  SensorSize sensor_size() const noexcept { return *header_.size; }

  /// The next events in the order of the file, valid until the next call; none at the end.
  /// @throws RecordingError where reading fails, or where so many triggers come without an event that they are no
  /// recording's
  std::span<const Event> next_batch() {
    triggers_.clear();
    std::size_t count = 0;
    while (count == 0 && fill()) {
      const auto chunk = rest_.first(std::min(kChunkBytes, rest_.size() / word_bytes_ * word_bytes_));
      const auto following = rest_.subspan(chunk.size());
      buffer_.resize(std::max(buffer_.size(), chunk.size() / word_bytes_ * events_per_word_));
      count = std::visit([&](auto& d) { return d.decode(chunk, std::span(buffer_), triggers_, following); }, decoder_);
      skip(chunk.size());
      if (count == 0 && triggers_.size() > kMaxTriggers)  // a batch without events would be the end
        throw RecordingError(blocks_.path(),
                             "garbled: " + std::to_string(triggers_.size()) + " triggers without an event among them",
                             bytes_read_);
    }
    const std::span batch = std::span(buffer_).first(count);
    if (options_.shift_first_time_to_zero) shift_time(batch);
    return batch;
  }

  /// Trigger events among the events of the last batch, or behind the last event of the file.
  std::span<const TriggerEvent> triggers() const noexcept { return triggers_; }

  RecordingStatistics statistics() const {
    auto statistics = std::visit([](const auto& d) { return d.statistics(); }, decoder_);
    statistics.truncated_bytes = truncated_bytes_;
    return statistics;
  }

  std::uint64_t bytes_read() const noexcept { return bytes_read_; }
  /// Size of the file; 0 where it has none, like a pipe.
  std::uint64_t bytes_total() const noexcept { return blocks_.bytes_total(); }

 private:
  static constexpr std::size_t kChunkBytes = std::size_t{1} << 14;   // its events stay in the cache
  static constexpr std::size_t kMaxTriggers = std::size_t{1} << 20;  // in a batch: 16 MB, minutes of 1 kHz

  void require_addressable(SensorSize size) const {
    const auto fits = [](int side) { return side >= 1 && side <= 2048; };
    if (!fits(size.width) || !fits(size.height))
      throw RecordingError(blocks_.path(), "sensor size is " + std::to_string(size.width) + " x " +
                                               std::to_string(size.height) + " px, RAW words address 1..2048 a side");
  }

  // Reads on until a whole word is in memory; false at the end of the file.
  bool fill() {
    if (rest_.size() < word_bytes_ && !blocks_.at_end()) {
      rest_ = blocks_.next(rest_.size());
      if (rest_.size() < word_bytes_ && !blocks_.at_end()) return fill();
    }
    if (rest_.size() >= word_bytes_) return true;
    truncated_bytes_ += rest_.size();
    skip(rest_.size());
    return false;
  }

  void skip(std::size_t bytes) noexcept {
    rest_ = rest_.subspan(bytes);
    bytes_read_ += bytes;
  }

  void shift_time(std::span<Event> batch) {
    if (!first_time_) {
      if (!batch.empty()) first_time_ = batch.front().t;
      if (!triggers_.empty()) first_time_ = std::min(first_time_.value_or(triggers_.front().t), triggers_.front().t);
    }
    for (Event& event : batch) event.t -= *first_time_;
    for (TriggerEvent& trigger : triggers_) trigger.t -= *first_time_;
  }

  BlockReader blocks_;
  RawReaderOptions options_;
  RawHeader header_;
  std::variant<Evt2Decoder, Evt21Decoder, Evt3Decoder> decoder_;
  std::size_t word_bytes_ = 2, events_per_word_ = 12;
  std::span<const std::byte> rest_;
  std::vector<Event> buffer_;
  std::vector<TriggerEvent> triggers_;
  std::optional<Timestamp> first_time_;
  std::uint64_t bytes_read_ = 0, truncated_bytes_ = 0;
};

}  // namespace evmarker::io
