#include "evmarker/io/csv_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/io/csv_writer.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

static_assert(EventSource<CsvReader>);

namespace {

const CsvReaderOptions kSize{.sensor_size = SensorSize{640, 480}};

std::vector<Event> read(const std::string& text, const CsvReaderOptions& options = kSize) {
  const TemporaryFolder folder;
  CsvReader reader(write_file(folder / "a.csv", text), options);
  return drain(reader);
}

std::string error_in(const std::string& text, const CsvReaderOptions& options = kSize) {
  const TemporaryFolder folder;
  const auto path = write_file(folder / "a.csv", text);
  return error_of([&] {
    CsvReader reader(path, options);
    drain(reader);
  });
}

}  // namespace

TEST_CASE("CsvReader: Metavision CSV with its geometry line") {
  const TemporaryFolder folder;
  CsvReader reader(write_file(folder / "a.csv", "%geometry:320,240\n5,6,1,100\n7,8,0,101\n"));
  CHECK(reader.sensor_size() == SensorSize{320, 240});
  CHECK(drain(reader) == std::vector<Event>{{5, 6, 1, 100}, {7, 8, 0, 101}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 2});
  CHECK(reader.bytes_read() == reader.bytes_total());
  CHECK(reader.bytes_total() == 38);
}

TEST_CASE("CsvReader: RPG text, seconds to exact microseconds") {
  CHECK(read("0.003811000 96 133 0\n1468939993.067416 30 4 1\n") ==
        std::vector<Event>{{96, 133, 0, 3811}, {30, 4, 1, 1468939993067416}});
  CHECK(read("240 180\n0.000001 239 179 1\n", {}) == std::vector<Event>{{239, 179, 1, 1}});
}

TEST_CASE("CsvReader: separators, blanks, line ends, comments and polarities") {
  const std::vector<Event> expected{{5, 6, 1, 100}, {7, 8, 0, 101}};
  CHECK(read("5;6;1;100\n7;8;-1;101") == expected);
  CHECK(read("5, 6, 1, 100\r\n7, 8, -1, 101\r\n") == expected);
  CHECK(read("# a comment\n\n100\t5\t6\t1\n# another\n101 7   8 0 \n") == expected);
  CHECK(read("  100 5 6 1\n  101 7 8 0\n") == expected);
}

TEST_CASE("CsvReader: column names give order and unit") {
  const std::vector<Event> expected{{5, 6, 1, 100}, {7, 8, 0, 101}};
  CHECK(read("p,t_us,y,x\n1,100,6,5\n0,101,8,7\n") == expected);
  CHECK(read("x,y,polarity,timestamp [s]\n5,6,1,0.0001\n7,8,0,0.000101\n") == expected);
  CHECK(read("index,t,x,y,on\n0,100,5,6,1\n1,101,7,8,0\n") == expected);
}

TEST_CASE("CsvReader: times too far apart to be shifted are refused with their line") {
  const std::string first = "1,1,1,-9223372036854775808\n", last = "1,1,1,9223372036854775807\n";
  const CsvReaderOptions shift{.sensor_size = SensorSize{640, 480}, .shift_first_time_to_zero = true};
  CHECK(contains(error_in(first + last, shift), "line 2: t is 9223372036854775807 us, too far from the first time"));
  CHECK(contains(error_in(last + "1,1,1,-2\n", shift), "line 2: t is -2 us"));
  CHECK(read(first + "1,1,1,-1\n", shift) == std::vector<Event>{{1, 1, 1, 0}, {1, 1, 1, 9223372036854775807}});
  CHECK(read(last + "1,1,1,-1\n", shift).back().t == std::numeric_limits<Timestamp>::min());
}

