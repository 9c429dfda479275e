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
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "evmarker/opencv/unsafe_text.hpp"
#include "evmarker/opencv/yaml_text.hpp"

namespace evmarker::opencv::detail {

// What a file of settings may be besides one document of named fields.
struct SettingsForms {
  std::string list{};           // the field as which a YAML file that is one list is read; empty: it is refused
  std::string numbers{};        // the field as which a file of nothing but numbers is read; empty: it is refused
  bool first_document = false;  // of several YAML documents, as of printed messages, the first one is read
};

// A YAML, XML or JSON file of named fields. All errors are std::runtime_error with one line: file, field, value.
class SettingsFile {
 public:
  // `kind` describes the file in errors.
  SettingsFile(std::string kind, const std::string& path, const SettingsForms& forms = {})
      : kind_(std::move(kind)), path_(path) {
    const std::string text = as_opencv_reads(read(), forms);
    if (const std::string reason = find_unsafe(text); !reason.empty()) fail(reason);
    try {
      // OpenCV requires the YAML directive, which ROS does not write.
      const bool yaml = text.front() != '{' && text.front() != '<' && text.compare(0, 5, "%YAML") != 0;
      const std::string head = text.compare(0, 3, "---") == 0 ? "%YAML:1.0\n" : "%YAML:1.0\n---\n";
      storage_.open(yaml ? head + text : text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
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

  // The map of all fields.
  cv::FileNode root() const { return storage_.root(); }

  int positive_integer(const std::string& field) const { return positive_integer(required(field), field); }

  // A whole number from 1 to 65536; `field` is the name of the node in errors.
  int positive_integer(const cv::FileNode& node, const std::string& field) const {
    const double value = number(node, field);
    if (!(value > 0 && value <= 65536 && value == std::floor(value)))
      fail(field + " is " + show(value) + ", not a positive whole number");
    return static_cast<int>(value);
  }

  std::string text(const std::string& field) const { return text(required(field), field); }

  std::string text(const cv::FileNode& node, const std::string& field) const {
    if (!node.isString()) fail(field + " is not a text");
    return static_cast<std::string>(node);
  }

  bool flag(const std::string& field) const { return flag(required(field), field); }

  // true or false, or a number: true unless it is 0. `field` is the name of the node in errors.
  bool flag(const cv::FileNode& node, const std::string& field) const {
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
    if (!node["data"].isSeq()) fail(field + " data is not a list of numbers");
    const std::vector<double> elements = numbers(node["data"], field);
    if (rows * columns != static_cast<double>(elements.size()))
      fail(field + " is said to be " + show(rows) + " x " + show(columns) + " but has " +
           std::to_string(elements.size()) + " elements");
    return elements;
  }

  // The elements of a list; `field` is the name of the node in errors.
  std::vector<double> numbers(const cv::FileNode& node, const std::string& field) const {
    if (!node.isSeq()) fail(field + " is not a list of numbers");
    std::vector<double> elements;
    for (const cv::FileNode& element : node)
      elements.push_back(number(element, field + "[" + std::to_string(elements.size()) + "]"));
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
  // The file is not read by FileStorage, which prints a message of its own if it cannot open it.
  std::string read() const {
    errno = 0;
    std::ifstream file(path_, std::ios::binary);
    std::ostringstream content;
    if (!file || !(content << file.rdbuf()))
      fail(errno == 0 ? "is empty" : "cannot be read: " + std::generic_category().message(errno));
    return content.str();
  }

  // The text from its first character that is not blank on, YAML without what OpenCV's parser refuses.
  std::string as_opencv_reads(const std::string& content, const SettingsForms& forms) const {
    std::string text = content.substr(std::min(content.find_first_not_of(" \t\r\n"), content.size()));
    if (text.empty()) fail("is empty");
    if (text.front() == '{' || text.front() == '<') return text;
    if (!forms.numbers.empty())
      if (const std::string numbers = listed_numbers(text); !numbers.empty()) return forms.numbers + ": " + numbers;
    if (forms.first_document) text = first_document(text);
    std::string yaml = plain_yaml(text);
    const std::size_t head = yaml.compare(0, 4, "---\n") == 0 ? 4 : 0;
    if (!forms.list.empty() && yaml.compare(head, 2, "- ") == 0)
      yaml = plain_yaml(forms.list + ":\n" + yaml.substr(head));
    if (yaml.empty()) fail("is empty");
    return yaml;
  }

  std::string kind_, path_;
  cv::FileStorage storage_;
};

}  // namespace evmarker::opencv::detail
