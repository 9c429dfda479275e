#pragma once
// Recordings as iterators of arrays.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <evmarker/io/event_reader.hpp>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

namespace python {

namespace py = pybind11;

/// Width and height [px].
using Size = std::pair<int, int>;

/// The next batch of a source as an array of its own; the end of the iteration where there is none. Calls from several
/// threads wait for each other; the interpreter is locked only to make the array.
template <typename Source>
py::array_t<evmarker::Event> next_array(Source& source, std::mutex& mutex) {
  const py::gil_scoped_release unlocked;
  const std::scoped_lock lock(mutex);
  const std::span<const evmarker::Event> batch = source.next_batch();
  const py::gil_scoped_acquire locked;
  if (batch.empty()) throw py::stop_iteration();
  return py::array_t<evmarker::Event>(static_cast<py::ssize_t>(batch.size()), batch.data());
}

struct ReaderOptions {
  std::optional<Size> sensor_size;
  std::string topic, columns, time_unit;
};

class Reader {
 public:
  /// @throws evmarker::io::RecordingError where it cannot be read
  /// @throws std::invalid_argument naming an option, also where the recording states another size
  Reader(const std::string& path, const ReaderOptions& options) : reader_(path, reader_options(options)) {
    const evmarker::SensorSize size = reader_.sensor_size();
    if (options.sensor_size && Size(size.width, size.height) != *options.sensor_size)
      throw std::invalid_argument(path + ": recorded with " + show({size.width, size.height}) +
                                  ", but sensor_size says " + show(*options.sensor_size));
  }

  py::array_t<evmarker::Event> next() { return next_array(reader_, mutex_); }
  Size sensor_size() const { return {reader_.sensor_size().width, reader_.sensor_size().height}; }
  std::string format() const { return reader_.format(); }
  evmarker::io::RecordingStatistics statistics() {
    const py::gil_scoped_release unlocked;
    const std::scoped_lock lock(mutex_);
    return reader_.statistics();
  }

 private:
  static std::string show(const Size& size) {
    return std::to_string(size.first) + " x " + std::to_string(size.second) + " px";
  }

  static evmarker::io::EventReaderOptions reader_options(const ReaderOptions& options) {
    evmarker::io::EventReaderOptions result{.topic = options.topic, .text_layout = {.columns = options.columns}};
    if (options.sensor_size)
      result.sensor_size = evmarker::SensorSize{options.sensor_size->first, options.sensor_size->second};
    result.text_layout.time_unit = evmarker::io::time_unit_named(options.time_unit);
    if (!options.time_unit.empty() && !result.text_layout.time_unit)
      throw std::invalid_argument("time_unit is \"" + options.time_unit + "\", not s, ms, us or ns");
    return result;
  }

  std::mutex mutex_;
  evmarker::io::EventReader reader_;
};

}  // namespace python