TEST_CASE("CsvReader: options have precedence over what is recognised") {
  CHECK(read("6,5,100,1\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "yxtp"}}) ==
        std::vector<Event>{{5, 6, 1, 100}});
  CHECK(read("2 1 0 1\n", {.sensor_size = SensorSize{640, 480}, .layout = {.time_unit = TimeUnit::seconds}}) ==
        std::vector<Event>{{1, 0, 1, 2000000}});
  CHECK(read("1|2|1|9\n", {.sensor_size = SensorSize{640, 480}, .layout = {.separator = '|'}}) ==
        std::vector<Event>{{1, 2, 1, 9}});
  CHECK(read("100,9,9,9,5,6,1\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "t---xyp"}}) ==
        std::vector<Event>{{5, 6, 1, 100}});
}

TEST_CASE("CsvReader: the order of columns is recognised where only one is possible") {
  CHECK(read("100,5,6,1\n101,7,8,0\n") == std::vector<Event>{{5, 6, 1, 100}, {7, 8, 0, 101}});  // commas, time first
  CHECK(read("5 6 1 100\n7 8 0 101\n") == std::vector<Event>{{5, 6, 1, 100}, {7, 8, 0, 101}});  // blanks, time last
}

TEST_CASE("CsvReader: a malformed line is reported after all events before it") {
  CHECK(contains(error_in("5,6,1,100\n5,6,1,101\n5,abc,1,102\n5,6,1,103\n"), "a.csv: line 3: y is 'abc' (byte 20)"));
  CHECK(contains(error_in("5,6,1,100\n5,6,2,101\n5,6,0,9\n"), "line 2: p is '2'"));
  CHECK(contains(error_in("5,6,1,100\n5,6,1\n5,6,0,9\n"), "line 2: no t"));
  CHECK(contains(error_in("%geometry:640,480\nx,y,p,t\n5,6,1,1\n5,6.5,1,2\n5,6,1,3\n"), "line 4: y is '6.5'"));
  CHECK(contains(error_in("x,y,p,t\n5,6,1,1,9\n5,6,1,1\n"), "line 2: more than the 4 columns"));
  CHECK(contains(error_in("x,y,p,t\n5,6,1,99999999999999999999\n5,6,1,1\n"), "t is '99999999999999999999'"));
  CHECK(contains(error_in("5,6,1,100\n" + std::string(1200000, '7') + "\n"), "longer than 65536"));

  const TemporaryFolder folder;
  CsvReader reader(write_file(folder / "a.csv", "x,y,p,t\n5,6,1,100\noops\n5,6,1,101\n"), kSize);
  CHECK(reader.next_batch().size() == 1);
  CHECK(contains(error_of([&] { reader.next_batch(); }), "line 3: x is 'oops'"));
  CHECK(contains(error_of([&] { reader.next_batch(); }), "line 3: x is 'oops'"));
}

TEST_CASE("CsvReader: cut at any byte, it yields every whole event before the cut") {
  const TemporaryFolder folder;
  const std::string text = "%geometry:640,480\n5,6,1,100\n7,8,0,101\n9,10,1,102\n";
  std::size_t whole_lines = 0;
  for (std::size_t cut = 20; cut <= text.size(); ++cut) {
    CsvReader reader(write_file(folder / "a.csv", text.substr(0, cut)), {.layout = {.columns = "xypt"}});
    const auto events = drain(reader);
    whole_lines = static_cast<std::size_t>(std::count(text.begin() + 18, text.begin() + static_cast<long>(cut), '\n'));
    CHECK(events.size() >= whole_lines);  // a line cut off within its time may look complete
    CHECK(events.size() <= whole_lines + 1);
    if (events.size() == whole_lines) CHECK((reader.statistics().truncated_bytes > 0) == (text[cut - 1] != '\n'));
  }
  CHECK(whole_lines == 3);
}

TEST_CASE("CsvReader: events off the sensor, steps back in time, shift to zero") {
  const TemporaryFolder folder;
  const auto path = write_file(folder / "a.csv",
                               "%geometry:20,10\n1,1,1,100\n20,1,1,101\n-1,1,0,102\n1,10,0,103\n"
                               "70000,1,1,104\n2,2,1,90\n3,3,0,95\n");
  CsvReader reader(path, {.shift_first_time_to_zero = true});
  CHECK(drain(reader) == std::vector<Event>{{1, 1, 1, 0}, {2, 2, 1, -10}, {3, 3, 0, -5}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 3, .off_sensor = 4, .time_steps_back = 1});
}

TEST_CASE("CsvReader: one clear line for a file that cannot be read") {
  CHECK(contains(error_in(""), "a.csv: the file is empty"));
  CHECK(contains(error_in("5,6,1,100\n", {}), "no sensor size: put a first line '%geometry:WIDTH,HEIGHT'"));
  CHECK(contains(error_in("this is a letter\nto someone\n"), "cannot recognise the columns"));
  CHECK(contains(error_in("5,6\n7,8\n"), "cannot recognise the columns"));
  CHECK(contains(error_of([&] { CsvReader("/no/such/file.csv", kSize); }), "/no/such/file.csv: cannot open"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   read("5,6,1,100\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "xyp"}});
                 }),
                 "columns is 'xyp'"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   read("5,6,1,100\n", {.sensor_size = SensorSize{0, 480}});
                 }),
                 "sensor_size is 0 x 480"));
}

