#pragma once
// Rows of an HDF5 dataset, read once for all of its columns. Empty without the component `hdf5`.
#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/hdf5_handle.hpp"

namespace evmarker::io {

/// Where the numbers of a column are in each row, and what they are.
struct Hdf5Number {
  enum class Kind { signed_whole, unsigned_whole, floating };
  Kind kind;
  std::size_t bytes;   ///< of a number
  std::size_t offset;  ///< in the row

  constexpr bool operator==(const Hdf5Number&) const = default;
};

/// Keeps the rows that were read last, in this machine's order of bytes. libhdf5 copies numbers that are so in the
/// file, too; to convert them, or to read them column by column, would take it ten times as long.
class Hdf5Rows {
 public:
  /// @param dataset of one dimension, or of two with a row each; must outlive this
  explicit Hdf5Rows(hid_t dataset) : dataset_(dataset), space_(H5Dget_space(dataset), H5Sclose) {
    const Hdf5Handle in_file(H5Dget_type(dataset), H5Tclose);
    type_ = Hdf5Handle(H5Tget_native_type(in_file.get(), H5T_DIR_ASCEND), H5Tclose);
    std::array<hsize_t, 2> sides{1, 1};
    if (H5Sget_simple_extent_ndims(space_.get()) <= 2) H5Sget_simple_extent_dims(space_.get(), sides.data(), nullptr);
    in_row_ = sides[1];
  }

  /// The number of a member of the compounds or, if it is empty, of a column; nothing if it is of another kind, or if
  /// the rows hold what does not belong into memory of a bounded size.
  std::optional<Hdf5Number> number(const std::string& member, std::size_t column) const {
    constexpr std::size_t kMostBytes = 256;
    if (row_bytes() > kMostBytes) return std::nullopt;
    for (const H5T_class_t kind : {H5T_VLEN, H5T_STRING, H5T_REFERENCE})
      if (H5Tdetect_class(type_.get(), kind) != 0) return std::nullopt;
    Hdf5Handle type(H5Tcopy(type_.get()), H5Tclose);
    std::size_t offset = column * H5Tget_size(type_.get());
    if (!member.empty()) {
      const int index = H5Tget_member_index(type_.get(), member.c_str());
      if (index < 0) return std::nullopt;
      offset = H5Tget_member_offset(type_.get(), static_cast<unsigned>(index));
      type = Hdf5Handle(H5Tget_member_type(type_.get(), static_cast<unsigned>(index)), H5Tclose);
    }
    if (H5Tget_class(type.get()) == H5T_ENUM) type = Hdf5Handle(H5Tget_super(type.get()), H5Tclose);  // bool
    const std::size_t bytes = H5Tget_size(type.get());
    if (H5Tget_class(type.get()) == H5T_FLOAT && (bytes == sizeof(float) || bytes == sizeof(double)))
      return Hdf5Number{Hdf5Number::Kind::floating, bytes, offset};
    const bool whole = H5Tget_class(type.get()) == H5T_INTEGER && bytes <= 8 && (bytes & (bytes - 1)) == 0;
    if (!whole) return std::nullopt;
    const bool is_signed = H5Tget_sign(type.get()) == H5T_SGN_2;
    return Hdf5Number{is_signed ? Hdf5Number::Kind::signed_whole : Hdf5Number::Kind::unsigned_whole, bytes, offset};
  }

  /// True if the numbers, x, y, p and t in this order, lie in a row as in an Event.
  bool are_events(const std::array<std::optional<Hdf5Number>, 4>& numbers) const {
    using enum Hdf5Number::Kind;
    constexpr std::array<Hdf5Number, 4> in_event{{{unsigned_whole, sizeof(Event::x), offsetof(Event, x)},
                                                  {unsigned_whole, sizeof(Event::y), offsetof(Event, y)},
                                                  {signed_whole, sizeof(Event::p), offsetof(Event, p)},
                                                  {signed_whole, sizeof(Event::t), offsetof(Event, t)}}};
    return row_bytes() == sizeof(Event) && std::ranges::equal(numbers, in_event);
  }

