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
#include "evmarker/io/byte_stream.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/raw_header.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io {

/// Reads Prophesee RAW recordings in EVT2, EVT2.1 and EVT3.
class RawReader final : public RecordingReader {
 public:
  /// @throws RecordingError where the file is missing, empty, not a RAW recording or of an encoding that is not
  /// supported
  explicit RawReader(std::filesystem::path path, RecordingOptions options = {})
      : RawReader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit RawReader(BlockReader blocks, RecordingOptions options = {})
      : bytes_(std::move(blocks)), options_(options), decoder_(Evt3Decoder({})) {
    if (bytes_.peek().empty()) throw RecordingError(bytes_.path(), "the file is empty");
    header_ = parse_raw_header(bytes_.peek_text(), bytes_.path());
    header_.size = choose_sensor_size(header_.size, options_, 2048, "RAW", bytes_.path());
    bytes_.skip(header_.bytes);
    if (header_.format == RawFormat::evt21 && !header_.word_order_stated)
      header_.halves_swapped = are_halves_swapped(bytes_.peek(), header_.halves_swapped);
    if (header_.format == RawFormat::evt2) decoder_ = Evt2Decoder(*header_.size);
    if (header_.format == RawFormat::evt21) decoder_ = Evt21Decoder(*header_.size, header_.halves_swapped);
    if (header_.format == RawFormat::evt3) decoder_ = Evt3Decoder(*header_.size);
    word_bytes_ = std::visit([](const auto& d) { return d.kWordBytes; }, decoder_);
    events_per_word_ = std::visit([](const auto& d) { return d.kMaxEventsPerWord; }, decoder_);
  }

  const RawHeader& header() const noexcept { return header_; }
  SensorSize sensor_size() const override { return *header_.size; }

  /// @throws RecordingError where reading fails, or where so many triggers come without an event that they are no
  /// recording's
  std::span<const Event> next_batch() override {
    triggers_.clear();
    std::size_t count = 0;
    while (count == 0) {
      const auto ahead = bytes_.peek(word_bytes_);
      if (ahead.size() < word_bytes_) {
        truncated_bytes_ += bytes_.skip_rest();
        break;
      }
      const auto chunk = ahead.first(std::min(kChunkBytes, ahead.size() / word_bytes_ * word_bytes_));
      const auto following = ahead.subspan(chunk.size());
      buffer_.resize(std::max(buffer_.size(), chunk.size() / word_bytes_ * events_per_word_));
      count = std::visit([&](auto& d) { return d.decode(chunk, std::span(buffer_), triggers_, following); }, decoder_);
      bytes_.skip(chunk.size());
      if (count == 0 && triggers_.size() > kMaxTriggers)  // a batch without events would be the end
        throw RecordingError(bytes_.path(),
                             "garbled: " + std::to_string(triggers_.size()) + " triggers without an event among them",
                             bytes_.position());
    }
    const std::span batch = std::span(buffer_).first(count);
    if (options_.shift_first_time_to_zero) shift_time(batch);
    return batch;
  }

  std::span<const TriggerEvent> triggers() const override { return triggers_; }

  RecordingStatistics statistics() const override {
    auto statistics = std::visit([](const auto& d) { return d.statistics(); }, decoder_);
    statistics.truncated_bytes = truncated_bytes_;
    return statistics;
  }

  std::uint64_t bytes_read() const override { return bytes_.position(); }
  std::uint64_t bytes_total() const override { return bytes_.bytes_total(); }

 private:
  static constexpr std::size_t kChunkBytes = std::size_t{1} << 14;   // its events stay in the cache
  static constexpr std::size_t kMaxTriggers = std::size_t{1} << 20;  // in a batch: 16 MB, minutes of 1 kHz

  void shift_time(std::span<Event> batch) {
    if (!first_time_) {
      if (!batch.empty()) first_time_ = batch.front().t;
      if (!triggers_.empty()) first_time_ = std::min(first_time_.value_or(triggers_.front().t), triggers_.front().t);
    }
    for (Event& event : batch) event.t -= *first_time_;
    for (TriggerEvent& trigger : triggers_) trigger.t -= *first_time_;
  }

  ByteStream bytes_;
  RecordingOptions options_;
  RawHeader header_;
  std::variant<Evt2Decoder, Evt21Decoder, Evt3Decoder> decoder_;
  std::size_t word_bytes_ = 2, events_per_word_ = 12;
  std::vector<Event> buffer_;
  std::vector<TriggerEvent> triggers_;
  std::optional<Timestamp> first_time_;
  std::uint64_t truncated_bytes_ = 0;
};

}  // namespace evmarker::io
