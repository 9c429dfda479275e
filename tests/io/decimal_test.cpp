#include "evmarker/io/decimal.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker::io;

TEST_CASE("parse_decimal: seconds to microseconds without loss") {
  CHECK(parse_decimal("0.003811000", 6) == 3811);
  CHECK(parse_decimal("1468939993.067416019", 6) == 1468939993067416);  // a double would give ...415.9
  CHECK(parse_decimal("1468939993.067416500", 6) == 1468939993067417);
  CHECK(parse_decimal("-0.0000005", 6) == -1);
  CHECK(parse_decimal("-0.00000049999999999999999999999", 6) == 0);
  CHECK(parse_decimal("12", 6) == 12000000);
  CHECK(parse_decimal(".5", 6) == 500000);
  CHECK(parse_decimal("5.", 6) == 5000000);
  CHECK(parse_decimal("1.468939993067416019e+09", 6) == 1468939993067416);
  CHECK(parse_decimal("2.5E-5", 6) == 25);
  CHECK(parse_decimal("1e-300", 6) == 0);
  CHECK(parse_decimal("0.000000000000000000000000000001", 6) == 0);
  CHECK(parse_decimal("0e999", 6) == 0);
  CHECK(parse_decimal("123.0", 0) == 123);
  CHECK(parse_decimal("9223372036854775807", 0) == std::numeric_limits<std::int64_t>::max());
}

TEST_CASE("parse_decimal: nothing for text that is not a number, or too large a number") {
  for (const char* text : {"", "-", ".", "abc", "1.2.3", "1e", "1e+", "1ee5", "1 ", " 1", "0x10", "nan", "inf", "--1",
                           "1e12345", "9223372036854775808", "1e19", "99999999999999999999999"})
    CHECK_MESSAGE(!parse_decimal(text, 0), text);
  CHECK(!parse_decimal("9223372036854.775808", 6));
  CHECK(parse_decimal("9223372036854.775807", 6) == std::numeric_limits<std::int64_t>::max());
}

TEST_CASE("parse_whole: whole numbers, however they are written, and nothing else") {
  CHECK(parse_whole("12") == 12);
  CHECK(parse_whole("-1.0") == -1);
  CHECK(parse_whole("9.600000000000000000e+01") == 96);
  CHECK(parse_whole("0.000000000000000000e+00") == 0);
  CHECK(parse_whole("1.5e1") == 15);
  for (const char* text : {"", "6.5", "1.55e1", "1e-1", "one", "99999999999999999999"})
    CHECK_MESSAGE(!parse_whole(text), text);
}
