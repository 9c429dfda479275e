#pragma once
// HDF5 recordings as a source of events, where the build has libhdf5: with the component `hdf5`.
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/collecting_reader.hpp"
#include "evmarker/io/hdf5_handle.hpp"
#include "evmarker/io/hdf5_layout.hpp"
#include "evmarker/io/hdf5_triggers.hpp"
#include "evmarker/io/layout_guess.hpp"
#include "evmarker/io/packed_events.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/text_layout.hpp"
#include "evmarker/io/time_unit.hpp"

namespace evmarker::io {

struct Hdf5ReaderOptions : RecordingOptions {
  /// Unit of the times, in the place of what the file names or its first events show.
  std::optional<TimeUnit> time_unit = std::nullopt;
  /// Once it is true, the recording ends.
  const std::atomic<bool>* stop = nullptr;
};

#ifdef EVMARKER_HAS_HDF5

/// Reads HDF5 recordings of Prophesee, with triggers, of DSEC, MVSEC and others with columns or members x, y, t and p,
/// piece by piece. libhdf5 may be used by one thread at a time.
///
/// Times are in the unit of their name or of their attribute `units`, else whole numbers are microseconds and others
/// seconds, unless the first events show another unit; `t_offset`, as of DSEC, is added to them.
class Hdf5Reader final : public CollectingReader {
 public:
  /// @throws RecordingError where the file is missing or damaged, has no events, or needs a filter that is not there
  explicit Hdf5Reader(const std::filesystem::path& path, const Hdf5ReaderOptions& options = {})
      : CollectingReader(path, options), path_(path), stop_(options.stop) {
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
      throw RecordingError(path, "HDF5 recordings are read from files alone, not from pipes");
    bytes_total_ = std::filesystem::file_size(path, error);
    const Hdf5Silence silence;
    file_ = Hdf5Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    if (!file_)
      throw RecordingError(path, "cannot be read as HDF5, missing, cut off or damaged: " + Hdf5Silence::last_error());
    try {
      events_ = find_hdf5_events(file_.get());
      rows_ = events_.columns.front().rows();
      if (events_.path == "/CD/events") triggers_ = Hdf5Triggers(file_.get());
      has_float_times_ = times().is_float();
      offset_ = hdf5_number(file_.get(), "t_offset").value_or(0);
      collector_.set_sensor_size(
          choose_sensor_size(hdf5_sensor_size(file_.get()), options, SensorSize::kMaxSide, "HDF5", path));
      unit_ = recognize_unit(options.time_unit);
      microseconds_each_ = std::pow(10, places_to_microseconds(unit_));
      times_are_microseconds_ = unit_ == TimeUnit::microseconds && offset_ == 0 && !has_float_times_;
    } catch (const RecordingError&) {
      throw;
    } catch (const std::runtime_error& fault) {
      throw RecordingError(path, fault.what());
    }
  }

  /// An estimate: the size of the file times the share of its events that were read.
  std::uint64_t bytes_read() const override {
    if (row_ == rows_) return bytes_total_;
    return static_cast<std::uint64_t>(static_cast<double>(bytes_total_) * static_cast<double>(row_) /
                                      static_cast<double>(rows_));
  }
  std::uint64_t bytes_total() const override { return bytes_total_; }

 private:
  static constexpr std::uint64_t kRows = 16384;  // in a piece, which stays in the cache

  static constexpr std::size_t kX = Hdf5Events::kX, kY = Hdf5Events::kY, kP = Hdf5Events::kP, kT = Hdf5Events::kT;

  const Hdf5Column& times() const noexcept { return events_.columns[kT]; }

  TimeUnit recognize_unit(std::optional<TimeUnit> asked) const {
    if (!asked && events_.time_unit) return *events_.time_unit;
    std::vector<double> first(static_cast<std::size_t>(std::min<std::uint64_t>(rows_, 1000)));
    times().read(0, std::span(first));
    if (!std::ranges::all_of(first, [](double t) { return std::isfinite(t); }))
      throw std::runtime_error(events_.path + ": not all times are numbers");
    const std::string name_it = ": name it, --time-unit s|ms|us|ns (in the options: time_unit)";
    if (asked)
      if (const std::string fault = detail::unit_fault(first, *asked, collector_.sensor_size()); !fault.empty())
        throw std::runtime_error(fault + name_it);
    if (asked) return *asked;
    const bool whole = std::ranges::all_of(first, [](double t) { return t == std::floor(t); });
    const auto customary = whole ? TimeUnit::microseconds : TimeUnit::seconds;
    constexpr std::size_t kFew = 100;  // fewer have no meaningful rate
    if (first.size() < kFew) return customary;
    std::ranges::sort(first);
    const auto units = detail::plausible_units(first, collector_.sensor_size());
    if (units.empty() || std::ranges::find(units, customary) != units.end()) return customary;
    if (units.size() == 1) return units[0];
    throw std::runtime_error("cannot tell the unit of its times" + name_it);
  }

