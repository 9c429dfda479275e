#pragma once
// Recordings of every kind that can be written, by the name of the file or of the format.
#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/io/csv_writer.hpp"
#include "evmarker/io/file_extension.hpp"
#include "evmarker/io/hdf5_writer.hpp"
#include "evmarker/io/raw_header.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "evmarker/io/recording_writer.hpp"

namespace evmarker::io {

enum class WrittenFormat { evt2, evt3, csv, hdf5 };

constexpr const char* to_string(WrittenFormat format) noexcept {
  switch (format) {
    case WrittenFormat::evt2: return "EVT2";
    case WrittenFormat::evt3: return "EVT3";
    case WrittenFormat::csv: return "CSV";
    case WrittenFormat::hdf5: return "HDF5";
  }
  return "?";
}

/// The format that a file's extension stands for: EVT3 for .raw, CSV for .csv and .txt, HDF5 for .h5 and .hdf5; nothing
/// for any other.
inline std::optional<WrittenFormat> format_by_extension(const std::filesystem::path& path) {
  constexpr std::array<std::pair<std::string_view, WrittenFormat>, 5> known{{{".raw", WrittenFormat::evt3},
                                                                             {".csv", WrittenFormat::csv},
                                                                             {".txt", WrittenFormat::csv},
                                                                             {".h5", WrittenFormat::hdf5},
                                                                             {".hdf5", WrittenFormat::hdf5}}};
  const std::string extension = lower_extension(path);
  const auto found = std::ranges::find(known, extension, [](const auto& pair) { return pair.first; });
  return found == known.end() ? std::nullopt : std::optional(found->second);
}

/// Begins a recording.
/// @param compression of HDF5 alone
/// @throws std::invalid_argument for a sensor size that the format cannot express
/// @throws RecordingError where the file cannot be created, or this build leaves the format out
inline std::unique_ptr<RecordingWriter> create_recording(const std::filesystem::path& path, SensorSize size,
                                                         WrittenFormat format,
                                                         Hdf5Compression compression = Hdf5Compression::gzip) {
  switch (format) {
    case WrittenFormat::evt2: return std::make_unique<RawWriter>(path, size, RawFormat::evt2);
    case WrittenFormat::evt3: return std::make_unique<RawWriter>(path, size, RawFormat::evt3);
    case WrittenFormat::csv: return std::make_unique<CsvWriter>(path, size);
    case WrittenFormat::hdf5: break;
  }
  return create_hdf5(path, size, compression);
}

}  // namespace evmarker::io
