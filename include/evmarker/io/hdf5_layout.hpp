#pragma once
// Where the events are in an HDF5 file, and what it says about them. Empty without the component `hdf5`.
#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/column_names.hpp"
#include "evmarker/io/hdf5_column.hpp"
#include "evmarker/io/hdf5_handle.hpp"
#include "evmarker/io/header_lines.hpp"
#include "evmarker/io/time_unit.hpp"

namespace evmarker::io {

/// The events of a file, as four columns of the same length.
struct Hdf5Events {
  static constexpr std::size_t kX = 0, kY = 1, kP = 2, kT = 3;  ///< indices of the columns

  std::string path;  ///< in the file
  std::vector<Hdf5Column> columns;
  std::optional<TimeUnit> time_unit;
  std::shared_ptr<Hdf5Dataset> whole = nullptr;  ///< where the rows of a dataset are Events, which is faster to read
};

namespace detail {

/// Names of what is in a group, at most the first thousand.
inline std::vector<std::string> names_in(hid_t group) {
  constexpr hsize_t kMost = 1000;
  std::vector<std::string> names;
  H5G_info_t info{};
  if (H5Gget_info(group, &info) < 0) return names;
  for (hsize_t i = 0; i < std::min(info.nlinks, kMost); ++i) {
    std::array<char, 256> name{};
    if (H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(), H5P_DEFAULT) > 0)
      names.emplace_back(name.data());
  }
  return names;
}

/// The events of the columns that `names` has for x, y, p and t, each opened by `open(name)`; nothing unless it has
/// all.
inline std::optional<Hdf5Events> by_names(const std::string& path, const std::vector<std::string>& names,
                                          const std::function<Hdf5Column(const std::string&)>& open) {
  std::array<std::string, 4> found;
  Hdf5Events events{path, {}, std::nullopt};
  for (const std::string& name : names) {
    const NamedColumns named = name_columns({name});
    const auto column = std::string_view("xypt").find(named.letters);
    if (column == std::string_view::npos) continue;
    if (!found[column].empty()) return std::nullopt;
    found[column] = name;
    if (named.time_unit) events.time_unit = named.time_unit;
  }
  for (const std::string& name : found)
    if (name.empty()) return std::nullopt;
  for (const std::string& name : found) events.columns.push_back(open(name));
  return events;
}

/// True if the rows of the dataset that holds the columns x, y, p and t are Events.
inline bool are_events(const Hdf5Dataset& dataset, const std::vector<Hdf5Column>& columns) {
  const Hdf5Column &x = columns[Hdf5Events::kX], &y = columns[Hdf5Events::kY], &p = columns[Hdf5Events::kP],
                   &t = columns[Hdf5Events::kT];
  if (dataset.ecf) return x.member() == "x" && y.member() == "y" && p.member() == "p" && t.member() == "t";
  return dataset.rows->are_events({{x.number(), y.number(), p.number(), t.number()}});
}

/// The events at a path of a file: a group of four datasets, a dataset of compounds, or one with the columns x, y, t,
/// p.
/// @throws std::runtime_error where these are events, but cannot be read
inline std::optional<Hdf5Events> events_at(hid_t file, const std::string& path) {
  Hdf5Handle object(H5Oopen(file, path.c_str(), H5P_DEFAULT), H5Oclose);
  if (!object) return std::nullopt;
  if (H5Iget_type(object.get()) == H5I_GROUP)
    return by_names(path, names_in(object.get()), [&](const std::string& name) {
      return Hdf5Column(Hdf5Column::open(file, path + "/" + name), "", std::nullopt);
    });
  if (H5Iget_type(object.get()) != H5I_DATASET) return std::nullopt;

  const Hdf5Handle type(H5Dget_type(object.get()), H5Tclose), space(H5Dget_space(object.get()), H5Sclose);
  const int dimensions = H5Sget_simple_extent_ndims(space.get());
  object = {};  // closed, for Hdf5Column::open
  if (dimensions == 1 && H5Tget_class(type.get()) == H5T_COMPOUND) {
    std::vector<std::string> members;
    for (int i = 0; i < H5Tget_nmembers(type.get()); ++i) {
      char* const name = H5Tget_member_name(type.get(), static_cast<unsigned>(i));
      members.emplace_back(name == nullptr ? "" : name);
      H5free_memory(name);
    }
    std::shared_ptr<Hdf5Dataset> dataset;
    auto events = by_names(path, members, [&](const std::string& member) {
      if (!dataset) dataset = Hdf5Column::open(file, path);
      return Hdf5Column(dataset, member, std::nullopt);
    });
    if (events && are_events(*dataset, events->columns)) events->whole = dataset;
    return events;
  }
  std::array<hsize_t, 2> sides{};
  if (dimensions != 2 || H5Sget_simple_extent_dims(space.get(), sides.data(), nullptr) < 0 || sides[1] != 4)
    return std::nullopt;
  const auto dataset = Hdf5Column::open(file, path);
  Hdf5Events events{path, {}, std::nullopt};
  for (const hsize_t column : {hsize_t{0}, hsize_t{1}, hsize_t{3}, hsize_t{2}})  // x, y, t, p in the dataset
    events.columns.emplace_back(dataset, "", column);
  return events;
}

}  // namespace detail

