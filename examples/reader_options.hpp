#pragma once
// What a command line says about a recording that the recording itself leaves open.
#include <CLI/CLI.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/recording_error.hpp>
#include <evmarker/io/text_layout.hpp>
#include <optional>
#include <string>

#include "interruption.hpp"

struct ReaderOptions {
  std::string topic, columns, time_unit;

  void add_to(CLI::App& app) {
    app.add_option("--topic", topic, "of a ROS recording: whose events to read; default: the only one that has events");
    app.add_option("--columns", columns,
                   "order of a text recording's columns, as t,x,y,p, with - for any other; default: recognised");
    app.add_option("--time-unit", time_unit, "of a recording in text or HDF5: s, ms, us or ns; default: recognised")
        ->check(CLI::IsMember({"s", "ms", "us", "ns"}));
  }

  /// @throws evmarker::io::RecordingError for an option that says nothing of such a recording
  void require_meaning(evmarker::io::RecordingKind kind, const std::string& path) const {
    using enum evmarker::io::RecordingKind;
    const auto require = [&](bool meant, const char* option, const std::string& what_for) {
      if (!meant)
        throw evmarker::io::RecordingError(
            path, "is " + std::string(to_string(kind)) + ", but " + option + " is for " + what_for);
    };
    require(topic.empty() || kind == mcap || kind == rosbag || kind == rosbag2, "--topic", "ROS recordings");
    require(columns.empty() || kind == text, "--columns", "text");
    require(time_unit.empty() || kind == text || kind == hdf5, "--time-unit", "text and HDF5");
  }

  /// For a recording that ends when the program is interrupted.
  /// @param size of its sensor, where it does not tell
  evmarker::io::EventReaderOptions options(std::optional<evmarker::SensorSize> size) const {
    return {.sensor_size = size,
            .topic = topic,
            .text_layout = {.columns = columns, .time_unit = evmarker::io::time_unit_named(time_unit)},
            .stop = &interruption::requested};
  }
};
