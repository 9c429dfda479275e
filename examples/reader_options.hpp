#pragma once
// What a command line says about a recording that the recording itself leaves open.
#include <CLI/CLI.hpp>
#include <evmarker/io/event_reader.hpp>
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

  /// For a recording that ends when the program is interrupted.
  /// @param size of its sensor, where it does not tell
  evmarker::io::EventReaderOptions options(std::optional<evmarker::SensorSize> size) const {
    return {.sensor_size = size,
            .topic = topic,
            .text_layout = {.columns = columns, .time_unit = evmarker::io::time_unit_named(time_unit)},
            .stop = &interruption::requested};
  }
};
