#pragma once
// What a command line says about recordings that are text.
#include <CLI/CLI.hpp>
#include <evmarker/io/text_layout.hpp>
#include <string>

struct TextOptions {
  std::string columns, time_unit;

  void add_to(CLI::App& app) {
    app.add_option("--columns", columns,
                   "order of a text recording's columns, as t,x,y,p, with - for any other; default: recognised");
    app.add_option("--time-unit", time_unit, "of a recording in text or HDF5: s, ms, us or ns; default: recognised")
        ->check(CLI::IsMember({"s", "ms", "us", "ns"}));
  }

  evmarker::io::TextLayout layout() const {
    return {.columns = columns, .time_unit = evmarker::io::time_unit_named(time_unit)};
  }
};
