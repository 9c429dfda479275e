#include "evmarker/opencv/marker_lengths.hpp"

#include <doctest/doctest.h>

#include <map>
#include <stdexcept>
#include <string>

#include "settings_text.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;

TEST_CASE("lengths of markers are read by id") {
  const std::string path = write("sizes.yml", "markers: [{ id: 3, length: 0.05 }, { length: 0.2, id: 0 }]\n");
  CHECK(opencv::load_marker_lengths(path) == std::map<MarkerId, double>{{0, 0.2}, {3, 0.05}});
}

TEST_CASE("a file without usable lengths is refused in one line with file, field and value") {
  const auto refused = [](const std::string& content, const std::string& expected) {
    const std::string path = write("sizes.yml", content);
    const std::string message = "marker lengths " + path + ": " + expected;
    CHECK_THROWS_WITH_AS(opencv::load_marker_lengths(path), message.c_str(), std::runtime_error);
  };
  refused("sizes: 3\n", "no field markers");
  refused("markers: 3\n", "markers is not a list of maps of id and length");
  refused("markers: [4]\n", "markers[0] is not a map of id and length");
  refused("markers: [{ id: 3 }]\n", "markers[0] has no field length");
  refused("markers: [{ id: -3, length: 1 }]\n", "markers[0] id is -3, not a whole number from 0 on");
  refused("markers: [{ id: 3, length: 0 }]\n", "markers[0]: marker 3 has length 0, not positive");
  refused("markers: [{ id: 3, length: wide }]\n", "markers[0] length is \"wide\", not a number");
  refused("markers: [{ id: 3, length: 1 }, { id: 3, length: 1 }]\n", "markers[1]: marker 3 is there twice");
}
