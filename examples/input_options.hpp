#pragma once
// What a command line says about recordings that are read without a calibration.
#include <CLI/CLI.hpp>
#include <evmarker/io/event_reader.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "reader_options.hpp"
#include "recording_checks.hpp"

struct InputOptions {
  std::vector<int> size;
  ReaderOptions reader;

  void add_to(CLI::App& app) {
    app.add_option("--size", size,
                   "sensor of a recording that does not state it, as text and HDF5 may not: 640,480 [px]")
        ->delimiter(',')
        ->expected(2)
        ->allow_extra_args(false)  // which would be recordings
        ->check(CLI::Range(1, evmarker::SensorSize::kMaxSide));
    reader.add_to(app);
  }

  /// @throws std::runtime_error where it cannot be read, or states another size
  evmarker::io::EventReader open(const std::string& path) const {
    if (size.empty()) return recording_checks::open(path, std::nullopt, reader);
    const evmarker::SensorSize given{size[0], size[1]};
    evmarker::io::EventReader recording = recording_checks::open(path, given, reader);
    if (recording.sensor_size() != given)
      throw std::runtime_error(path + ": recorded with " + recording_checks::show(recording.sensor_size()) +
                               ", but --size says " + recording_checks::show(given));
    return recording;
  }
};
