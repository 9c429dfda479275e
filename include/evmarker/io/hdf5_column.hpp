#pragma once
// One column of the events in an HDF5 file, read piece by piece. Empty without the component `hdf5`.
#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/io/hdf5_ecf.hpp"
#include "evmarker/io/hdf5_handle.hpp"
#include "evmarker/io/hdf5_rows.hpp"

namespace evmarker::io {

/// The text of an attribute of a file, group or dataset; empty where it has none, or it is no text or a long one.
inline std::string hdf5_text(hid_t object, const char* name) {
  const Hdf5Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(attribute.get()), H5Sclose), type(H5Aget_type(attribute.get()), H5Tclose);
  if (H5Sget_simple_extent_npoints(space.get()) != 1 || H5Tget_class(type.get()) != H5T_STRING) return {};
  std::string text;
  if (H5Tis_variable_str(type.get()) > 0) {
    char* value = nullptr;
    if (H5Aread(attribute.get(), type.get(), &value) >= 0 && value != nullptr) text = value;
    H5free_memory(value);
  } else if (H5Tget_size(type.get()) < 100) {
    text.resize(H5Tget_size(type.get()));
    H5Aread(attribute.get(), type.get(), text.data());
    text = text.c_str();  // without the zeros that fill it up
  }
  return text;
}

/// A dataset that is open, with what reads its rows.
struct Hdf5Dataset {
  Hdf5Handle handle;
  std::optional<Hdf5Rows> rows;
  std::optional<Hdf5Ecf> ecf;  ///< reads the rows where ECF has compressed them; `rows` does not then

  hid_t get() const noexcept { return handle.get(); }

  /// Reads the events of `to.size()` rows from `first` on, if a row is an Event (`Hdf5Events::whole`).
  /// @throws std::runtime_error where libhdf5 cannot, or a chunk cannot be decoded
  void read(std::uint64_t first, std::span<Event> to) {
    if (ecf)
      ecf->read(first, to);
    else
      rows->read(first, to);
  }
};

/// Numbers of a dataset: all of them, a member of each compound, or a column of two dimensions.
class Hdf5Column {
 public:
  /// Most bytes of a chunk that is read: libhdf5 keeps one of each column in memory.
  static constexpr std::uint64_t kMaxChunkBytes = std::uint64_t{32} << 20;

  /// @param dataset shared with the other columns that it holds
  /// @param member of its compounds; empty if it has none
  /// @param column of a dataset of two dimensions
  /// @throws std::runtime_error unless the dataset has one dimension, or two where there is a column
  Hdf5Column(std::shared_ptr<Hdf5Dataset> dataset, std::string member, std::optional<hsize_t> column)
      : dataset_(std::move(dataset)), member_(std::move(member)), column_(column) {
    std::array<hsize_t, 2> sides{};
    const Hdf5Handle space(H5Dget_space(dataset_->get()), H5Sclose);
    const int dimensions = H5Sget_simple_extent_ndims(space.get());
    if (dimensions != (column ? 2 : 1))
      throw std::runtime_error("a dataset has " + std::to_string(dimensions) + " dimensions, must have " +
                               std::to_string(column ? 2 : 1));
    H5Sget_simple_extent_dims(space.get(), sides.data(), nullptr);
    rows_ = sides[0];
    number_ = dataset_->rows->number(member_, static_cast<std::size_t>(column_.value_or(0)));
  }

  /// A dataset, opened so that a chunk that was decompressed stays in memory until all of its rows are read. What is
  /// not compressed is read past libhdf5's cache, straight to where it is asked for. The dataset must not be open
  /// already: it would keep the cache that it was opened with.
  /// @throws std::runtime_error naming a chunk that is too long, a filter that is missing, or that data is missing
  static std::shared_ptr<Hdf5Dataset> open(hid_t file, const std::string& path) {
    Hdf5Handle dataset(H5Dopen2(file, path.c_str(), H5P_DEFAULT), H5Dclose);
    const Hdf5Handle creation(H5Dget_create_plist(dataset.get()), H5Pclose);
    if (!creation) throw std::runtime_error(Hdf5Silence::last_error());
    const std::uint64_t chunk_bytes = require_whole(dataset, creation.get());
    const bool has_ecf =
        H5Pget_filter_by_id2(creation.get(), Hdf5Ecf::kFilter, nullptr, nullptr, nullptr, 0, nullptr, nullptr) >= 0;
    if (!has_ecf) require_filters(creation.get());
    const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
    constexpr std::size_t kSlots = 521;
    const bool has_filters = H5Pget_nfilters(creation.get()) > 0;
    H5Pset_chunk_cache(access.get(), kSlots, has_filters ? static_cast<std::size_t>(chunk_bytes) : 0, 1.0);
    dataset = {};  // closed, see above
    auto opened = std::make_shared<Hdf5Dataset>();
    opened->handle = Hdf5Handle(H5Dopen2(file, path.c_str(), access.get()), H5Dclose);
    opened->rows.emplace(opened->get());
    if (has_ecf) opened->ecf.emplace(opened->get());
    return opened;
  }

  std::uint64_t rows() const noexcept { return rows_; }
  const std::string& member() const noexcept { return member_; }
  const std::optional<Hdf5Number>& number() const noexcept { return number_; }

