#include "evmarker/io/dat_reader.hpp"

#include <doctest/doctest.h>

#include <random>

#include "evmarker/events/event_stream.hpp"
#include "io/recording_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;
using namespace std::string_literals;

static_assert(EventSource<DatReader>);

TEST_CASE("DatReader: version 2, byte by byte") {
  const TemporaryFolder folder;
  // t 66, {p 1, y 300, x 1000}; t 67, {p 0, y 0, x 1}; p is -1 as 4 bits
  const std::string records = "\x42\0\0\0\xe8\x03\x4b\x10"s + "\x43\0\0\0\x01\0\0\0"s + "\x43\0\0\0\x02\0\0\xf0"s;
  DatReader reader(write_file(folder / "a.dat", "% Version 2\n% Height 720\n% Width 1280\n\x0c\x08" + records));
  CHECK(reader.sensor_size() == SensorSize{1280, 720});
  CHECK(drain(reader) == std::vector<Event>{{1000, 300, 1, 66}, {1, 0, 0, 67}, {2, 0, 0, 67}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 3});
  CHECK(reader.bytes_read() == reader.bytes_total());
  CHECK(reader.next_batch().empty());
}

TEST_CASE("DatReader: version 1, or none, has 9 and 8 bits for the coordinates") {
  const TemporaryFolder folder;
  const std::string records =
      "\x42\0\0\0\x2c\xe1\x03\0"s + "\x43\0\0\0\x01\x02\0\0"s;  // {p 1, y 240, x 300}, {0, 1, 1}
  const std::vector<Event> events{{300, 240, 1, 66}, {1, 1, 0, 67}};
  for (const char* version : {"% Version 1\n", ""}) {
    DatReader reader(write_file(folder / "a.dat", "% Date 2014-01-01\n"s + version + "\0\x08"s + records),
                     {.sensor_size = SensorSize{304, 241}});
    CHECK(drain(reader) == events);
  }
}

TEST_CASE("DatReader: triggers") {
  const TemporaryFolder folder;
  const std::vector<TriggerEvent> triggers{{0, true, 100}, {6, false, 250}};
  DatReader reader(write_file(folder / "a.dat",
                              dat_header({640, 480}) + "\x0e\x08" + "\x64\0\0\0\x01\0\0\0"s + "\xfa\0\0\0\0\0\0\x18"s));
  std::vector<TriggerEvent> read;
  CHECK(drain(reader, &read).empty());
  CHECK(read == triggers);
  CHECK(reader.statistics() == RecordingStatistics{.triggers = 2});
  DatReader shifted(folder / "a.dat", {.shift_first_time_to_zero = true});
  shifted.next_batch();
  REQUIRE(shifted.triggers().size() == 2);
  CHECK(shifted.triggers()[1].t == 150);

  std::string many = dat_header({640, 480}) + "\x0e\x08";
  for (int i = 0; i < 1100000; ++i) many += dat_record(triggers[0]);
  DatReader endless(write_file(folder / "many.dat", many));
  CHECK(contains(error_of([&] { endless.next_batch(); }), "1048577 triggers among 0 events"));
}

TEST_CASE("DatReader: the time goes on where its 32 bits wrap, and a garbled one shifts no later") {
  const TemporaryFolder folder;
  std::vector<Event> events;
  for (const Timestamp t : {0xFFFFFFF0LL, 0x100000010LL, 0x160000000LL, 0x1C0000000LL, 0x1C0000001LL, 0x1C0000002LL})
    events.push_back({1, 2, 1, t});
  DatReader reader(write_file(folder / "a.dat", make_dat(events, {640, 480})));
  CHECK(drain(reader) == events);

  for (int bit = 0; bit < 31; ++bit) {  // of the fifth time
    auto garbled = events;
    garbled[4].t ^= Timestamp{1} << bit;
    DatReader other(write_file(folder / "b.dat", make_dat(garbled, {640, 480})));
    const auto read = drain(other);
    CHECK(read[3] == events[3]);
    CHECK(read[5] == events[5]);
  }
}

TEST_CASE("DatReader: a step back is delivered and counted, what is off the sensor left out and counted") {
  const TemporaryFolder folder;
  const std::vector<Event> events{
      {1, 2, 1, 500}, {3, 4, 0, 400}, {640, 4, 0, 410}, {5, 480, 0, 420}, {639, 479, 0, 430}};
  DatReader reader(write_file(folder / "a.dat", make_dat(events, {640, 480})));
  CHECK(drain(reader) == std::vector<Event>{events[0], events[1], events[4]});
  CHECK(reader.statistics() == RecordingStatistics{.events = 3, .off_sensor = 2, .time_steps_back = 1});
}

TEST_CASE("DatReader: cut at any byte, it yields every whole event before the cut") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 10, 3);
  const std::string whole = make_dat(events, {640, 480});
  const std::size_t header = whole.find("\x0c\x08") + 2;
  for (std::size_t cut = 1; cut <= whole.size(); ++cut) {
    const auto path = write_file(folder / "a.dat", whole.substr(0, cut));
    if (cut < header) {
      CHECK(contains(error_of([&] { DatReader(path, {SensorSize{640, 480}}); }), "a.dat: "));
      continue;
    }
    DatReader reader(path);
    const auto read = drain(reader);
    REQUIRE(read.size() == (cut - header) / 8);
    CHECK(std::equal(read.begin(), read.end(), events.begin()));
    CHECK(reader.statistics().truncated_bytes == (cut - header) % 8);
    CHECK(reader.bytes_read() == cut);
  }
}

TEST_CASE("DatReader: one clear line for what cannot be read") {
  const TemporaryFolder folder;
  const std::string size = "% Width 640\n% Height 480\n";
  CHECK(refuses<DatReader>(folder / "a.dat", "", "a.dat: the file is empty"));
  CHECK(refuses<DatReader>(folder / "a.dat", "\x0c\x08\x01", "not a DAT recording"));
  CHECK(
      refuses<DatReader>(folder / "a.dat", "% Version 3\n\x0c\x08", "DAT version '3' is not supported (1 and 2 are)"));
  CHECK(refuses<DatReader>(folder / "a.dat", "% Version 2\n\x07\x08", "records of type 7 are not supported"));
  CHECK(refuses<DatReader>(folder / "a.dat", "% Version 2\n\x0c\x10",
                           "size of a DAT record is 16 bytes, must be 8 (byte 13)"));
  CHECK(refuses<DatReader>(folder / "a.dat", "% Version 2\n\x0c\x08", "no sensor size in it"));
  CHECK(refuses<DatReader>(folder / "a.dat", "% Version 2\n% Width 99999\n% Height 4\n\x0c\x08",
                           "sensor size is 99999 x 4 px, DAT addresses 1..16384 a side"));
  CHECK(refuses<DatReader>(folder / "a.dat", "% Version 2\n\x0c", "cut off behind its header (byte 12)"));
}

TEST_CASE("DatReader: a real recording of a car, Event2d of version 2") {
  const auto path = real_recording("formats/ncars.dat");
  if (path.empty()) return;
  DatReader reader(path, {.sensor_size = SensorSize{64, 64}});
  const auto events = drain(reader);
  REQUIRE(events.size() == 4407);
  CHECK(events.front() == Event{6, 18, 1, 0});
  CHECK(events[1] == Event{42, 35, 0, 66});
  CHECK(events.back() == Event{48, 47, 1, 99937});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 1671);
  CHECK(reader.statistics() == RecordingStatistics{.events = 4407});
}
