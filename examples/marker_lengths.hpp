#pragma once
// The lengths of markers on a command line: of all, or by id.
#include <CLI/CLI.hpp>
#include <evmarker/opencv/marker_lengths.hpp>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "console.hpp"

/// `--marker-length 0.10` for all markers, `--marker-length 3:0.05` for one, `--markers sizes.yml` for many.
class MarkerLengths {
 public:
  void add_to(CLI::App& app, const std::string& help) {
    app.add_option_function<std::vector<std::string>>(
           "--marker-length",
           [this](const std::vector<std::string>& words) {
             for (const std::string& word : words) add(word);
           },
           help + "; 3:0.05 is of marker 3 alone; may be given again")
        ->type_name("[ID:]METRES");
    app.add_option("--markers", file_, "lengths of many markers: a YAML file with the list markers: [{id, length}]")
        ->type_name("FILE");
  }

  /// Reads the file, if there is one.
  /// @throws std::runtime_error naming its fault
  /// @throws std::invalid_argument naming a marker whose length is also on the command line
  void load() {
    if (file_.empty()) return;
    for (const auto& [id, length] : evmarker::opencv::load_marker_lengths(file_)) {
      if (const std::string fault = console::marker_length_fault(length, evmarker::number_text(length)); !fault.empty())
        throw std::invalid_argument("--markers " + file_ + ": marker " + std::to_string(id) + ": " + fault);
      if (!own_.emplace(id, length).second)
        throw std::invalid_argument("--marker-length " + std::to_string(id) + ": the marker is also in --markers " +
                                    file_);
    }
  }

  bool empty() const { return common_ == 0 && own_.empty() && file_.empty(); }
  /// That of all markers that have none of their own [m]; 0: there is none.
  double common() const { return common_; }
  const std::map<int, double>& own() const { return own_; }
  const std::string& file() const { return file_; }

  /// @throws std::invalid_argument naming the marker that has none
  double of(int id) const {
    if (const auto own = own_.find(id); own != own_.end()) return own->second;
    if (common_ > 0) return common_;
    const std::string name = std::to_string(id);
    throw std::invalid_argument("--ids: marker " + name + " has no length: give --marker-length " + name + ":METRES");
  }

  /// The markers that have a length of their own.
  std::vector<int> ids() const {
    std::vector<int> ids;
    for (const auto& [id, length] : own_) ids.push_back(id);
    return ids;
  }

  /// For a program that need not be told: that of the markers for which there is none.
  void set_default(double length) {
    if (common_ == 0) common_ = length;
  }

 private:
  void add(const std::string& word) {
    const std::size_t colon = word.find(':');
    std::string metres = word.substr(colon == std::string::npos ? 0 : colon + 1);
    const auto fail = [&](const std::string& fault) { throw CLI::ValidationError("--marker-length " + word, fault); };
    if (const std::string fault = console::marker_length()(metres); !fault.empty()) fail(fault);
    double length = 0;
    CLI::detail::lexical_cast(metres, length);
    if (colon == std::string::npos) {
      if (common_ > 0) fail("a length of all markers is there twice; that of one marker is ID:METRES");
      common_ = length;
      return;
    }
    int id = 0;
    if (!CLI::detail::lexical_cast(word.substr(0, colon), id) || id < 0)
      fail("\"" + word.substr(0, colon) + "\" is no marker's id");
    if (!own_.emplace(id, length).second) fail("marker " + std::to_string(id) + " is there twice");
  }

  double common_ = 0;
  std::map<int, double> own_;
  std::string file_;
};
