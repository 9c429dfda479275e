#pragma once
// Reading of files of named fields with OpenCV's FileStorage; errors name file, field and value.
#include <Eigen/Core>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <exception>
#include <fstream>
#include <opencv2/core.hpp>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace evmarker::opencv::detail {

// A bound of how deep a text is nested. Brackets or tags go deeper where they open; in YAML, so may each blank of an
// indentation, each dash of a list and each key on the way to a value.
inline std::size_t nesting_bound(std::string_view text, bool xml) {
  std::size_t open = 0, in_line = 0, bound = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i], next = i + 1 < text.size() ? text[i + 1] : '\n';
    const bool opens = xml ? c == '<' && next != '/' && next != '?' && next != '!' : c == '[' || c == '{';
    const bool closes = xml ? (c == '<' && next == '/') || (c == '/' && next == '>') : c == ']' || c == '}';
    if (opens) ++open;
    if (closes && open > 0) --open;
    if (c == ',' || c == '\n') in_line = 0;
    if (!xml && (c == ' ' || c == '\t' || c == '-' || c == ':')) ++in_line;
    bound = std::max(bound, open + in_line);
  }
  return bound;
}

// A YAML, XML or JSON file of named fields. All errors are std::runtime_error with one line: file, field, value.
class SettingsFile {
 public:
  // `kind` describes the file in errors.
  SettingsFile(std::string kind, const std::string& path) : kind_(std::move(kind)), path_(path) {
    // The file is not read by FileStorage, which prints a message of its own if it cannot open it.
    errno = 0;
    std::ifstream file(path, std::ios::binary);
    std::ostringstream content;
    if (!file || !(content << file.rdbuf()))
      fail(errno == 0 ? "is empty" : "cannot be read: " + std::generic_category().message(errno));
    std::string text = content.str();
    const auto first = text.find_first_not_of(" \t\r\n");
    if (first == std::string::npos) fail("is empty");
    refuse_unsafe(std::string_view(text).substr(first));
    // OpenCV requires the YAML directive, which ROS does not write.
    if (text.compare(first, 5, "%YAML") != 0 && text[first] != '{' && text[first] != '<')
      text = "%YAML:1.0\n" + std::string(text.compare(first, 3, "---") == 0 ? "" : "---\n") + text.substr(first);
    try {
      storage_.open(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    } catch (const std::exception&) {  // not only OpenCV's own: an empty name is a std::length_error
      fail("is neither YAML, XML nor JSON that OpenCV can read");
    }
    if (!storage_.isOpened() || !storage_.root().isMap()) fail("is neither YAML, XML nor JSON with named fields");
  }

  // Throws an error about the file.
  [[noreturn]] void fail(const std::string& reason) const {
    throw std::runtime_error(kind_ + " " + path_ + ": " + reason);
  }

  bool has(const std::string& field) const { return !storage_[field].empty(); }

  // A whole number from 1 to 65536.
  int positive_integer(const std::string& field) const {
    const double value = number(required(field), field);
    if (!(value > 0 && value <= 65536 && value == std::floor(value)))
      fail(field + " is " + show(value) + ", not a positive whole number");
    return static_cast<int>(value);
  }

  std::string text(const std::string& field) const {
    const cv::FileNode node = required(field);
    if (!node.isString()) fail(field + " is not a text");
    return static_cast<std::string>(node);
  }

  // true or false, or a number: true unless it is 0.
  bool flag(const std::string& field) const {
    const cv::FileNode node = required(field);
    if (node.isString()) {
      const std::string word = static_cast<std::string>(node);
      if (word != "true" && word != "false") fail(field + " is \"" + word + "\", not true or false");
      return word == "true";
    }
    return number(node, field) != 0;
  }

  // The elements of a matrix, row by row. ROS does not write the tag by which OpenCV would recognise a matrix.
  std::vector<double> matrix(const std::string& field) const {
    const cv::FileNode node = required(field);
    if (!node.isMap() || node["rows"].empty() || node["cols"].empty() || node["data"].empty())
      fail(field + " is not a matrix (rows, cols, data)");
    const double rows = number(node["rows"], field + " rows"), columns = number(node["cols"], field + " cols");
    std::vector<double> elements;
    if (!node["data"].isSeq()) fail(field + " data is not a list of numbers");
    for (const cv::FileNode& element : node["data"])
      elements.push_back(number(element, field + "[" + std::to_string(elements.size()) + "]"));
    if (rows * columns != static_cast<double>(elements.size()))
      fail(field + " is said to be " + show(rows) + " x " + show(columns) + " but has " +
           std::to_string(elements.size()) + " elements");
    return elements;
  }

  static std::string show(double value) {
    std::ostringstream out;
    out << value;
    return out.str();
  }

  // A field that must be there.
  cv::FileNode required(const std::string& field) const {
    if (!has(field)) fail("no field " + field);
    return storage_[field];
  }

  // A field of a map in the file; `place` is the name of the map in errors.
  cv::FileNode field(const cv::FileNode& map, const std::string& place, const char* name) const {
    const cv::FileNode node = map[name];
    if (node.empty()) fail(place + " has no field " + name);
    return node;
  }

  // Three numbers; `field` is the name of the node in errors.
  Eigen::Vector3d vector(const cv::FileNode& node, const std::string& field) const {
    if (!node.isSeq() || node.size() != 3) fail(field + " is not a list of 3 numbers");
    Eigen::Vector3d vector;
    for (int i = 0; i < 3; ++i) vector(i) = number(node[i], field + "[" + std::to_string(i) + "]");
    return vector;
  }

  // A whole number from 0 to 1e9; `field` is the name of the node in errors.
  int whole_number(const cv::FileNode& node, const std::string& field) const {
    const double value = number(node, field);
    if (!(value >= 0 && value <= 1e9 && value == std::floor(value)))
      fail(field + " is " + show(value) + ", not a whole number from 0 on");
    return static_cast<int>(value);
  }

  // A finite number; `field` is the name of the node in errors.
  double number(const cv::FileNode& node, const std::string& field) const {
    if (!node.isInt() && !node.isReal())
      fail(field + " is " + (node.isString() ? "\"" + static_cast<std::string>(node) + "\", " : "") + "not a number");
    const double value = static_cast<double>(node);
    if (!std::isfinite(value)) fail(field + " is " + show(value) + ", not a finite number");
    return value;
  }

 private:
  // OpenCV's parsers are made for what programs write: damaged files may crash them or keep them for ever. What a
  // fuzzer has found of this kind is refused. `text` begins with its first character that is not blank.
  void refuse_unsafe(std::string_view text) const {
    const bool xml = text.front() == '<', json = text.front() == '{';
    const std::string_view content = text.substr(0, text.find_last_not_of(" \t\r\n") + 1);
    // At a byte 0 some parsers end, and others read on behind the end.
    if (text.find('\0') != std::string_view::npos) fail("is neither YAML, XML nor JSON: it has a byte 0");
    // The parsers call themselves for each level, and 30 000 of them overflow the stack.
    constexpr std::size_t kMostLevels = 1000;
    if (nesting_bound(text, xml) > kMostLevels)
      fail("is nested more than " + std::to_string(kMostLevels) + " levels deep: not a file of settings");
    // The parser of XML reads on behind the end of what is cut off.
    if (xml && !content.ends_with("</opencv_storage>")) fail("is cut off: it does not end with </opencv_storage>");
    // The parsers may never return from data in base 64 that are none.
    for (const std::string_view mark : {"!!binary", "\"binary\"", "$base64$"})
      if (text.find(mark) != std::string_view::npos)
        fail("has binary data (" + std::string(mark) + "), which is not read");
    // Nor does that of YAML from what follows a root in brackets, or a document.
    if (!xml && !json && !begins_with_field(content)) fail("is neither YAML, XML nor JSON with named fields");
  }

  // True if a YAML file is one document whose first line, behind directives and comments, names a field, and no other
  // is indented less.
  static bool begins_with_field(std::string_view text) {
    std::optional<std::size_t> indentation;
    bool begun = false;
    while (!text.empty()) {
      const std::string_view line = text.substr(0, text.find('\n'));
      text.remove_prefix(std::min(line.size() + 1, text.size()));
      if (line.starts_with("...") || (begun && line.starts_with("---"))) return false;
      const auto at = line.find_first_not_of(" \t\r");
      if (at == std::string_view::npos || line[at] == '#' || (!indentation && line[at] == '%')) continue;
      if (indentation && at < *indentation) return false;
      if (indentation) continue;
      const bool begins_document = !std::exchange(begun, true) && line.starts_with("---");
      if (begins_document && line.find_first_not_of(" \t\r", 3) == std::string_view::npos) continue;
      if (line[at] == '[' || line[at] == '{' || line[at] == '-') return false;
      indentation = at;
    }
    return indentation.has_value();
  }

  std::string kind_, path_;
  cv::FileStorage storage_;
};

}  // namespace evmarker::opencv::detail
