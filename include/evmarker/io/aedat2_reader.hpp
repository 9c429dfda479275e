#pragma once
// AEDAT 2 recordings, as jAER writes them, as a source of events.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/aedat_header.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/header_lines.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/streaming_reader.hpp"
#include "evmarker/io/wrapping_clock.hpp"

namespace evmarker::io {

/// Reads AEDAT 2 recordings of a DVS128 or a DAVIS: header lines, and big-endian records of a 32-bit address and a
/// signed 32-bit time [us]. Frames and inertial measurements among them are passed over. Edges at the chip's input are
/// triggers of id 0; a DVS128 records falling ones alone.
///
/// Where the header does not name the chip, it is a DVS128 if most addresses fit into 16 bits, as all of its do.
class Aedat2Reader final : public StreamingReader {
 public:
  /// @throws RecordingError where the file cannot be read, or its chip is unknown
  explicit Aedat2Reader(std::filesystem::path path, const RecordingOptions& options = {})
      : Aedat2Reader(BlockReader(std::move(path)), options) {}

  /// Reads a file that is already open, of which at most the first block has been read.
  explicit Aedat2Reader(BlockReader blocks, const RecordingOptions& options = {})
      : StreamingReader(std::move(blocks), options) {
    const HeaderLines header = detail::read_aedat_header(bytes_);
    if (!header.has("!AER-DAT2.0"))
      throw RecordingError(bytes_.path(), "not an AEDAT 2 recording: no line '#!AER-DAT2.0'", 0);
    const std::string name(header.field("AEChip:"));
    const auto chip = name.empty() ? recognize_chip() : detail::find_chip(name);
    if (!chip)
      throw RecordingError(bytes_.path(),
                           "header: AEChip is '" + name + "', which is not supported (DVS128, DAVIS are)");
    is_davis_ = chip->is_davis;
    collector_.set_sensor_size(choose_sensor_size(chip->size, options, 1 << 10, "AEDAT 2", bytes_.path()));
  }

 private:
  static constexpr std::size_t kRecordBytes = 8;

  static std::uint32_t load_big_endian(const std::byte* bytes) noexcept {
    std::uint32_t word = 0;
    for (int i = 0; i < 4; ++i) word = word << 8U | static_cast<std::uint32_t>(bytes[i]);
    return word;
  }

  std::optional<detail::AedatChip> recognize_chip() {
    const auto records = bytes_.peek(BlockReader::kMaxKeep);
    std::size_t wide = 0, narrow = 0;
    for (std::size_t at = 0; at + kRecordBytes <= std::min(records.size(), BlockReader::kMaxKeep); at += kRecordBytes)
      ++(load_big_endian(&records[at]) > 0xFFFF ? wide : narrow);
    return detail::find_chip(wide > narrow ? "DAVIS" : "DVS128");
  }

  bool read_piece() override {
    const auto records = peek_records(kRecordBytes);
    if (records.empty()) return end_of_file();
    for (std::size_t at = 0; at < records.size(); at += kRecordBytes) {
      const Timestamp t = clock_.unwrap(load_big_endian(&records[at + 4]));
      if (is_davis_)
        add_davis(load_big_endian(&records[at]), t);
      else
        add_dvs128(load_big_endian(&records[at]), t);
    }
    bytes_.skip(records.size());
    return true;
  }

  // Both chips count from the bottom right.
  void add_davis(std::uint32_t address, Timestamp t) {
    constexpr std::uint32_t falling_edge = 2;
    const auto [width, height] = collector_.sensor_size();
    if (address >> 31U != 0) return;
    if ((address >> 10U & 1U) != 0)
      collector_.add(TriggerEvent{0, (address & 7U) != falling_edge, t});
    else
      collector_.add(width - 1 - static_cast<int>(address >> 12U & 0x3FFU),
                     height - 1 - static_cast<int>(address >> 22U & 0x1FFU), (address >> 11U & 1U) != 0, t);
  }

  void add_dvs128(std::uint32_t address, Timestamp t) {
    if ((address & 0x80008000U) != 0)
      collector_.add(TriggerEvent{0, false, t});
    else if (address > 0xFFFF)
      ++collector_.statistics.unknown_words;
    else
      collector_.add(127 - static_cast<int>(address >> 1U & 0x7FU), 127 - static_cast<int>(address >> 8U & 0x7FU),
                     (address & 1U) == 0, t);
  }

  bool is_davis_ = false;
  WrappingClock clock_{true};
};

}  // namespace evmarker::io
