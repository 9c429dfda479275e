#include "evmarker/io/raw_reader.hpp"

#include <doctest/doctest.h>
#include <sys/resource.h>

#include <algorithm>
#include <random>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "io/test_support.hpp"
#include "sanitized.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

static_assert(EventSource<RawReader>);

namespace {

// high 0, low 7, row 3, single event, trigger, vector of two, high 1, single event
const std::string kEvt3Words =
    to_bytes<std::uint16_t>({0x8000, 0x6007, 0x0003, 0x2805, 0xA101, 0x3864, 0x4003, 0x8001, 0x2006});
const std::vector<Event> kEvt3Events{{5, 3, 1, 7}, {100, 3, 1, 7}, {101, 3, 1, 7}, {6, 3, 0, 4096}};

}  // namespace

TEST_CASE("RawReader: reads EVT3 with its triggers") {
  const TemporaryFolder folder;
  RawReader reader(write_file(folder / "a.raw", "% date today\n% evt 3.0\n% geometry 320x240\n% end\n" + kEvt3Words));
  CHECK(reader.sensor_size() == SensorSize{320, 240});
  CHECK(reader.header().format == RawFormat::evt3);
  std::vector<TriggerEvent> triggers;
  CHECK(drain(reader, &triggers) == kEvt3Events);
  CHECK(triggers == std::vector<TriggerEvent>{{1, true, 7}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 4, .triggers = 1});
  CHECK(reader.bytes_read() == reader.bytes_total());
  CHECK(reader.bytes_total() == std::filesystem::file_size(folder / "a.raw"));
  CHECK(reader.next_batch().empty());
  CHECK(reader.triggers().empty());
}

TEST_CASE("RawReader: shifts the first time to zero on request") {
  const TemporaryFolder folder;
  const auto path = write_file(folder / "a.raw", "% evt 3.0\n% geometry 320x240\n% end\n" + kEvt3Words);
  RawReader reader(path, {.shift_first_time_to_zero = true});
  std::vector<TriggerEvent> triggers;
  const auto events = drain(reader, &triggers);
  REQUIRE(events.size() == 4);
  CHECK(events[0].t == 0);
  CHECK(events[3].t == 4089);
  CHECK(triggers == std::vector<TriggerEvent>{{1, true, 0}});
}

TEST_CASE("RawReader: EVT2.1 in both byte orders") {
  const TemporaryFolder folder;
  const std::vector<std::uint64_t> words{0x8000000100000000U, 0x1140280700000003U};
  const std::vector<Event> expected{{5, 7, 1, 69}, {6, 7, 1, 69}};
  RawReader little(write_file(folder / "a.raw", "% format EVT21;height=480;width=640\n% end\n" + to_bytes(words)));
  CHECK(drain(little) == expected);
  std::vector<std::uint32_t> halves;
  for (const auto word : words) {
    halves.push_back(static_cast<std::uint32_t>(word >> 32U));
    halves.push_back(static_cast<std::uint32_t>(word));
  }
  RawReader legacy(write_file(folder / "b.raw",
                              "% format EVT21;endianness=legacy;height=480;width=640\n% end\n" + to_bytes(halves)));
  CHECK(drain(legacy) == expected);
}

TEST_CASE("RawReader: EVT2.1 without endianness is read in the order in which its words make sense") {
  std::vector<std::uint64_t> words;
  std::mt19937 random(3);
  std::vector<Event> expected;
  for (std::uint64_t i = 0; i < 200; ++i) {
    const std::uint64_t bit = random() % 32, column = random() % 600, row = random() % 480;
    words.push_back(std::uint64_t{8} << 60U | i << 32U);
    words.push_back(std::uint64_t{1} << 60U | column << 43U | row << 32U | std::uint64_t{1} << bit);
    expected.push_back(
        {static_cast<std::uint16_t>(column + bit), static_cast<std::uint16_t>(row), 1, static_cast<Timestamp>(64 * i)});
  }
  std::vector<std::uint64_t> swapped;
  for (const std::uint64_t word : words) swapped.push_back(word << 32U | word >> 32U);
  const TemporaryFolder folder;
  const std::string format = "% format EVT21;height=480;width=640\n",
                    makers = "% camera_integrator_name Prophesee\n% plugin_integrator_name Prophesee\n";
  for (const char* id : {"", "% system_ID 49\n", "% system_ID 60\n"})
    for (const bool legacy : {false, true}) {
      CAPTURE(id);
      CAPTURE(legacy);
      RawReader reader(
          write_file(folder / "a.raw", format + makers + id + "% end\n" + to_bytes(legacy ? swapped : words)));
      CHECK(drain(reader) == expected);
      CHECK(reader.header().halves_swapped == legacy);
      CHECK(reader.statistics().unknown_words == 0);
    }
}

