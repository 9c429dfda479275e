#pragma once
// Writes events as HDF5, where the build has libhdf5: with the component `hdf5`.
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/event_checks.hpp"
#include "evmarker/io/hdf5_handle.hpp"
#include "evmarker/io/output_file.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_writer.hpp"

namespace evmarker::io {

/// What libhdf5 compresses with: gzip is everywhere, zstd needs its plugin, to write and to read.
enum class Hdf5Compression { none, gzip, zstd };

#ifdef EVMARKER_HAS_HDF5

/// Writes the datasets `events/x`, `events/y` (16 bits), `events/p` (0 or 1) and `events/t` (signed, microseconds), and
/// the sensor size as the attributes `width` and `height`; no triggers. libhdf5 may be used by one thread at a time.
class Hdf5Writer final : public RecordingWriter {
 public:
  /// @throws std::invalid_argument for a sensor without pixels
  /// @throws RecordingError where the file cannot be created or compressed so
  Hdf5Writer(const std::filesystem::path& path, SensorSize size, Hdf5Compression compression = Hdf5Compression::gzip)
      : size_(size), output_(checked(path, size, compression)) {
    const Hdf5Silence silence;
    file_ = Hdf5Handle(H5Fcreate(part_of(path).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    if (!file_) throw failure("cannot create");
    reserve_space();
    add_number("width", size.width);
    add_number("height", size.height);
    const Hdf5Handle group(H5Gcreate2(file_.get(), "events", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
    x_.dataset = create("events/x", H5T_STD_U16LE, compression);
    y_.dataset = create("events/y", H5T_STD_U16LE, compression);
    p_.dataset = create("events/p", H5T_STD_U8LE, compression);
    t_.dataset = create("events/t", H5T_STD_I64LE, compression);
    add_text(t_.dataset.get(), "units", "us");
  }
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;
  ~Hdf5Writer() override {
    const Hdf5Silence silence;  // a disk that is full has been reported
    close_handles();
  }

  void write(std::span<const Event> events) override {
    if (!file_) throw RecordingError(output_.path(), "cannot write: the file was closed");
    require_writable(events, size_, events_written_, /*negative_times=*/true);
    for (const Event& event : events) {
      x_.rows.push_back(event.x);
      y_.rows.push_back(event.y);
      p_.rows.push_back(event.p > 0 ? 1 : 0);
      t_.rows.push_back(event.t);
      if (t_.rows.size() == kChunkRows) flush();
    }
    events_written_ += events.size();
  }
  void write(const Event& event) { write(std::span(&event, 1)); }

  void close() override {
    if (!file_) return;
    flush();
    {
      const Hdf5Silence silence;
      if (H5Fflush(file_.get(), H5F_SCOPE_GLOBAL) < 0) throw failure("cannot write");
      release_space();
      close_handles();
    }
    output_.close();
  }

  std::size_t count_writable(std::span<const Event> events) const override { return events.size(); }
  SensorSize sensor_size() const noexcept override { return size_; }
  std::uint64_t events_written() const noexcept override { return events_written_; }

 private:
  static constexpr hsize_t kChunkRows = hsize_t{1} << 16;
  static constexpr H5Z_filter_t kZstd = 32015;  // as registered with The HDF Group

  template <typename T>
  struct Column {
    Hdf5Handle dataset;
    std::vector<T> rows;  // not written yet
  };

  static std::filesystem::path checked(const std::filesystem::path& path, SensorSize size,
                                       Hdf5Compression compression) {
    require_sensor_size(size, SensorSize::kMaxSide);
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status) &&
        !std::filesystem::is_directory(status))
      throw RecordingError(path, "HDF5 recordings are written to files alone, not to pipes or devices");
    const Hdf5Silence silence;
    if (compression == Hdf5Compression::zstd && H5Zfilter_avail(kZstd) <= 0)
      throw RecordingError(path,
                           "libhdf5 does not find its plugin for zstd (filter 32015): HDF5_PLUGIN_PATH is its "
                           "folder; gzip needs none");
    return path;
  }

  RecordingError failure(const std::string& what) const {
    return {output_.path(), what + ": " + Hdf5Silence::last_error()};
  }

  Hdf5Handle create(const char* path, hid_t type, Hdf5Compression compression) const {
    constexpr hsize_t none = 0, unlimited = H5S_UNLIMITED;
    const Hdf5Handle space(H5Screate_simple(1, &none, &unlimited), H5Sclose);
    const Hdf5Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_chunk(creation.get(), 1, &kChunkRows);
    if (compression != Hdf5Compression::none) H5Pset_shuffle(creation.get());
    constexpr unsigned gzip_level = 4, zstd_level = 3;  // their defaults
    if (compression == Hdf5Compression::gzip) H5Pset_deflate(creation.get(), gzip_level);
    if (compression == Hdf5Compression::zstd) H5Pset_filter(creation.get(), kZstd, H5Z_FLAG_MANDATORY, 1, &zstd_level);
    const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
    H5Pset_chunk_cache(access.get(), 0, 0, 0);  // chunks are written whole, and at once, see reserve_space
    Hdf5Handle dataset(H5Dcreate2(file_.get(), path, type, space.get(), H5P_DEFAULT, creation.get(), access.get()),
                       H5Dclose);
    if (!dataset) throw failure("cannot create");
    return dataset;
  }

  void add_number(const char* name, int value) const {
    const Hdf5Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Hdf5Handle attribute(H5Acreate2(file_.get(), name, H5T_STD_I32LE, space.get(), H5P_DEFAULT, H5P_DEFAULT),
                               H5Aclose);
    if (H5Awrite(attribute.get(), H5T_NATIVE_INT, &value) < 0) throw failure("cannot write");
  }

  void add_text(hid_t object, const char* name, const std::string& text) const {
    const Hdf5Handle space(H5Screate(H5S_SCALAR), H5Sclose), type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type.get(), text.size());
    const Hdf5Handle attribute(H5Acreate2(object, name, type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    if (H5Awrite(attribute.get(), type.get(), text.data()) < 0) throw failure("cannot write");
  }

  // libhdf5 crashes, when the program ends, by a file that it could not write to the end: it is given the space before.
  void reserve_space() const {
    constexpr off_t columns = kChunkRows * (2 + 2 + 1 + 8), index = 1 << 20;  // [bytes] of a chunk each, at most
    if (const int error = ::posix_fallocate(descriptor(), bytes_until_now(), columns + index))
      throw RecordingError(output_.path(), "cannot write: " + std::generic_category().message(error));
  }
  void release_space() const {
    if (::ftruncate(descriptor(), bytes_until_now()) != 0)
      throw RecordingError(output_.path(), "cannot write: " + std::generic_category().message(errno));
  }
  off_t bytes_until_now() const {
    hsize_t bytes = 0;
    if (H5Fget_filesize(file_.get(), &bytes) < 0) throw failure("cannot write");
    return static_cast<off_t>(bytes);
  }
  int descriptor() const {
    void* descriptor = nullptr;
    if (H5Fget_vfd_handle(file_.get(), H5P_DEFAULT, &descriptor) < 0) throw failure("cannot write");
    return *static_cast<int*>(descriptor);
  }

  void flush() {
    const Hdf5Silence silence;
    if (t_.rows.empty()) return;
    reserve_space();
    const hsize_t count = t_.rows.size();
    append(x_, H5T_NATIVE_UINT16);
    append(y_, H5T_NATIVE_UINT16);
    append(p_, H5T_NATIVE_UINT8);
    append(t_, H5T_NATIVE_INT64);
    rows_in_file_ += count;
  }

  template <typename T>
  void append(Column<T>& column, hid_t number) {
    const hsize_t count = column.rows.size(), sum = rows_in_file_ + count;
    const hid_t dataset = column.dataset.get();
    if (H5Dset_extent(dataset, &sum) < 0) throw failure("cannot write");
    const Hdf5Handle in_file(H5Dget_space(dataset), H5Sclose),
        in_memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
    if (H5Sselect_hyperslab(in_file.get(), H5S_SELECT_SET, &rows_in_file_, nullptr, &count, nullptr) < 0 ||
        H5Dwrite(dataset, number, in_memory.get(), in_file.get(), H5P_DEFAULT, column.rows.data()) < 0)
      throw failure("cannot write");
    column.rows.clear();
  }

  void close_handles() noexcept {
    for (Hdf5Handle* const handle : {&x_.dataset, &y_.dataset, &p_.dataset, &t_.dataset, &file_})
      *handle = Hdf5Handle();
  }

  SensorSize size_;
  OutputFile output_;  // makes the part, and renames it; libhdf5 writes to it
  Hdf5Handle file_;
  Column<std::uint16_t> x_, y_;
  Column<std::uint8_t> p_;
  Column<std::int64_t> t_;
  hsize_t rows_in_file_ = 0;
  std::uint64_t events_written_ = 0;
};

#endif

/// @throws std::invalid_argument, RecordingError as Hdf5Writer, or where this build leaves it out
inline std::unique_ptr<RecordingWriter> create_hdf5(const std::filesystem::path& path, [[maybe_unused]] SensorSize size,
                                                    [[maybe_unused]] Hdf5Compression compression) {
#ifdef EVMARKER_HAS_HDF5
  return std::make_unique<Hdf5Writer>(path, size, compression);
#else
  throw without_hdf5(path);
#endif
}

}  // namespace evmarker::io
