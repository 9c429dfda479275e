#include "evmarker/io/aedat3_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>

#include "evmarker/events/event_stream.hpp"
#include "io/recording_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;
using namespace std::string_literals;

static_assert(EventSource<Aedat3Reader>);

TEST_CASE("Aedat3Reader: events and triggers, byte by byte") {
  const TemporaryFolder folder;
  const std::string header = aedat3_header("DAVIS240C");
  // x 239, y 1, ON, valid, t 7 of the second 2^31 us; x 0, y 179, OFF, valid, t 8; one that is not valid
  const std::string events = "\x01\0\x01\0\x08\0\0\0\x04\0\0\0\x01\0\0\0\x03\0\0\0\x03\0\0\0\x02\0\0\0"s +
                             "\x07\0\xde\x01\x07\0\0\0"s + "\xcd\x02\0\0\x08\0\0\0"s + "\x04\0\0\0\x09\0\0\0"s;
  // a rising edge of input 0, a falling one of input 2, a reset of the time
  const std::string special =
      aedat3_packet(0, 1, 8, 3, 0) + "\x05\0\0\0\x0a\0\0\0"s + "\x15\0\0\0\x0b\0\0\0"s + "\x03\0\0\0\x0c\0\0\0"s;
  Aedat3Reader reader(write_file(folder / "a.aedat", header + events + special));
  CHECK(reader.sensor_size() == SensorSize{240, 180});
  std::vector<TriggerEvent> triggers;
  CHECK(drain(reader, &triggers) == std::vector<Event>{{239, 1, 1, 0x80000007LL}, {0, 179, 0, 0x80000008LL}});
  CHECK(triggers == std::vector<TriggerEvent>{{0, true, 10}, {2, false, 11}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 2, .triggers = 2});
  CHECK(reader.bytes_read() == reader.bytes_total());
}

TEST_CASE("Aedat3Reader: packets of other types and sources are passed over, whatever their length") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 30000, 5);
  std::string bytes = make_aedat3(events, {640, 480});
  bytes += aedat3_packet(1, 2, 8, 1, 0) + aedat3_event({1, 2, 1, 5});
  bytes += aedat3_packet(2, 1, 300000, 3, 0) + std::string(900000, 'x') + aedat3_packet(1, 1, 8, 0, 0);
  Aedat3Reader reader(write_file(folder / "a.aedat", bytes));
  CHECK(drain(reader) == events);
  CHECK(reader.statistics() == RecordingStatistics{.events = events.size()});
  CHECK(reader.bytes_read() == bytes.size());
}

TEST_CASE("Aedat3Reader: without a known source, the first that has events is read, in the size of the options") {
  const TemporaryFolder folder;
  const std::string bytes = "#!AER-DAT3.1\r\n#Format: RAW\r\n#!END-HEADER\r\n" + aedat3_packet(1, 5, 8, 1, 0) +
                            aedat3_event({1, 2, 1, 5}) + aedat3_packet(1, 6, 8, 1, 0) + aedat3_event({3, 4, 1, 6});
  Aedat3Reader reader(write_file(folder / "a.aedat", bytes), {.sensor_size = SensorSize{30, 20}});
  CHECK(reader.sensor_size() == SensorSize{30, 20});
  CHECK(drain(reader) == std::vector<Event>{{1, 2, 1, 5}});
}

TEST_CASE("Aedat3Reader: cut at any byte, it yields every whole event before the cut") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 10, 3);
  const std::string header = aedat3_header("DAVIS640"), whole = make_aedat3(events, {640, 480});
  const std::size_t first = header.size() + 28, behind = first + 8 * events.size();
  for (std::size_t cut = header.size(); cut <= whole.size(); ++cut) {
    Aedat3Reader reader(write_file(folder / "a.aedat", whole.substr(0, cut)));
    const auto read = drain(reader);
    REQUIRE(read.size() == (cut < first ? 0 : std::min((cut - first) / 8, events.size())));
    CHECK(std::equal(read.begin(), read.end(), events.begin()));
    CHECK(reader.bytes_read() == cut);
    const auto truncated = reader.statistics().truncated_bytes;
    if (cut < first) CHECK(truncated == cut - header.size());
    if (cut >= first && cut < behind) CHECK(truncated == (cut - first) % 8);
    if (cut == whole.size()) CHECK(truncated == 0);
    if (cut > behind && cut < whole.size() && cut != behind + 28) CHECK(truncated > 0);
  }
}

TEST_CASE("Aedat3Reader: one clear line for what cannot be read, once all events before it are delivered") {
  const TemporaryFolder folder;
  CHECK(refuses<Aedat3Reader>(folder / "a.aedat", "", "a.aedat: not an AEDAT 3.1 recording"));
  CHECK(refuses<Aedat3Reader>(folder / "a.aedat", "#!AER-DAT3.1\r\n#Format: Serial-TS\r\n#!END-HEADER\r\n",
                              "header: Format is 'Serial-TS', which is not supported (RAW is)"));
  CHECK(refuses<Aedat3Reader>(folder / "a.aedat", aedat3_header("DYNAPSE"), "no sensor size in it"));
  const std::string good = aedat3_header("DAVIS240C") + aedat3_packet(1, 1, 8, 1, 0) + aedat3_event({1, 2, 1, 5});
  const auto error_behind = [&](const std::string& packet) {
    Aedat3Reader reader(write_file(folder / "a.aedat", good + packet));
    CHECK(reader.next_batch().size() == 1);
    const std::string error = error_of([&] { reader.next_batch(); });
    CHECK(error_of([&] { reader.next_batch(); }) == error);  // it does not go on behind it
    return error;
  };
  const std::string at = " (byte " + std::to_string(good.size()) + ")";
  CHECK(contains(error_behind(aedat3_packet(1, 1, 12, 1, 0)), "packet: eventSize is 12, must be 8" + at));
  CHECK(contains(error_behind(aedat3_packet(2, 1, ~0U, 1, 0)), "packet: eventSize is -1, must be 0 or more" + at));
  CHECK(contains(error_behind(aedat3_packet(1, 1, 8, ~0U, 0)), "packet: eventNumber is -1, must be 0 or more" + at));
  CHECK(
      contains(error_behind(aedat3_packet(0x8001, 1, 8, 1, 0)), "eventType is -32767, must be 0 or more (compressed"));
}

TEST_CASE("Aedat3Reader: garbled lengths end at the end of the file") {
  const TemporaryFolder folder;
  const std::string good =
      aedat3_header("DAVIS240C") + aedat3_packet(1, 1, 8, 0x7FFFFFFF, 0x7FFFFFFF) + aedat3_event({1, 2, 1, 5});
  Aedat3Reader reader(write_file(folder / "a.aedat", good));
  CHECK(drain(reader) == std::vector<Event>{{1, 2, 1, (0x7FFFFFFFLL << 31) + 5}});
  Aedat3Reader other(write_file(folder / "b.aedat",
                                aedat3_header("DAVIS240C") + aedat3_packet(2, 1, 0x7FFFFFFF, 0x7FFFFFFF, 0) + "abc"));
  CHECK(drain(other).empty());
  CHECK(other.statistics().truncated_bytes == 3);
}
