#include "evmarker/opencv/yaml_text.hpp"

#include <doctest/doctest.h>

#include <opencv2/core.hpp>
#include <string>

#include "evmarker/opencv/settings_file.hpp"
#include "settings_text.hpp"

using namespace evmarker;
using namespace evmarker::opencv::test;
using opencv::detail::plain_yaml;
using opencv::detail::SettingsFile;

TEST_CASE("YAML that OpenCV's parser reads stays as it is, but for comments and empty lines") {
  CHECK(plain_yaml("a: 1\nb:\n  - 2\n  - { c: 3, d: [4, 5] }\n") == "a: 1\nb:\n  - 2\n  - { c: 3, d: [4, 5] }\n");
  CHECK(plain_yaml("%YAML:1.0\n---\n# b\na: 1  # c\n\nd: x#y\n") == "%YAML:1.0\n---\na: 1\nd: x#y\n");
  CHECK(plain_yaml("a: 'it''s # no: [comment'\nb: \"\\\" # ,]\"\n") == "a: 'it''s # no: [comment'\nb: \"\\\" # ,]\"\n");
  CHECK(plain_yaml("a: don't [b\nc: 1\n") == "a: don't [b\nc: 1\n");
  CHECK(plain_yaml("").empty());
  CHECK(plain_yaml("# only\n").empty());
}

TEST_CASE("what stands in brackets becomes one line, without the comma behind the last element") {
  CHECK(plain_yaml("a:\n  [\n  {b: 1, # c\n c: [2,\n3 , ],\n   },\n]\nd: 1\n") ==
        "a:\n  [ {b: 1, c: [2, 3 ]}]\nd: 1\n");
  CHECK(plain_yaml("a: [\n") == "a: [\n");  // wrong, as it was
}

TEST_CASE("a list that is indented no more than its key is indented more, with all that is in it") {
  CHECK(plain_yaml("a:\n- b: 1\n  c:\n  - 2\n  - 3\n  d: 4\n- b: 5\ne: 6\n") ==
        "a:\n  - b: 1\n    c:\n      - 2\n      - 3\n    d: 4\n  - b: 5\ne: 6\n");
  CHECK(plain_yaml("a:\n  - 1\nb:\n- - 2\n  - 3\n") == "a:\n  - 1\nb:\n  - - 2\n    - 3\n");
}

TEST_CASE("words that begin with a digit, but are no numbers, get quotation marks") {
  CHECK(plain_yaml("a: 4X4_50 # b\nc: [2x2, 3 ]\n- 4d\n") == "a: \"4X4_50\"\nc: [\"2x2\", 3 ]\n- \"4d\"\n");
  CHECK(plain_yaml("a: 4\nb: 5.5e-3\nc: 0x1F\n7: 8\nd9: e9\n") == "a: 4\nb: 5.5e-3\nc: 0x1F\n7: 8\nd9: e9\n");
}

TEST_CASE("a file of settings is read as PyYAML and ROS write it") {
  const SettingsFile file("file",
                          write("s.yml", "a:\n- b: 1\n  c:\n  - 2\n  - 3\n- {b: 4, }\nd:\n  [\n    {e: 5},\n  ]\n"));
  CHECK(file.required("a").size() == 2);
  CHECK(static_cast<int>(file.required("a")[0]["c"][1]) == 3);
  CHECK(static_cast<int>(file.required("a")[1]["b"]) == 4);
  CHECK(static_cast<int>(file.required("d")[0]["e"]) == 5);
  CHECK_THROWS_AS(SettingsFile("file", write("s.yml", "- 1\n- 2\n")), std::runtime_error);
  const SettingsFile list("file", write("s.yml", "---\n- 1\n- 2\n"), {.list = "all"});
  CHECK(list.required("all").size() == 2);
}

TEST_CASE("the first of several documents ends before the next mark") {
  using opencv::detail::first_document;
  CHECK(first_document("a: 1\nb: 2\n---\na: 3\n---\n") == "a: 1\nb: 2\n");
  CHECK(first_document("# c\n%YAML 1.0\n---\n\na: 1\n...\n") == "# c\n%YAML 1.0\n---\n\na: 1\n");
  CHECK(first_document("a: --- b\n ---\n") == "a: --- b\n ---\n");
  CHECK(first_document("") == "");
  CHECK(first_document("---") == "---");
  // Where one document is expected, what follows it is refused: OpenCV's parser may never return from it.
  for (const char* documents : {"a: 1\n...\n}\n", "a: 1\n---\n}\n"}) {
    const std::string path = write("documents.yml", documents);
    CHECK_THROWS_AS(SettingsFile("test", path), std::runtime_error);
    CHECK(SettingsFile("test", path, {.first_document = true}).positive_integer("a") == 1);
  }
}

TEST_CASE("nothing but numbers is a list") {
  using opencv::detail::listed_numbers;
  CHECK(listed_numbers("1.5 -2e-3\t3,\r\n4\n") == "[1.5, -2e-3, 3, 4]\n");
  for (const char* other : {"", " \n", "a: 1\n", "1 2 three\n", "1: 2\n", "[1, 2]\n"})
    CHECK(listed_numbers(other).empty());
}