  bool read_piece() override {
    const Hdf5Silence silence;
    if (stop_ != nullptr && *stop_) return false;
    if (row_ == rows_) {
      add_triggers(std::numeric_limits<Timestamp>::max());
      return false;
    }
    const auto count = static_cast<std::size_t>(std::min(rows_ - row_, kRows));
    if (events_.whole && times_are_microseconds_ && trigger_due(std::numeric_limits<Timestamp>::max()) == nullptr) {
      read_whole(count);
      return true;
    }
    for (std::vector<std::int64_t>& column : numbers_) column.resize(count);
    if (has_float_times_) float_times_.resize(count);
    read([&] {
      for (const std::size_t column : {kX, kY, kP}) events_.columns[column].read(row_, std::span(numbers_[column]));
      if (has_float_times_)
        times().read(row_, std::span(float_times_));
      else
        times().read(row_, std::span(numbers_[kT]));
    });
    for (std::size_t begin = 0; begin < count;) {
      const std::size_t end = read_times(begin, count);
      collector_.add_each(end - begin, [&](std::size_t i) {
        return packed_event(coordinate(numbers_[kX][begin + i]), coordinate(numbers_[kY][begin + i]),
                            numbers_[kP][begin + i] > 0, numbers_[kT][begin + i]);
      });
      begin = end;
    }
    return true;
  }

  // Reads events that are stored as they are in memory.
  void read_whole(std::size_t count) {
    read([&] { events_.whole->read(row_, collector_.room(count)); });
    collector_.add_filled(count);
    row_ += count;
  }

  template <typename Read>
  void read(const Read& read_rows) const {
    try {
      read_rows();
    } catch (const std::runtime_error& fault) {
      throw RecordingError(
          path_, events_.path + ": cannot be read from event " + std::to_string(row_) + " on: " + fault.what());
    }
  }

  // What 16 bits cannot hold becomes 65535, which is off every sensor.
  static std::uint64_t coordinate(std::int64_t number) {
    return std::min(static_cast<std::uint64_t>(number), std::uint64_t{0xFFFF});
  }

  // Makes microseconds of the times of the events until the next trigger is due, which it adds where it is due first.
  // Returns the end of these events: of a time that is no microseconds, those before come before its error.
  std::size_t read_times(std::size_t begin, std::size_t count) {
    std::size_t at = begin;
    if (times_are_microseconds_ && trigger_due(std::numeric_limits<Timestamp>::max()) == nullptr) {
      row_ += count - begin;
      return count;
    }
    try {
      for (; at < count; ++at, ++row_) {
        const Timestamp t = has_float_times_ ? from_float(float_times_[at]) : from_whole(numbers_[kT][at]);
        if (trigger_due(t) != nullptr) {
          if (at > begin) return at;
          add_triggers(t);
        }
        numbers_[kT][at] = t;
      }
    } catch (const RecordingError&) {
      if (at == begin) throw;
    }
    return at;
  }

  // The next trigger if it is due at a time: the file has them apart from the events.
  const TriggerEvent* trigger_due(Timestamp t) {
    try {
      const TriggerEvent* const trigger = triggers_.next();
      return trigger != nullptr && trigger->t <= t ? trigger : nullptr;
    } catch (const std::runtime_error& fault) {
      throw RecordingError(path_, fault.what());
    }
  }

  void add_triggers(Timestamp until) {
    while (const TriggerEvent* const trigger = trigger_due(until)) {
      collector_.add(*trigger);
      triggers_.skip();
    }
  }

  Timestamp from_float(double t) const {
    const double microseconds = std::round(t * microseconds_each_);
    if (!(std::abs(microseconds) < 9e18)) fail(std::to_string(t));
    return with_offset(static_cast<Timestamp>(microseconds));
  }

  Timestamp from_whole(std::int64_t t) const {
    constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
    std::int64_t factor = 1;
    for (int places = std::abs(places_to_microseconds(unit_)); places > 0; --places) factor *= 10;
    if (unit_ == TimeUnit::nanoseconds) return with_offset(t / factor);
    if (t > kMost / factor || t < -(kMost / factor)) fail(std::to_string(t));
    return with_offset(t * factor);
  }

  // DSEC's offset is in microseconds.
  Timestamp with_offset(Timestamp t) const {
    const auto sum = static_cast<Timestamp>(static_cast<std::uint64_t>(t) + static_cast<std::uint64_t>(offset_));
    if ((sum < t) != (offset_ < 0)) fail(std::to_string(t) + " + t_offset " + std::to_string(offset_));
    return sum;
  }

  [[noreturn]] void fail(const std::string& t) const {
    throw RecordingError(path_, events_.path + ": t of event " + std::to_string(row_) + " is " + t +
                                    ", no time that microseconds can express");
  }

  std::filesystem::path path_;
  const std::atomic<bool>* stop_;
  Hdf5Handle file_;
  Hdf5Events events_;
  Hdf5Triggers triggers_;
  std::uint64_t rows_ = 0, row_ = 0, bytes_total_ = 0;
  bool has_float_times_ = false;
  TimeUnit unit_ = TimeUnit::microseconds;
  double microseconds_each_ = 1;                      // of a unit
  bool times_are_microseconds_ = true;                // as they are in the file
  std::int64_t offset_ = 0;                           // [us]
  std::array<std::vector<std::int64_t>, 4> numbers_;  // of the last piece, by column
  std::vector<double> float_times_;                   // its times instead, if the file has them as floating point
};

#endif

/// @throws RecordingError as Hdf5Reader, or where this build leaves it out
inline std::unique_ptr<RecordingReader> open_hdf5(const std::filesystem::path& path,
                                                  [[maybe_unused]] const Hdf5ReaderOptions& options) {
#ifdef EVMARKER_HAS_HDF5
  return std::make_unique<Hdf5Reader>(path, options);
#else
  throw without_hdf5(path);
#endif
}

}  // namespace evmarker::io
