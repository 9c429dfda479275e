#include "evmarker/io/aedat2_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <future>

#include "evmarker/events/event_stream.hpp"
#include "io/recording_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;
using namespace std::string_literals;

static_assert(EventSource<Aedat2Reader>);

TEST_CASE("Aedat2Reader: a DVS128, also where no chip is named, byte by byte") {
  const TemporaryFolder folder;
  // (127 - 3) rows from the bottom, (127 - 2) columns from the right, ON; the same pixel OFF; an edge at the input
  const std::string records =
      "\0\0\x7c\xfa\xff\xff\xff\xff"s + "\0\0\x7c\xfb\0\0\0\x05"s + "\0\0\x80\0\0\0\0\x06"s + "\0\x01\0\0\0\0\0\x07"s;
  for (const char* chip : {"", "ch.unizh.ini.jaer.chip.retina.DVS128", "Tmpdiff128"}) {
    Aedat2Reader reader(write_file(folder / "a.aedat", aedat2_header(chip) + records));
    CHECK(reader.sensor_size() == SensorSize{128, 128});
    std::vector<TriggerEvent> triggers;
    CHECK(drain(reader, &triggers) == std::vector<Event>{{2, 3, 1, -1}, {2, 3, 0, 5}});
    CHECK(triggers == std::vector<TriggerEvent>{{0, false, 6}});
    CHECK(reader.statistics() == RecordingStatistics{.events = 2, .triggers = 1, .unknown_words = 1});
    CHECK(reader.bytes_read() == reader.bytes_total());
  }
}

TEST_CASE("Aedat2Reader: a DAVIS, byte by byte") {
  const TemporaryFolder folder;
  // y 259 from the bottom, x 345 from the right, ON; y 0, x 0, OFF; a frame's sample; a falling and a rising edge
  const std::string records = "\x40\xd5\x98\0\0\0\0\x01"s + "\0\0\0\0\0\0\0\x02"s + "\x80\xd5\x98\0\0\0\0\x03"s +
                              "\0\0\x04\x02\0\0\0\x04"s + "\0\0\x04\x03\0\0\0\x05"s;
  Aedat2Reader reader(
      write_file(folder / "a.aedat", aedat2_header("eu.seebetter.ini.chips.davis.Davis346mini") + records));
  CHECK(reader.sensor_size() == SensorSize{346, 260});
  std::vector<TriggerEvent> triggers;
  CHECK(drain(reader, &triggers) == std::vector<Event>{{0, 0, 1, 1}, {345, 259, 0, 2}});
  CHECK(triggers == std::vector<TriggerEvent>{{0, false, 4}, {0, true, 5}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 2, .triggers = 2});
}

TEST_CASE("Aedat2Reader: the sizes of chips") {
  const TemporaryFolder folder;
  for (const auto& expected :
       {std::pair{"eu.seebetter.ini.chips.davis.DAVIS240C", SensorSize{240, 180}},
        std::pair{"DAVIS346B", SensorSize{346, 260}}, std::pair{"DavisRGBW640", SensorSize{640, 480}},
        std::pair{"DAVIS208Mono", SensorSize{208, 192}}, std::pair{"DAVIS128", SensorSize{128, 128}},
        std::pair{"DavisX", SensorSize{50, 40}}}) {
    CAPTURE(expected.first);
    const auto& [chip, size] = expected;
    const auto path = write_file(folder / "a.aedat", aedat2_header(chip));
    CHECK(Aedat2Reader(path, {.sensor_size = SensorSize{50, 40}}).sensor_size() == size);
  }
}