  /// Reads rows that are events, from `first` on.
  /// @throws std::runtime_error where libhdf5 cannot
  void read(std::uint64_t first, std::span<Event> events) const { read(first, events.size(), events.data()); }

  /// Copies the numbers of `to.size()` rows from `first` on.
  /// @throws std::runtime_error where libhdf5 cannot read them
  template <typename T>
  void copy(const Hdf5Number& number, std::uint64_t first, std::span<T> to) {
    keep(first, to.size());
    using Kind = Hdf5Number::Kind;
    const bool is_signed = number.kind == Kind::signed_whole;
    switch (number.bytes) {
      case 1: return is_signed ? copy_as<std::int8_t>(number, to) : copy_as<std::uint8_t>(number, to);
      case 2: return is_signed ? copy_as<std::int16_t>(number, to) : copy_as<std::uint16_t>(number, to);
      case 4:
        if (number.kind == Kind::floating) return copy_as<float>(number, to);
        return is_signed ? copy_as<std::int32_t>(number, to) : copy_as<std::uint32_t>(number, to);
      default:
        if (number.kind == Kind::floating) return copy_as<double>(number, to);
        return is_signed ? copy_as<std::int64_t>(number, to) : copy_as<std::uint64_t>(number, to);
    }
  }

 private:
  std::size_t row_bytes() const { return in_row_ * H5Tget_size(type_.get()); }

  // Keeps rows for the other columns, which are asked for in turn.
  void keep(std::uint64_t first, std::size_t count) {
    if (first == first_ && count == count_) return;
    count_ = 0;
    rows_.resize(count * row_bytes());
    read(first, count, rows_.data());
    first_ = first;
    count_ = count;
  }

  void read(std::uint64_t first, std::size_t count, void* rows) const {
    const std::array<hsize_t, 2> begin{first, 0}, sides{count, in_row_};
    const Hdf5Handle in_memory(H5Screate_simple(in_row_ > 1 ? 2 : 1, sides.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space_.get(), H5S_SELECT_SET, begin.data(), nullptr, sides.data(), nullptr) < 0 ||
        H5Dread(dataset_, type_.get(), in_memory.get(), space_.get(), H5P_DEFAULT, rows) < 0)
      throw std::runtime_error(Hdf5Silence::last_error());
  }

  template <typename Stored, typename T>
  void copy_as(const Hdf5Number& number, std::span<T> to) const {
    const std::byte* at = rows_.data() + number.offset;
    const std::size_t step = row_bytes();
    for (T& value : to) {
      Stored stored;
      std::memcpy(&stored, at, sizeof stored);
      value = saturated<T>(stored);
      at += step;
    }
  }

  // As libhdf5 converts: what does not fit becomes the nearest number that does, and what is no number becomes 0.
  template <typename T, typename Stored>
  static T saturated(Stored stored) {
    if constexpr (std::is_same_v<T, std::int64_t> && std::is_floating_point_v<Stored>) {
      constexpr double kLimit = 9223372036854775808.0;  // 2^63
      const double number = stored;
      if (!(std::abs(number) < kLimit)) {
        if (std::isnan(number)) return 0;
        return number < 0 ? std::numeric_limits<T>::min() : std::numeric_limits<T>::max();
      }
    } else if constexpr (std::is_same_v<T, std::int64_t> && std::is_same_v<Stored, std::uint64_t>) {
      return static_cast<T>(std::min<std::uint64_t>(stored, std::numeric_limits<T>::max()));
    }
    return static_cast<T>(stored);
  }

  hid_t dataset_;
  Hdf5Handle space_, type_;
  hsize_t in_row_ = 1;  // numbers or compounds
  std::uint64_t first_ = 0;
  std::size_t count_ = 0;
  std::vector<std::byte> rows_;
};

}  // namespace evmarker::io
#endif
