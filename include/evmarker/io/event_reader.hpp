#pragma once
// Recordings of any supported kind, recognised by their content, as a source of events.
#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/aedat2_reader.hpp"
#include "evmarker/io/aedat3_reader.hpp"
#include "evmarker/io/aedat4_reader.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/csv_reader.hpp"
#include "evmarker/io/dat_reader.hpp"
#include "evmarker/io/file_extension.hpp"
#include "evmarker/io/hdf5_reader.hpp"
#include "evmarker/io/mcap_reader.hpp"
#include "evmarker/io/raw_reader.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/recording_statistics.hpp"
#include "evmarker/io/rosbag2_reader.hpp"
#include "evmarker/io/rosbag_reader.hpp"

namespace evmarker::io {

struct EventReaderOptions {
  /// For recordings without sensor size, like most text files; the size in a recording has precedence.
  std::optional<SensorSize> sensor_size = std::nullopt;
  /// True to subtract the time of the first event or trigger event from all.
  bool shift_first_time_to_zero = false;
  /// Of a ROS recording, the topic whose events are read; empty for the only one that has events.
  std::string topic = {};
  TextLayout text_layout = {};  ///< its unit of time, if set, also replaces the one that an HDF5 file states
  /// Must outlive the reader, which also reads it on another thread. Once it is true, the recording ends, even while a
  /// pipe is silent; if that is before its first byte, the constructor throws a RecordingError.
  const std::atomic<bool>* stop = nullptr;
};

/// A bag of ROS 2 is `mcap` or, as an SQLite file, `rosbag2`.
enum class RecordingKind { raw, text, dat, aedat2, aedat3, aedat4, hdf5, mcap, rosbag, rosbag2 };

constexpr const char* to_string(RecordingKind kind) noexcept {
  switch (kind) {
    case RecordingKind::raw: return "Prophesee RAW";
    case RecordingKind::text: return "text";
    case RecordingKind::dat: return "Prophesee DAT";
    case RecordingKind::aedat2: return "AEDAT 2";
    case RecordingKind::aedat3: return "AEDAT 3.1";
    case RecordingKind::aedat4: return "AEDAT 4";
    case RecordingKind::hdf5: return "HDF5";
    case RecordingKind::mcap: return "ROS 2 MCAP";
    case RecordingKind::rosbag: return "ROS 1 bag";
    case RecordingKind::rosbag2: return "ROS 2 SQLite";
  }
  return "?";
}

namespace detail {

struct UnsupportedKind {
  std::string_view name, magic, extensions;  // each extension between blanks
};

inline constexpr std::array<UnsupportedKind, 4> kUnsupportedKinds{{
    {"other AEDAT", "#!AER-DAT", " .aedat .aedat4 "},
    {"other rosbag", "#ROSBAG V", " .bag "},
    {"NumPy", "\x93NUMPY", " .npy .npz "},
    {"ZIP archive", "PK\x03\x04", " .zip "},
}};

struct Compression {
  std::string_view name, magic, unpack;
};

inline constexpr std::array<Compression, 4> kCompressions{{
    {"gzip", "\x1f\x8b", "gunzip"},
    {"zstd", "\x28\xb5\x2f\xfd", "unzstd"},
    {"bzip2", "BZh", "bunzip2"},
    {"xz",
     "\xfd"
     "7zXZ",
     "unxz"},
}};

inline RecordingError not_supported(const std::filesystem::path& path, std::string_view name) {
  return {path, std::string(name) +
                    " recordings are not supported. Supported are: Prophesee RAW (EVT2, EVT2.1, EVT3), "
                    "DAT, AEDAT 2, 3.1 and 4, HDF5, ROS (rosbag, MCAP, SQLite), text (x,y,p,t or t x y p)"};
}

inline RecordingError compressed(const std::filesystem::path& path, std::string_view name, std::string_view unpack) {
  const std::filesystem::path unpacked =
      path.stem().has_extension() ? path.stem() : path.filename();  // x.raw.gz: x.raw
  return {path, "is compressed by " + std::string(name) + ", unpack it: " + std::string(unpack) + " <'" +
                    path.string() + "' >'unpacked_" + unpacked.string() + "'"};
}

inline bool is_one_of(const std::string& extension, std::string_view extensions) {
  return !extension.empty() && extensions.find(' ' + extension + ' ') != std::string_view::npos;
}

inline bool looks_like_text(std::string_view head) {
  return std::ranges::none_of(
      head, [](char c) { return static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\r' && c != '\t'; });
}

}  // namespace detail

/// Kind of a recording, by its content first and its extension second; but text is not looked for in a .raw file.
/// @param head of the file, of which the first 4096 bytes count
/// @param path of which only the extension counts; errors name it
/// @throws RecordingError where the file is empty or of a kind that is not supported
inline RecordingKind recognize_recording(std::string_view head, const std::filesystem::path& path) {
  head = head.substr(0, 4096);
  if (head.empty()) throw RecordingError(path, "the file is empty");
  const std::string extension = lower_extension(path);

  for (const auto& [name, magic, unpack] : detail::kCompressions)
    if (head.starts_with(magic)) throw detail::compressed(path, name, unpack);
  if (head.starts_with("#!AER-DAT2.0")) return RecordingKind::aedat2;
  if (head.starts_with("#!AER-DAT3.1")) return RecordingKind::aedat3;
  if (head.starts_with("#!AER-DAT4.0")) return RecordingKind::aedat4;
  if (head.starts_with("\x89MCAP0\r\n")) return RecordingKind::mcap;
  if (head.starts_with("#ROSBAG V2.0\n")) return RecordingKind::rosbag;
  if (head.starts_with("SQLite format 3")) return RecordingKind::rosbag2;
  if (head.starts_with("\x89HDF\r\n\x1a\n")) return RecordingKind::hdf5;
  for (const auto& kind : detail::kUnsupportedKinds)
    if (head.starts_with(kind.magic)) throw detail::not_supported(path, kind.name);
  // RAW and DAT both begin with lines "% ..."; RAW names its encoding, DAT a version.
  const bool prophesee = head.starts_with("% ");
  const bool names_encoding = head.find("% evt ") != head.npos || head.find("% format ") != head.npos;
  if (prophesee && !names_encoding && (extension == ".dat" || head.find("% Version ") != head.npos))
    return RecordingKind::dat;
  if ((prophesee && names_encoding) || extension == ".raw") return RecordingKind::raw;  // RawReader reports its faults
  if (detail::looks_like_text(head)) {
    if (head.starts_with("%YAML") || detail::is_one_of(extension, " .yml .yaml .xml .json "))
      throw RecordingError(path,
                           "is no recording but settings, like the calibration of --camera or a board of --board");
    return RecordingKind::text;
  }
  if (extension == ".dat") return RecordingKind::dat;  // DatReader reports the exact fault
  for (const auto& kind : detail::kUnsupportedKinds)
    if (detail::is_one_of(extension, kind.extensions)) throw detail::not_supported(path, kind.name);
  throw detail::not_supported(path, "such");
}

/// Reads recordings of every kind that `recognize_recording` supports, from files and, but for HDF5 and SQLite, from
/// pipes and FIFOs; an `EventSource`. Of all readers of HDF5, one thread at a time may use one.
class EventReader {
 public:
  using event_type = Event;

  /// @throws RecordingError where the file cannot be read
  explicit EventReader(const std::filesystem::path& path, const EventReaderOptions& options = {}) {
    BlockReader blocks(path, BlockReader::kBlockBytes, options.stop);
    const auto head = blocks.first();
    if (head.empty() && options.stop != nullptr && *options.stop)
      throw RecordingError(path, "stopped before its first byte");
    kind_ = recognize_recording({reinterpret_cast<const char*>(head.data()), head.size()}, path);
    reader_ = open(kind_, std::move(blocks), options);
  }

  SensorSize sensor_size() const { return reader_->sensor_size(); }
  /// The next events in the order of the file, valid until the next call; none at the end.
  /// @throws RecordingError naming what cannot be read, once all events before it are delivered
  std::span<const Event> next_batch() { return reader_->next_batch(); }
  /// Trigger events among the events of the last batch, or after the last event of the file; valid like the batch.
  std::span<const TriggerEvent> triggers() const { return reader_->triggers(); }
  RecordingStatistics statistics() const { return reader_->statistics(); }
  std::uint64_t bytes_read() const { return reader_->bytes_read(); }
  /// Size of the file; 0 where it has none, like a pipe.
  std::uint64_t bytes_total() const { return reader_->bytes_total(); }
  RecordingKind kind() const noexcept { return kind_; }
  /// The kind and what else was recognised, as "Prophesee RAW, EVT3" or "text, columns t x y p, time in s".
  std::string format() const {
    std::string format = to_string(kind_);
    if (const auto* raw = dynamic_cast<const RawReader*>(reader_.get()))
      format += std::string(", ") + to_string(raw->header().format);
    if (const auto* text = dynamic_cast<const CsvReader*>(reader_.get())) {
      format += ", columns";
      for (const char column : text->layout().columns) format += {' ', column};
      format += std::string(", time in ") + to_string(text->layout().time_unit);
    }
    return format;
  }

 private:
  static std::unique_ptr<RecordingReader> open(RecordingKind kind, BlockReader blocks,
                                               const EventReaderOptions& options) {
    const RecordingOptions common{options.sensor_size, options.shift_first_time_to_zero, options.topic};
    switch (kind) {
      case RecordingKind::raw: return std::make_unique<RawReader>(std::move(blocks), common);
      case RecordingKind::dat: return std::make_unique<DatReader>(std::move(blocks), common);
      case RecordingKind::aedat2: return std::make_unique<Aedat2Reader>(std::move(blocks), common);
      case RecordingKind::aedat3: return std::make_unique<Aedat3Reader>(std::move(blocks), common);
      case RecordingKind::aedat4: return std::make_unique<Aedat4Reader>(std::move(blocks), common);
      case RecordingKind::hdf5:
        return open_hdf5(blocks.path(), {{common}, options.text_layout.time_unit, options.stop});
      case RecordingKind::mcap: return std::make_unique<McapReader>(std::move(blocks), common);
      case RecordingKind::rosbag: return std::make_unique<RosbagReader>(std::move(blocks), common);
      case RecordingKind::rosbag2: return open_rosbag2(blocks.path(), {{common}, options.stop});
      case RecordingKind::text: break;
    }
    return std::make_unique<CsvReader>(
        std::move(blocks),
        CsvReaderOptions{options.sensor_size, options.shift_first_time_to_zero, options.text_layout});
  }

  RecordingKind kind_ = RecordingKind::text;
  std::unique_ptr<RecordingReader> reader_;
};

}  // namespace evmarker::io