TEST_CASE("Aedat2Reader: a header longer than a block of a pipe, and data that begins like a header line") {
  const TemporaryFolder folder;
  std::string text = "#!AER-DAT2.0\r\n# AEChip: DAVIS346B\r\n";
  while (text.size() < 3 * BlockReader::kPipeBlockBytes) text += "# <pref name=\"something\"/>\r\n";
  const std::vector<Event> events{{3, 118, 1, 10}, {4, 117, 0, 20}};
  std::string data;
  for (const Event& event : events) data += aedat2_record(davis_address(event, {346, 260}), event.t);
  REQUIRE(data[0] == '#');
  Fifo fifo(folder / "fifo", text + data);
  auto end = std::async(std::launch::async, [&] { fifo.end(); });
  Aedat2Reader reader(folder / "fifo");
  CHECK(drain(reader) == events);
  end.get();
}

TEST_CASE("Aedat2Reader: times go on where their 32 bits wrap, and can be shifted") {
  const TemporaryFolder folder;
  std::vector<Event> events;
  for (const Timestamp t : {-5LL, 0x7FFFFFF0LL, 0x80000010LL, 0xFFFFFFFFLL, 0x100000001LL})
    events.push_back({1, 2, 1, t});
  const auto path = write_file(folder / "a.aedat", make_aedat2(events, {640, 480}));
  Aedat2Reader reader(path);
  CHECK(drain(reader) == events);
  Aedat2Reader shifted(path, {.shift_first_time_to_zero = true});
  const auto read = drain(shifted);
  CHECK(read.front().t == 0);
  CHECK(read.back().t == 0x100000006LL);
}

TEST_CASE("Aedat2Reader: cut at any byte, it yields every whole event before the cut") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 10, 3);
  const std::string whole = make_aedat2(events, {640, 480});
  const std::size_t header = whole.find("ASCII Header\r\n") + 14;
  for (std::size_t cut = 0; cut <= whole.size(); ++cut) {
    const auto path = write_file(folder / "a.aedat", whole.substr(0, cut));
    std::size_t read = 0;
    const std::string error = error_of([&] {
      Aedat2Reader reader(path);
      const auto part = drain(reader);
      read = part.size();
      CHECK(std::equal(part.begin(), part.end(), events.begin()));
      CHECK(reader.bytes_read() == cut);
      if (cut >= header) CHECK(reader.statistics().truncated_bytes == (cut - header) % 8);
    });
    CHECK(read == (cut < header ? 0 : (cut - header) / 8));
    if (cut >= header) CHECK(error == "");
  }
}

TEST_CASE("Aedat2Reader: one clear line for what cannot be read") {
  const TemporaryFolder folder;
  CHECK(refuses<Aedat2Reader>(folder / "a.aedat", "", "a.aedat: not an AEDAT 2 recording"));
  CHECK(refuses<Aedat2Reader>(folder / "a.aedat", "#!AER-DAT2.0\r\n# AEChip", "cut off inside its header (byte 14)"));
  CHECK(refuses<Aedat2Reader>(folder / "a.aedat", aedat2_header("CochleaAMS1c"),
                              "header: AEChip is 'CochleaAMS1c', which is not supported (DVS128, DAVIS are)"));
  CHECK(refuses<Aedat2Reader>(folder / "a.aedat", aedat2_header("DavisX"), "no sensor size in it"));
}

// Its header names no chip, but its addresses have pixels 30 to 169 of a DAVIS in both directions; read as those of a
// DVS128, which has 16 bits, half of them would be edges at its input and all others be in column 127.
TEST_CASE("Aedat2Reader: a real file without the name of the chip, with the addresses of a DAVIS") {
  const auto path = real_recording("formats/translating_square.aedat");
  if (path.empty()) return;
  CHECK(contains(error_of([&] { Aedat2Reader reader(path); }), "no sensor size in it"));
  Aedat2Reader reader(path, {.sensor_size = SensorSize{240, 180}});
  const auto events = drain(reader);
  REQUIRE(events.size() == 16000);
  CHECK(events.front() == Event{239 - 169, 179 - 30, 0, 50000});
  CHECK(events[1] == Event{239 - 129, 179 - 30, 1, 50000});
  CHECK(events.back() == Event{239 - 31, 179 - 169, 1, 5000000});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 8000);
  CHECK(reader.statistics() == RecordingStatistics{.events = 16000});
}