  /// True if the numbers are of floating point.
  bool is_float() const {
    Hdf5Handle type(H5Dget_type(dataset_->get()), H5Tclose);
    if (!member_.empty())
      type = Hdf5Handle(
          H5Tget_member_type(type.get(), static_cast<unsigned>(H5Tget_member_index(type.get(), member_.c_str()))),
          H5Tclose);
    return H5Tget_class(type.get()) == H5T_FLOAT;
  }

  /// The attribute `units` of the dataset; empty where it has none.
  std::string units() const { return hdf5_text(dataset_->get(), "units"); }

  /// Reads the numbers of `to.size()` rows from `first` on.
  /// @throws std::runtime_error where libhdf5 cannot
  template <typename T>
  requires std::same_as<T, std::int64_t> || std::same_as<T, double>
  void read(std::uint64_t first, std::span<T> to) const {
    if (dataset_->ecf) return dataset_->ecf->read(member_, first, to);
    if (number_) return dataset_->rows->copy(*number_, first, to);
    const hid_t number = std::same_as<T, double> ? H5T_NATIVE_DOUBLE : H5T_NATIVE_INT64;
    Hdf5Handle compound;
    if (!member_.empty()) {
      compound = Hdf5Handle(H5Tcreate(H5T_COMPOUND, sizeof(T)), H5Tclose);
      H5Tinsert(compound.get(), member_.c_str(), 0, number);
    }
    const Hdf5Handle in_file(H5Dget_space(dataset_->get()), H5Sclose);
    const std::array<hsize_t, 2> begin{first, column_.value_or(0)}, sides{to.size(), 1};
    const Hdf5Handle in_memory(H5Screate_simple(1, sides.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(in_file.get(), H5S_SELECT_SET, begin.data(), nullptr, sides.data(), nullptr) < 0 ||
        H5Dread(dataset_->get(), compound ? compound.get() : number, in_memory.get(), in_file.get(), H5P_DEFAULT,
                to.data()) < 0)
      throw std::runtime_error(Hdf5Silence::last_error());
  }

 private:
  // Returns the bytes of a chunk, 0 where there are none. Rows that the file states but does not hold are refused: they
  // would be read as zeros, without an end.
  static std::uint64_t require_whole(const Hdf5Handle& dataset, hid_t creation) {
    const Hdf5Handle space(H5Dget_space(dataset.get()), H5Sclose), type(H5Dget_type(dataset.get()), H5Tclose);
    const auto stated = static_cast<std::uint64_t>(H5Sget_simple_extent_npoints(space.get()));
    const std::uint64_t item = H5Tget_size(type.get());
    std::uint64_t chunk_bytes = 0, held = H5Dget_storage_size(dataset.get()) / item;
    if (H5Pget_layout(creation) == H5D_CHUNKED) {
      std::array<hsize_t, 2> sides{1, 1};
      if (H5Pget_chunk(creation, 2, sides.data()) > 2) throw std::runtime_error("it has more than two dimensions");
      chunk_bytes = sides[0] * sides[1] * item;  // each side has 32 bits, and libhdf5 refuses more than 4 GB
      if (chunk_bytes > kMaxChunkBytes)
        throw std::runtime_error("its chunks have " + std::to_string(chunk_bytes) + " bytes, of which at most " +
                                 std::to_string(kMaxChunkBytes) + " are read");
      hsize_t chunks = 0;
      if (H5Dget_num_chunks(dataset.get(), space.get(), &chunks) < 0)
        throw std::runtime_error(Hdf5Silence::last_error());
      held = chunks * (chunk_bytes / item);
    }
    if (stated > held)
      throw std::runtime_error("it states " + std::to_string(stated) + " numbers, but holds " + std::to_string(held) +
                               ": cut off?");
    return chunk_bytes;
  }

  static void require_filters(hid_t creation) {
    struct Filter {
      int id;
      const char *name, *remedy;
    };
    static constexpr std::array<Filter, 5> known{{{32001, "Blosc", "on Debian, hdf5-filter-plugin-blosc-serial"},
                                                  {307, "BZip2", "on Debian, hdf5-filter-plugin"},
                                                  {32004, "LZ4", "on Debian, hdf5-filter-plugin"},
                                                  {32008, "Bitshuffle", "on Debian, hdf5-filter-plugin"},
                                                  {32015, "ZSTD", "set HDF5_PLUGIN_PATH to the folder of its plugin"}}};
    for (int i = 0; i < H5Pget_nfilters(creation); ++i) {
      std::size_t no_values = 0;
      unsigned flags = 0;
      const H5Z_filter_t id =
          H5Pget_filter2(creation, static_cast<unsigned>(i), &flags, &no_values, nullptr, 0, nullptr, nullptr);
      // An optional one may not have been applied; where it was, libhdf5 says so when it reads.
      if ((flags & H5Z_FLAG_OPTIONAL) != 0 || H5Zfilter_avail(id) > 0) continue;
      std::string name = "filter " + std::to_string(id), remedy = "set HDF5_PLUGIN_PATH to the folder of its plugin";
      for (const Filter& filter : known)
        if (filter.id == id) name = filter.name + (" (" + name + ")"), remedy = filter.remedy;
      throw std::runtime_error("it is compressed by " + name + ", whose plugin libhdf5 does not find: install it (" +
                               remedy + ")");
    }
  }

  std::shared_ptr<Hdf5Dataset> dataset_;
  std::string member_;
  std::optional<hsize_t> column_;
  std::optional<Hdf5Number> number_;  // in a row; nothing where libhdf5 has to convert it
  std::uint64_t rows_ = 0;
};

}  // namespace evmarker::io
#endif
