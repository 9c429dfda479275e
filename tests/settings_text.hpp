#pragma once
// What the tests of calibration and board files share.
#include <doctest/doctest.h>

#include <string>

#include "io/test_support.hpp"

namespace evmarker::opencv::test {

/// A path for this process alone: the cases of one test run side by side.
inline std::string temporary(const std::string& name) {
  static const io::test::TemporaryFolder folder;
  return (folder / name.c_str()).string();
}

inline std::string write(const std::string& name, const std::string& content) {
  return io::test::write_file(temporary(name), content).string();
}

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

}  // namespace evmarker::opencv::test