TEST_CASE("CsvReader: garbled text never crashes") {
  const TemporaryFolder folder;
  std::mt19937 random(5);
  const std::string_view alphabet = "0123456789,,,,....-- \t\n\n\neE#%xypt";
  int opened = 0;
  for (int round = 0; round < 500; ++round) {
    std::string text = "x,y,p,t\n1,2,1,3\n";
    for (int i = 0; i < 200; ++i) text += alphabet[random() % alphabet.size()];
    const auto path = write_file(folder / "a.csv", text);
    error_of([&] {
      CsvReader reader(path, kSize);
      ++opened;
      for (const Event& event : drain(reader)) REQUIRE(kSize.sensor_size->contains(event.x, event.y));
    });
  }
  CHECK(opened == 500);
}

TEST_CASE("CsvReader: a real recording without geometry line") {
  const std::filesystem::path path = std::filesystem::path(EVMARKER_SHARED_DATA) / "flip/events.csv";
  if (!std::filesystem::exists(path)) {
    MESSAGE("skipped: no " << path.string());
    return;
  }
  CHECK(contains(error_of([&] { CsvReader reader(path); }), "no sensor size"));
  CsvReader reader(path, {.sensor_size = SensorSize{128, 128}});
  const auto events = drain(reader);
  REQUIRE(events.size() == 175136);
  CHECK(events.front() == Event{20, 20, 1, 0});
  CHECK(events.back() == Event{82, 64, 0, 2026984});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 104472);
  CHECK(reader.statistics() == RecordingStatistics{.events = 175136});
}

TEST_CASE("CsvWriter: what is written is read back") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 300000, 12, true);
  CsvWriter writer(folder / "a.csv", {640, 480});
  writer.write(std::span(events).first(1000));
  writer.write(std::span(events).subspan(1000));
  writer.write(Event{1, 2, -1, std::numeric_limits<Timestamp>::max()});
  CHECK(!std::filesystem::exists(folder / "a.csv"));
  writer.close();
  CHECK(read_file(folder / "a.csv").starts_with("%geometry:640,480\n"));
  REQUIRE(std::filesystem::file_size(folder / "a.csv") > 3 * BlockReader::kBlockBytes);
  CsvReader reader(folder / "a.csv");
  auto read_back = drain(reader);
  CHECK(read_back.back() == Event{1, 2, 0, std::numeric_limits<Timestamp>::max()});
  read_back.pop_back();
  CHECK(read_back == events);
  CHECK(reader.statistics().time_steps_back > 0);
}

TEST_CASE("CsvWriter: refuses events off the sensor and leaves no file behind") {
  const TemporaryFolder folder;
  {
    CsvWriter writer(folder / "a.csv", {640, 480});
    CHECK(contains(error_of<std::invalid_argument>([&] { writer.write(Event{640, 0, 1, 1}); }), "event 0: x is 640"));
    CHECK(contains(error_of<std::invalid_argument>([&] { writer.write(Event{0, 0, 1, -1}); }), "event 0: t is -1"));
  }
  CHECK(folder.files() == 0);
  CHECK(contains(error_of<std::invalid_argument>([&] { CsvWriter(folder / "a.csv", {-1, 480}); }), "width is -1"));
}
