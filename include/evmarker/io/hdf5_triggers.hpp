#pragma once
// Prophesee's triggers in an HDF5 file, read piece by piece. Empty without the component `hdf5`.
#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/hdf5_column.hpp"
#include "evmarker/io/hdf5_handle.hpp"

namespace evmarker::io {

/// The triggers of the dataset `EXT_TRIGGER/events`, compounds of the level p, the time t [us] and the input id.
class Hdf5Triggers {
 public:
  Hdf5Triggers() = default;
  /// None where the file has no such dataset.
  /// @throws std::runtime_error where it has one that cannot be read
  explicit Hdf5Triggers(hid_t file) {
    if (H5Lexists(file, "EXT_TRIGGER", H5P_DEFAULT) <= 0 || H5Lexists(file, kPath, H5P_DEFAULT) <= 0) return;
    with_path([&] {
      const auto dataset = Hdf5Column::open(file, kPath);
      const Hdf5Handle type(H5Dget_type(dataset->get()), H5Tclose);
      for (const char* member : {"p", "t", "id"}) {
        if (H5Tget_class(type.get()) != H5T_COMPOUND || H5Tget_member_index(type.get(), member) < 0)
          throw std::runtime_error(std::string("it has no member ") + member + ", must have p, t and id");
        columns_.emplace_back(dataset, member, std::nullopt);
      }
      rows_ = columns_[0].rows();
    });
  }

  /// The first trigger that was not passed yet; null behind the last one.
  /// @throws std::runtime_error where it cannot be read
  const TriggerEvent* first() {
    if (at_ == piece_.size() && row_ < rows_) read_piece();
    return at_ < piece_.size() ? &piece_[at_] : nullptr;
  }
  void pass() noexcept { ++at_; }

 private:
  static constexpr const char* kPath = "EXT_TRIGGER/events";
  static constexpr std::uint64_t kRows = 4096;

  template <typename Read>
  static void with_path(const Read& read) {
    try {
      read();
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(std::string("/") + kPath + ": " + error.what());
    }
  }

  void read_piece() {
    const auto count = static_cast<std::size_t>(std::min(rows_ - row_, kRows));
    std::array<std::vector<std::int64_t>, 3> numbers;
    with_path([&] {
      for (std::size_t column = 0; column < 3; ++column) {
        numbers[column].resize(count);
        columns_[column].read(row_, std::span(numbers[column]));
      }
      for (const std::int64_t id : numbers[2])
        if (id < 0 || id > std::numeric_limits<std::int16_t>::max())
          throw std::runtime_error("id is " + std::to_string(id) + ", not the number of an input");
    });
    piece_.clear();
    for (std::size_t i = 0; i < count; ++i)
      piece_.push_back({static_cast<int>(numbers[2][i]), numbers[0][i] > 0, numbers[1][i]});
    row_ += count;
    at_ = 0;
  }

  std::vector<Hdf5Column> columns_;  // p, t, id
  std::uint64_t rows_ = 0, row_ = 0;
  std::vector<TriggerEvent> piece_;
  std::size_t at_ = 0;
};

}  // namespace evmarker::io
#endif
