#pragma once
// The events of an HDF5 dataset that Prophesee's ECF compresses, decoded by ourselves. Empty without the component
// `hdf5`.
#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/ecf.hpp"
#include "evmarker/io/hdf5_handle.hpp"

namespace evmarker::io {

/// Reads compounds x, y, p, t in chunks of ECF. The chunks are taken from libhdf5 as they are stored: a filter would be
/// the whole process's, and those of others trust what a chunk says of itself.
class Hdf5Ecf {
 public:
  static constexpr H5Z_filter_t kFilter = 0x8ECF;

  /// @param dataset compressed by ECF, which must outlive this
  /// @throws std::runtime_error where its chunks are not those of events
  explicit Hdf5Ecf(hid_t dataset) : dataset_(dataset) {
    const Hdf5Handle creation(H5Dget_create_plist(dataset), H5Pclose);
    hsize_t chunk_rows = 0;
    if (H5Pget_nfilters(creation.get()) != 1 || H5Pget_chunk(creation.get(), 1, &chunk_rows) != 1)
      throw std::runtime_error("it is compressed by more than Prophesee's ECF");
    if (chunk_rows > kMaxEcfEvents)
      throw std::runtime_error("its chunks have " + std::to_string(chunk_rows) + " events, of which ECF has at most " +
                               std::to_string(kMaxEcfEvents));
    chunk_rows_ = chunk_rows;
  }

  /// Reads the events of `to.size()` rows from `first` on, all of which the dataset has.
  /// @throws std::runtime_error naming a chunk that cannot be decoded
  void read(std::uint64_t first, std::span<Event> to) { std::ranges::copy(rows(first, to.size()), to.begin()); }

  /// Reads a member of the events of `to.size()` rows from `first` on, all of which the dataset has.
  /// @throws std::runtime_error naming the member where it is none of x, y, p, t, or a chunk that cannot be decoded
  template <typename T>
  void read(std::string_view member, std::uint64_t first, std::span<T> to) {
    const std::span<const Event> events = rows(first, to.size());
    const auto copy = [&](auto value_of) {
      std::ranges::transform(events, to.begin(), [&](const Event& e) { return static_cast<T>(value_of(e)); });
    };
    if (member == "x") return copy([](const Event& e) { return e.x; });
    if (member == "y") return copy([](const Event& e) { return e.y; });
    if (member == "p") return copy([](const Event& e) { return e.p; });
    if (member == "t") return copy([](const Event& e) { return e.t; });
    throw std::runtime_error("Prophesee's ECF compresses it, which has no " + std::string(member));
  }

 private:
  // Most bytes that an event takes: a long step of time, its run, row, column and polarity, each alone.
  static constexpr std::uint64_t kMaxEventBytes = 32;

  // All four members of a row may be asked for in turn, which is why the events of the last rows are kept.
  std::span<const Event> rows(std::uint64_t first, std::size_t count) {
    if (first < first_ || first + count > first_ + events_.size()) decode(first, first + count);
    return std::span(events_).subspan(static_cast<std::size_t>(first - first_), count);
  }

  void decode(std::uint64_t first, std::uint64_t end) {
    events_.clear();
    first_ = first / chunk_rows_ * chunk_rows_;
    for (std::uint64_t row = first_; row < end; row += chunk_rows_) {
      try {
        decode_ecf(chunk(row), events_);
        if (events_.size() != row + chunk_rows_ - first_) throw std::runtime_error("garbled: not all events are in it");
      } catch (const std::runtime_error& error) {
        events_.clear();
        throw std::runtime_error("the chunk of event " + std::to_string(row) + ": " + error.what());
      }
    }
  }

  // The bytes of the chunk that begins with a row.
  std::span<const std::byte> chunk(hsize_t row) {
    hsize_t bytes = 0;
    std::uint32_t left_out = 0;  // filters
    if (H5Dget_chunk_storage_size(dataset_, &row, &bytes) < 0 || bytes == 0) throw std::runtime_error("it is missing");
    if (bytes > kMaxEventBytes * (chunk_rows_ + 1)) throw std::runtime_error("garbled: it has too many bytes");
    bytes_.resize(static_cast<std::size_t>(bytes));
    if (H5Dread_chunk(dataset_, H5P_DEFAULT, &row, &left_out, bytes_.data()) < 0)
      throw std::runtime_error(Hdf5Silence::last_error());
    if (left_out != 0) throw std::runtime_error("garbled: it is not compressed");
    return bytes_;
  }

  hid_t dataset_;
  std::uint64_t chunk_rows_ = 0;
  std::uint64_t first_ = 0;       // row of the first event that is decoded
  std::vector<Event> events_;     // that are decoded
  std::vector<std::byte> bytes_;  // of a chunk
};

}  // namespace evmarker::io
#endif
