#pragma once
// HDF5 files in memory, written by libhdf5. Empty without the component `hdf5`.
#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"

namespace evmarker::io::test {

/// How a dataset is stored.
struct Hdf5Storage {
  hsize_t chunk_rows = 0;      ///< 0 for no chunks
  unsigned deflate_level = 0;  ///< 0 for no compression
  H5Z_filter_t filter = 0;     ///< a further filter, which is registered; 0 for none
};

/// A file of datasets and attributes, of which `bytes` is the content.
class Hdf5Bytes {
 public:
  Hdf5Bytes() {
    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_fapl_core(access, std::size_t{1} << 20, false);
    const std::string name = "in memory at " + std::to_string(reinterpret_cast<std::uintptr_t>(this));  // not twice
    file_ = H5Fcreate(name.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
    H5Pclose(access);
    links_ = H5Pcreate(H5P_LINK_CREATE);
    H5Pset_create_intermediate_group(links_, 1);
  }
  ~Hdf5Bytes() {
    H5Pclose(links_);
    H5Fclose(file_);
  }
  Hdf5Bytes(const Hdf5Bytes&) = delete;
  Hdf5Bytes& operator=(const Hdf5Bytes&) = delete;

  /// Adds a dataset of `sides` numbers, or compounds, from the values in memory; of null, nothing is written.
  void add(const std::string& path, const std::vector<hsize_t>& sides, hid_t stored_type, hid_t memory_type,
           const void* values, const Hdf5Storage& storage = {}) {
    const hid_t space = H5Screate_simple(static_cast<int>(sides.size()), sides.data(), nullptr);
    const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    auto chunk = sides;
    chunk[0] = storage.chunk_rows;
    if (storage.chunk_rows > 0) H5Pset_chunk(creation, static_cast<int>(chunk.size()), chunk.data());
    if (storage.deflate_level > 0) H5Pset_deflate(creation, storage.deflate_level);
    if (storage.filter > 0) H5Pset_filter(creation, storage.filter, H5Z_FLAG_MANDATORY, 0, nullptr);
    const hid_t dataset = H5Dcreate2(file_, path.c_str(), stored_type, space, links_, creation, H5P_DEFAULT);
    if (dataset < 0) throw std::logic_error("no dataset " + path);
    if (values != nullptr) H5Dwrite(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values);
    H5Dclose(dataset);
    H5Pclose(creation);
    H5Sclose(space);
  }
  void add(const std::string& path, const std::vector<double>& values, hid_t stored_type,
           const Hdf5Storage& storage = {}) {
    add(path, {values.size()}, stored_type, H5T_NATIVE_DOUBLE, values.data(), storage);
  }
  void add(const std::string& path, const std::vector<std::int64_t>& values, hid_t stored_type,
           const Hdf5Storage& storage = {}) {
    add(path, {values.size()}, stored_type, H5T_NATIVE_INT64, values.data(), storage);
  }

  /// Adds a single number.
  void add_number(const std::string& path, std::int64_t value) {
    const hid_t space = H5Screate(H5S_SCALAR);
    const hid_t dataset = H5Dcreate2(file_, path.c_str(), H5T_STD_I64LE, space, links_, H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(dataset, H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value);
    H5Dclose(dataset);
    H5Sclose(space);
  }

  /// Adds a text, of variable length as OpenEB does, to the root.
  void add_attribute(const char* name, const char* text) {
    const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
    H5Tset_size(type, H5T_VARIABLE);
    const hid_t attribute = H5Acreate2(file_, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(attribute, type, &text);
    H5Aclose(attribute);
    H5Sclose(space);
    H5Tclose(type);
  }

  /// Adds the events as compounds, like Prophesee.
  void add_compounds(const std::string& path, std::span<const Event> events, const Hdf5Storage& storage = {}) {
    const hid_t type = event_type();
    add(path, {events.size()}, type, type, events.data(), storage);
    H5Tclose(type);
  }

  /// Adds a dataset of events that ECF compresses, whose chunks are these bytes; nothing of a chunk that is empty.
  void add_ecf(const std::string& path, hsize_t events, hsize_t chunk_rows, const std::vector<std::string>& chunks) {
    const auto leave = [](unsigned, std::size_t, const unsigned*, std::size_t bytes, std::size_t*, void**) {
      return bytes;
    };
    constexpr H5Z_filter_t kEcf = 0x8ECF;
    const H5Z_class2_t ecf{H5Z_CLASS_T_VERS, kEcf, 1, 1, "ECF", nullptr, nullptr, leave};
    H5Zregister(&ecf);  // a dataset is only made with filters that are there
    const hid_t type = event_type();
    add(path, {events}, type, type, nullptr, {.chunk_rows = chunk_rows, .filter = kEcf});
    const hid_t dataset = H5Dopen2(file_, path.c_str(), H5P_DEFAULT);
    hsize_t row = 0;
    for (const std::string& chunk : chunks) {
      if (!chunk.empty()) H5Dwrite_chunk(dataset, H5P_DEFAULT, 0, &row, chunk.size(), chunk.data());
      row += chunk_rows;
    }
    H5Dclose(dataset);
    H5Tclose(type);
    H5Fflush(file_, H5F_SCOPE_GLOBAL);
    H5Zunregister(kEcf);
  }

  /// Adds triggers as compounds p, t and id, like Prophesee.
  void add_triggers(const std::string& path, std::span<const TriggerEvent> triggers, const Hdf5Storage& storage = {}) {
    struct Row {
      std::int16_t p;
      std::int64_t t;
      std::int16_t id;
    };
    std::vector<Row> rows;
    for (const TriggerEvent& trigger : triggers)
      rows.push_back(
          {static_cast<std::int16_t>(trigger.rising ? 1 : 0), trigger.t, static_cast<std::int16_t>(trigger.id)});
    const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(Row));
    H5Tinsert(type, "p", HOFFSET(Row, p), H5T_NATIVE_INT16);
    H5Tinsert(type, "t", HOFFSET(Row, t), H5T_NATIVE_INT64);
    H5Tinsert(type, "id", HOFFSET(Row, id), H5T_NATIVE_INT16);
    add(path, {rows.size()}, type, type, rows.data(), storage);
    H5Tclose(type);
  }

  /// Adds the events as datasets x, y, t, p of a group, like DSEC.
  void add_columns(const std::string& group, std::span<const Event> events, const Hdf5Storage& storage = {}) {
    const auto column = [&](const char* name, hid_t type, const auto& value_of) {
      std::vector<std::int64_t> values;
      for (const Event& event : events) values.push_back(value_of(event));
      add(group + "/" + name, values, type, storage);
    };
    column("x", H5T_STD_U16LE, [](const Event& e) { return std::int64_t{e.x}; });
    column("y", H5T_STD_U16LE, [](const Event& e) { return std::int64_t{e.y}; });
    column("t", H5T_STD_U32LE, [](const Event& e) { return e.t; });
    column("p", H5T_STD_U8LE, [](const Event& e) { return std::int64_t{e.p}; });
  }

  std::string bytes() const {
    H5Fflush(file_, H5F_SCOPE_GLOBAL);
    std::string bytes(static_cast<std::size_t>(H5Fget_file_image(file_, nullptr, 0)), '\0');
    H5Fget_file_image(file_, bytes.data(), bytes.size());
    return bytes;
  }

 private:
  static hid_t event_type() {
    const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(Event));
    H5Tinsert(type, "x", HOFFSET(Event, x), H5T_NATIVE_UINT16);
    H5Tinsert(type, "y", HOFFSET(Event, y), H5T_NATIVE_UINT16);
    H5Tinsert(type, "p", HOFFSET(Event, p), H5T_NATIVE_INT16);
    H5Tinsert(type, "t", HOFFSET(Event, t), H5T_NATIVE_INT64);
    return type;
  }

  hid_t file_ = -1, links_ = -1;
};

}  // namespace evmarker::io::test
#endif