TEST_CASE("RawReader: a garbled TIME_HIGH anywhere shifts no later time") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 700000, 4);
  for (const RawFormat format : {RawFormat::evt2, RawFormat::evt3}) {
    write_and_close(RawWriter(folder / "a.raw", {640, 480}, format), events);
    const std::string whole = read_file(folder / "a.raw");
    const std::size_t word = format == RawFormat::evt2 ? 4 : 2, header = whole.find("% end\n") + 6;
    for (const std::size_t place : {2UL, 5UL, 9UL}) {
      std::size_t at = header + (whole.size() - header) / 10 * place / word * word;
      while ((static_cast<unsigned char>(whole[at + word - 1]) >> 4U) != 8) at += word;
      std::string garbled = whole;
      garbled[at + word - 1] = static_cast<char>(garbled[at + word - 1] ^ 0x0C);  // in EVT3 by 12.6 s
      RawReader reader(write_file(folder / "b.raw", garbled));
      const auto read = drain(reader);
      REQUIRE(read.size() == events.size());
      const auto good = std::ranges::mismatch(read, events).in1;
      const auto next = std::ranges::find_if(good, read.end(), [&](const Event& e) { return e.t > good->t + 20000; });
      CHECK(std::equal(next, read.end(), events.begin() + (next - read.begin())));
      for (auto e = good; e != next; ++e)  // up to the next TIME_HIGH, a little early
        CHECK(std::abs(e->t - events[static_cast<std::size_t>(e - read.begin())].t) < 20000);
      CHECK(reader.statistics().garbled_times == 1);
    }
  }
}

TEST_CASE("RawReader: triggers alone do not fill the memory") {
  const TemporaryFolder folder;
  std::vector<std::uint16_t> words{0x8000, 0x6000};
  words.resize(1500000, 0xA001);
  const std::string header = "% evt 3.0\n% geometry 320x240\n% end\n";
  RawReader reader(write_file(folder / "a.raw", header + to_bytes(words)));
  const std::string error = error_of([&] { reader.next_batch(); });
  CHECK(contains(error, "a.raw: garbled: 10"));
  CHECK(contains(error, " triggers without an event among them"));
  CHECK(reader.triggers().size() < 1100000);

  words.resize(1000000);
  words.insert(words.end(), {0x0003, 0x2805});
  RawReader few(write_file(folder / "a.raw", header + to_bytes(words)));
  std::vector<TriggerEvent> triggers;
  CHECK(drain(few, &triggers) == std::vector<Event>{{5, 3, 1, 0}});
  CHECK(triggers.size() == 999998);
}

TEST_CASE("RawReader: cut at any byte, it yields every whole event before the cut") {
  const TemporaryFolder folder;
  const std::string header = "% evt 3.0\n% geometry 320x240\n% end\n";
  // Number of events that are complete after each word.
  const std::vector<std::size_t> events_after_word{0, 0, 0, 1, 1, 1, 3, 3, 4};
  for (std::size_t cut = 0; cut <= kEvt3Words.size(); ++cut) {
    RawReader reader(write_file(folder / "a.raw", header + kEvt3Words.substr(0, cut)));
    const auto events = drain(reader);
    const std::size_t expected = cut < 2 ? 0 : events_after_word[cut / 2 - 1];
    REQUIRE(events.size() == expected);
    CHECK(std::equal(events.begin(), events.end(), kEvt3Events.begin()));
    CHECK(reader.statistics().truncated_bytes == cut % 2);
  }
  for (std::size_t cut = 0; cut < header.size(); ++cut) {  // within the header: an error, or no events
    const auto path = write_file(folder / "b.raw", header.substr(0, cut));
    std::size_t events = 0;
    const std::string error = error_of([&] {
      RawReader reader(path, {.sensor_size = SensorSize{320, 240}});
      events = drain(reader).size();
    });
    CHECK(events == 0);
    if (cut < 10) CHECK(contains(error, "b.raw"));
  }
}

TEST_CASE("RawReader: cut at any byte, EVT2") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 20, 1);
  write_and_close(RawWriter(folder / "whole.raw", {640, 480}, RawFormat::evt2), events);
  const std::string whole = read_file(folder / "whole.raw");
  const std::size_t header = whole.find("% end\n") + 6;
  std::size_t most = 0;
  for (std::size_t cut = header; cut <= whole.size(); ++cut) {
    RawReader reader(write_file(folder / "cut.raw", whole.substr(0, cut)));
    const auto read = drain(reader);
    REQUIRE(read.size() <= events.size());
    CHECK(std::equal(read.begin(), read.end(), events.begin()));
    CHECK(read.size() >= most);
    CHECK(reader.statistics().truncated_bytes == (cut - header) % 4);
    most = read.size();
  }
  CHECK(most == events.size());
}

