#include "evmarker/opencv/aruco_shim.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <map>
#include <string>

using namespace evmarker;

namespace {

Eigen::Index distance(const CodeBits& a, const CodeBits& b) { return (a.array() != b.array()).count(); }

CodeBits turned(const CodeBits& bits) { return bits.transpose().rowwise().reverse(); }

}  // namespace

TEST_CASE("every dictionary has the size and the number of bits that its name says") {
  const std::map<std::string, std::pair<int, int>> others{
      {"DICT_ARUCO_ORIGINAL", {5, 1024}}, {"DICT_APRILTAG_16h5", {4, 30}},   {"DICT_APRILTAG_25h9", {5, 35}},
      {"DICT_APRILTAG_36h10", {6, 2320}}, {"DICT_APRILTAG_36h11", {6, 587}},
  };
  CHECK(opencv::kDictionaries.size() == 21);
  for (const auto& known : opencv::kDictionaries) {
    CAPTURE(known.first);
    const auto& [name, index] = known;
    const auto dictionary = opencv::make_dictionary(name);
    const auto other = others.find(std::string(name));
    // DICT_4X4_50: 4 bits, 50 markers.
    const int bits = other != others.end() ? other->second.first : name[5] - '0';
    const int size = other != others.end() ? other->second.second : std::stoi(std::string(name.substr(9)));
    CHECK(dictionary.markerSize == bits);
    CHECK(opencv::dictionary_size(dictionary) == size);
    const CodeBits code = opencv::marker_bits(dictionary, size - 1);
    CHECK(code.rows() == bits);
    CHECK(code.cols() == bits);
    CHECK(code.maxCoeff() <= 1);
  }
}

TEST_CASE("codes keep the distance that AprilTag's family names promise, in every rotation") {
  for (const auto& [name, promised] : {std::pair("DICT_APRILTAG_16h5", 5), std::pair("DICT_APRILTAG_25h9", 9)}) {
    const auto dictionary = opencv::make_dictionary(name);
    Eigen::Index least = 100;
    for (int a = 0; a < opencv::dictionary_size(dictionary); ++a)
      for (int b = 0; b < a; ++b) {
        CodeBits code = opencv::marker_bits(dictionary, b);
        for (int turn = 0; turn < 4; ++turn, code = turned(code))
          least = std::min(least, distance(opencv::marker_bits(dictionary, a), code));
      }
    CHECK(least == promised);
  }
}

TEST_CASE("the bits of marker 0 of DICT_4X4_50 are those printed everywhere") {
  CodeBits expected(4, 4);
  expected << 1, 0, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0;
  CHECK(opencv::marker_bits(opencv::make_dictionary("DICT_4X4_50"), 0) == expected);
}

TEST_CASE("an unknown dictionary is named, with those that exist") {
  std::string message;
  try {
    opencv::make_dictionary("DICT_9X9_50");
  } catch (const std::invalid_argument& error) {
    message = error.what();
  }
  CHECK(message.find("\"DICT_9X9_50\"") != std::string::npos);
  for (const auto& [name, index] : opencv::kDictionaries) CHECK(message.find(name) != std::string::npos);
  CHECK_THROWS_AS(opencv::make_dictionary(""), std::invalid_argument);
  CHECK_THROWS_AS(opencv::make_dictionary("dict_4x4_50"), std::invalid_argument);
}

TEST_CASE("an id beyond the dictionary is named, with the dictionary's size") {
  const auto dictionary = opencv::make_dictionary("DICT_4X4_50");
  CHECK_NOTHROW(opencv::marker_bits(dictionary, 49));
  for (const int id : {-1, 50, 1000}) {
    std::string message;
    try {
      opencv::marker_bits(dictionary, id);
    } catch (const std::invalid_argument& error) {
      message = error.what();
    }
    CHECK(message.find(std::string("id ").append(std::to_string(id))) != std::string::npos);
    CHECK(message.find("50 markers") != std::string::npos);
  }
}