/// Finds the events: where Prophesee, DSEC and MVSEC (the left camera before the right one) have them, else in the
/// first group or dataset of the file's root, by name, that holds them, else in the root.
/// @throws std::runtime_error naming what cannot be read
inline Hdf5Events find_hdf5_events(hid_t file) {
  std::vector<std::string> paths{"/CD/events", "/events", "/davis/left/events", "/davis/right/events"};
  const Hdf5Handle root(H5Gopen2(file, "/", H5P_DEFAULT), H5Gclose);
  for (const std::string& name : detail::names_in(root.get())) paths.push_back("/" + name);
  paths.emplace_back("/");
  for (const std::string& path : paths) {
    try {
      auto events = detail::events_at(file, path);
      if (!events) continue;
      for (const Hdf5Column& column : events->columns)
        if (column.rows() != events->columns.front().rows())
          throw std::runtime_error("its columns have " + std::to_string(events->columns.front().rows()) + " and " +
                                   std::to_string(column.rows()) + " numbers, must have the same");
      if (path == "/CD/events") events->time_unit = TimeUnit::microseconds;
      if (!events->time_unit) events->time_unit = time_unit_named(events->columns[Hdf5Events::kT].units());
      return std::move(*events);
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(path + ": " + error.what());
    }
  }
  throw std::runtime_error(
      "no events in it: neither a group of four datasets x, y, t and p, nor a dataset with these as members or "
      "columns");
}

/// The whole number of a dataset or attribute of the file's root; nothing where there is none.
inline std::optional<std::int64_t> hdf5_number(hid_t file, const char* name) {
  std::int64_t number = 0;
  if (const Hdf5Handle dataset(H5Dopen2(file, name, H5P_DEFAULT), H5Dclose); dataset) {
    const Hdf5Handle space(H5Dget_space(dataset.get()), H5Sclose);
    if (H5Sget_simple_extent_npoints(space.get()) != 1) return std::nullopt;
    if (H5Dread(dataset.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &number) < 0) return std::nullopt;
    return number;
  }
  const Hdf5Handle attribute(H5Aopen(file, name, H5P_DEFAULT), H5Aclose);
  const Hdf5Handle space(H5Aget_space(attribute.get()), H5Sclose);
  if (H5Sget_simple_extent_npoints(space.get()) != 1) return std::nullopt;
  if (H5Aread(attribute.get(), H5T_NATIVE_INT64, &number) < 0) return std::nullopt;
  return number;
}

/// The sensor size of Prophesee's attribute `geometry`, like 1280x720, or of `width` and `height`; else nothing.
inline std::optional<SensorSize> hdf5_sensor_size(hid_t file) {
  const auto width = hdf5_number(file, "width"), height = hdf5_number(file, "height");
  constexpr std::int64_t kMost = 1 << 30;
  if (width && height && *width > 0 && *height > 0 && *width < kMost && *height < kMost)
    return SensorSize{static_cast<int>(*width), static_cast<int>(*height)};
  return detail::parse_geometry(hdf5_text(file, "geometry"), 'x');
}

}  // namespace evmarker::io
#endif