TEST_CASE("RawReader: one clear line for a file that cannot be read") {
  const TemporaryFolder folder;
  CHECK(contains(error_of([&] { RawReader(folder / "none.raw"); }), "none.raw: cannot open: No such file"));
  CHECK(contains(error_of([&] { RawReader(folder / "."); }), "is a directory"));
  CHECK(refuses<RawReader>(folder / "empty.raw", "", "empty.raw: the file is empty"));
  CHECK(refuses<RawReader>(folder / "noise.raw", "\x01\x02\x03", "noise.raw: not a Prophesee RAW recording"));
  CHECK(refuses<RawReader>(folder / "dat.raw", "% Version 2\n\x0c\x08", "not a Prophesee RAW recording"));
  CHECK(refuses<RawReader>(folder / "evt4.raw", "% format EVT4;height=1;width=1\n% end\n", "'EVT4' is not supported"));
  CHECK(refuses<RawReader>(folder / "size.raw", "% evt 3.0\n% end\n", "no sensor size"));
  CHECK(refuses<RawReader>(folder / "geometry.raw", "% evt 3.0\n% geometry 12ax7\n% end\n", "geometry is '12ax7'"));
  CHECK(refuses<RawReader>(folder / "huge.raw", "% evt 3.0\n% geometry 99999x7\n% end\n", "99999 x 7"));
  CHECK(refuses<RawReader>(folder / "cut.raw", "% evt 3.0\n% geome", "cut off inside its header (byte 10)"));
  for (const char* name : {"empty.raw", "noise.raw", "evt4.raw", "cut.raw"})
    CHECK(error_of([&] { RawReader(folder / name); }).find('\n') == std::string::npos);
}

TEST_CASE("RawReader: the error contains path, offset and reason") {
  const TemporaryFolder folder;
  const auto path = write_file(folder / "cut.raw", "% evt 3.0\n% geome");
  try {
    RawReader reader(path);
    FAIL("no error");
  } catch (const RecordingError& error) {
    CHECK(error.path() == path);
    CHECK(error.byte_offset() == std::uint64_t{10});
    CHECK(error.reason() == "cut off inside its header");
  }
}

TEST_CASE("RawReader: a recording longer than its blocks, moved while it is read") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 1500000, 9);
  write_and_close(RawWriter(folder / "a.raw", {640, 480}, RawFormat::evt2), events);
  REQUIRE(std::filesystem::file_size(folder / "a.raw") > 3 * BlockReader::kBlockBytes);
  RawReader reader(folder / "a.raw");
  const auto first = reader.next_batch();
  std::vector<Event> read(first.begin(), first.end());
  const std::uint64_t after_first = reader.bytes_read();
  CHECK(after_first < reader.bytes_total());
  RawReader moved = std::move(reader);
  const auto rest = drain(moved);
  read.insert(read.end(), rest.begin(), rest.end());
  CHECK(read == events);
  CHECK(moved.bytes_read() == moved.bytes_total());
}

TEST_CASE("RawReader: destroyed while a block is being read") {
  const TemporaryFolder folder;
  write_and_close(RawWriter(folder / "a.raw", {640, 480}), random_events({640, 480}, 1500000, 9));
  for (int i = 0; i < 50; ++i) CHECK(!RawReader(folder / "a.raw").next_batch().empty());
}

TEST_CASE("RawReader: garbled recordings neither crash nor yield events off the sensor") {
  const TemporaryFolder folder;
  std::mt19937 random(123);
  std::size_t yielded = 0;
  for (const char* header : {"% evt 2.0\n% geometry 320x240\n% end\n", "% evt 2.1\n% geometry 320x240\n% end\n",
                             "% evt 3.0\n% geometry 320x240\n% end\n"}) {
    std::string bytes(300001, '\0');
    for (char& c : bytes) c = static_cast<char>(random());
    RawReader reader(write_file(folder / "a.raw", header + bytes));
    const auto events = drain(reader);
    CHECK(std::ranges::all_of(events, [](const Event& e) { return SensorSize{320, 240}.contains(e.x, e.y); }));
    CHECK(reader.statistics().events == events.size());
    yielded += events.size();
  }
  CHECK(yielded > 1000);
}

TEST_CASE("RawReader: a real EVT2 recording without end line") {
  const auto path = real_recording("formats/sparklers_evt2.raw");
  if (path.empty()) return;
  RawReader reader(path);
  CHECK(reader.sensor_size() == SensorSize{640, 480});  // from system_ID 21
  const auto events = drain(reader);
  REQUIRE(events.size() == 521252);
  CHECK(events.front().t == 913716224);
  CHECK(events.back().t == 913812095);
  CHECK(reader.statistics() == RecordingStatistics{.events = 521252});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 185861);
}

TEST_CASE("RawReader: memory does not grow with the recording") {
  if (kSanitized) {
    MESSAGE("skipped under sanitizers");
    return;
  }
  const TemporaryFolder folder;
  RawWriter writer(folder / "large.raw", {640, 480}, RawFormat::evt2);
  auto events = random_events({640, 480}, 500000, 2);
  const Timestamp duration = events.back().t + 1;
  for (int i = 0; i < 150; ++i) {
    writer.write(events);
    for (Event& event : events) event.t += duration;
  }
  writer.close();
  REQUIRE(std::filesystem::file_size(folder / "large.raw") > 300000000);

  const auto peak_kilobytes = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
  };
  const auto before = peak_kilobytes();
  RawReader reader(folder / "large.raw");
  std::uint64_t count = 0;
  for_each_event(reader, [&](const Event&) { ++count; });
  CHECK(count == 150 * events.size());
  CHECK(peak_kilobytes() - before < 30000);
}
