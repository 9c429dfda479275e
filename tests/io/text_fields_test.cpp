#include "evmarker/io/text_fields.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <limits>

using evmarker::io::detail::parse_as;

TEST_CASE("parse_as: the whole text is one decimal number") {
  CHECK(parse_as<double>("1.5") == 1.5);
  CHECK(parse_as<double>("-2e-3") == -0.002);
  CHECK(parse_as<double>("0.1") == 0.1);
  CHECK(parse_as<double>("1234567.890123") == 1234567.890123);
  CHECK(parse_as<double>("1e-310") == 1e-310);
  CHECK(parse_as<int>("-17") == -17);
  CHECK(parse_as<std::int64_t>("9223372036854775807") == std::numeric_limits<std::int64_t>::max());
  for (const char* text : {"", " 1", "1 ", "1,5", "1.5.", "x", "1x", "e5", "-", "+1.5", "0x10", "0x1p3"}) {
    CAPTURE(text);
    CHECK_FALSE(parse_as<double>(text));
    CHECK_FALSE(parse_as<int>(text));
  }
  CHECK_FALSE(parse_as<int>("1.5"));
  CHECK_FALSE(parse_as<std::int64_t>("9223372036854775808"));
  CHECK_FALSE(parse_as<double>("1e400"));
}
