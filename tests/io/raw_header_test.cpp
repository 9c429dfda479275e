#include "evmarker/io/raw_header.hpp"

#include <doctest/doctest.h>

#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

TEST_CASE("RAW header: the format line has precedence over evt and geometry") {
  const std::string text = "% evt 2.0\n% format EVT3;height=720;width=1280\n% geometry 640x480\n% end\n";
  const RawHeader header = parse_raw_header(text + "% x", "a.raw");
  CHECK(header.format == RawFormat::evt3);
  CHECK(header.size == SensorSize{1280, 720});
  CHECK(header.bytes == text.size());
  CHECK(header.fields.size() == 3);
}

TEST_CASE("RAW header: versions, line ends, geometry and system_ID") {
  CHECK(parse_raw_header("% evt 2.0\n% geometry 304x240\n", "a").format == RawFormat::evt2);
  CHECK(parse_raw_header("% evt 2.1\r\n% geometry 304x240\r\n% end\r\n", "a").format == RawFormat::evt21);
  CHECK(parse_raw_header("% evt 3.0\n% geometry 304x240\n", "a").size == SensorSize{304, 240});
  CHECK(parse_raw_header("% evt 3.0\n% system_ID 21\n", "a").size == SensorSize{640, 480});
  CHECK(parse_raw_header("% evt 3.0\n% system_ID 49\n", "a").size == SensorSize{1280, 720});
  CHECK(parse_raw_header("% evt 3.0\n% system_ID 99\n", "a").size == std::nullopt);
  CHECK(parse_raw_header("% evt 3.0\n% system_ID 21\n% geometry 10x20\n", "a").size == SensorSize{10, 20});
  CHECK(parse_raw_header("% evt 2.1\n% endianness legacy\n", "a").halves_swapped);
  CHECK(parse_raw_header("% format EVT21;endianness=legacy\n", "a").halves_swapped);
  CHECK_FALSE(parse_raw_header("% format EVT21;endianness=little\n", "a").halves_swapped);
}

TEST_CASE("RAW header: without evt and format, the encoding is that of the camera's system_ID") {
  CHECK(parse_raw_header("% system_ID 21\n", "a").format == RawFormat::evt2);
  CHECK(parse_raw_header("% system_ID 49\n", "a").format == RawFormat::evt3);
  CHECK(parse_raw_header("% system_ID 40\n", "a").format == RawFormat::evt3);
  CHECK(parse_raw_header("% system_ID 31\n", "a").format == RawFormat::evt2);
  CHECK(parse_raw_header("% system_ID 31\n", "a").size == SensorSize{1280, 720});
  CHECK(parse_raw_header("% evt 3.0\n% system_ID 21\n", "a").format == RawFormat::evt3);
  CHECK(contains(error_of([] { parse_raw_header("% system_ID 7\n", "a.raw"); }), "a.raw: not a Prophesee RAW"));
}

TEST_CASE("RAW header: EVT2.1 without endianness has the halves swapped if an older camera of Prophesee wrote it") {
  const auto header = [](const std::string& lines) {
    return parse_raw_header("% format EVT21;height=720;width=1280\n" + lines, "a");
  };
  const std::string prophesee = "% camera_integrator_name Prophesee\n% plugin_integrator_name Prophesee\n";
  CHECK(header(prophesee).halves_swapped);
  CHECK(header(prophesee + "% system_ID 48\n").halves_swapped);
  CHECK(header(prophesee + "% system_ID 49\n").halves_swapped);
  CHECK(header("% integrator_name Prophesee\n% system_ID 49\n").halves_swapped);
  CHECK_FALSE(header(prophesee + "% system_ID 55\n").halves_swapped);
  CHECK_FALSE(header(prophesee + "% system_ID 0\n").halves_swapped);
  CHECK_FALSE(header("% camera_integrator_name Prophesee\n% plugin_integrator_name Other\n").halves_swapped);
  CHECK_FALSE(header(prophesee).word_order_stated);
  CHECK_FALSE(header(prophesee + "% endianness little\n").halves_swapped);
  CHECK(header(prophesee + "% endianness little\n").word_order_stated);
  CHECK(header(prophesee + "% system_ID 60\n% endianness legacy\n").halves_swapped);
}

TEST_CASE("RAW header: without end line it ends at the first event word, even one that begins like a header line") {
  using namespace std::string_literals;
  CHECK(parse_raw_header("% evt 2.0\n\xd0\xd8\xd9\x80", "a").bytes == 10);
  CHECK(parse_raw_header("% evt 3.0\n% \x01\x00\x0a"s, "a").bytes == 10);
}

TEST_CASE("RAW header: make_raw_header and parse_raw_header are inverse") {
  for (const RawFormat format : {RawFormat::evt2, RawFormat::evt21, RawFormat::evt3}) {
    const std::string text = make_raw_header(format, {1280, 720});
    const RawHeader header = parse_raw_header(text, "a");
    CHECK(header.format == format);
    CHECK(header.size == SensorSize{1280, 720});
    CHECK(header.bytes == text.size());
    CHECK(header.word_order_stated == (format == RawFormat::evt21));
    CHECK_FALSE(header.halves_swapped);
  }
}

TEST_CASE("RAW header: errors contain file and value") {
  CHECK(contains(error_of([] { parse_raw_header("% evt 4.0\n% end\n", "a.raw"); }), "a.raw: RAW encoding '4.0'"));
  CHECK(contains(error_of([] { parse_raw_header("% format EVT4;width=1\n", "a.raw"); }), "'EVT4' is not supported"));
  CHECK(contains(error_of([] { parse_raw_header("hello", "a.raw"); }), "not a Prophesee RAW recording"));
}
