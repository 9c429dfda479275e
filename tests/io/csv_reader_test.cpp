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
  CHECK(read("# a comment\n\n1000\t5\t6\t1\n# another\n1001 7   8 0 \n") ==
        std::vector<Event>{{5, 6, 1, 1000}, {7, 8, 0, 1001}});
  CHECK(read("  t x y p\n  100 5 6 1\n  101 7 8 0\n") == expected);
}

TEST_CASE("CsvReader: column names give order and unit") {
  const std::vector<Event> expected{{5, 6, 1, 100}, {7, 8, 0, 101}};
  CHECK(read("p,t_us,y,x\n1,100,6,5\n0,101,8,7\n") == expected);
  CHECK(read("x,y,polarity,timestamp [s]\n5,6,1,0.0001\n7,8,0,0.000101\n") == expected);
  CHECK(read("index,t,x,y,on\n0,100,5,6,1\n1,101,7,8,0\n") == expected);
}

TEST_CASE("CsvReader: times too far apart to be shifted are refused with their line") {
  const std::string first = "1,1,1,-9223372036854775808\n", last = "1,1,1,9223372036854775807\n";
  const CsvReaderOptions shift{
      .sensor_size = SensorSize{640, 480}, .shift_first_time_to_zero = true, .layout = {.columns = "xypt"}};
  CHECK(contains(error_in(first + last, shift), "line 2: t is 9223372036854775807 us, too far from the first time"));
  CHECK(contains(error_in(last + "1,1,1,-2\n", shift), "line 2: t is -2 us"));
  CHECK(read(first + "1,1,1,-1\n", shift) == std::vector<Event>{{1, 1, 1, 0}, {1, 1, 1, 9223372036854775807}});
  CHECK(read(last + "1,1,1,-1\n", shift).back().t == std::numeric_limits<Timestamp>::min());
}

TEST_CASE("CsvReader: options have precedence over what is recognised") {
  CHECK(read("6,5,100,1\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "yxtp"}}) ==
        std::vector<Event>{{5, 6, 1, 100}});
  CHECK(read("2 1 0 1\n",
             {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "t,x,y,p", .time_unit = TimeUnit::seconds}}) ==
        std::vector<Event>{{1, 0, 1, 2000000}});
  CHECK(read("1|2|1|9\n", {.sensor_size = SensorSize{640, 480}, .layout = {.separator = '|'}}) ==
        std::vector<Event>{{1, 2, 1, 9}});
  CHECK(read("100,9,9,9,5,6,1\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "t---xyp"}}) ==
        std::vector<Event>{{5, 6, 1, 100}});
}

TEST_CASE("CsvReader: the order of columns is recognised where only one is possible") {
  CHECK(read("100,5,6,1\n101,7,3,0\n") == std::vector<Event>{{5, 6, 1, 100}, {7, 3, 0, 101}});  // commas, time first
  CHECK(read("5 6 1 100\n7 8 0 101\n") == std::vector<Event>{{5, 6, 1, 100}, {7, 8, 0, 101}});  // blanks, time last
  const std::string refused = error_in("100,5,6,1\n101,7,8,0\n");
  CHECK(contains(refused, "a.csv: the columns may be 'txyp' or 'xytp': name them, --columns t,x,y,p"));
  CHECK(refused.find('\n') == std::string::npos);
}

namespace {

const std::string kOrders[] = {"xypt", "txyp", "xytp", "pxyt", "tpxy", "ptxy"};

/// Lines of these events, columns in this order, times and polarities as they are to be written.
template <typename Time, typename Polarity>
std::string lines_of(const std::vector<Event>& events, std::string_view order, const Time& time,
                     const Polarity& polarity, char separator = ',') {
  std::string text;
  for (const Event& event : events) {
    for (const char column : order) {
      if (column == 'x') text += std::to_string(event.x);
      if (column == 'y') text += std::to_string(event.y);
      if (column == 'p') text += polarity(event.p);
      if (column == 't') text += time(event.t);
      text += separator;
    }
    text.back() = '\n';
  }
  return text;
}

std::string whole(Timestamp t) { return std::to_string(t); }
std::string zero_or_one(int p) { return std::to_string(p); }

/// A time [us] as text in units of 10^-places s.
std::string decimal(const char* format, Timestamp t, double unit) {
  char text[64];
  std::snprintf(text, sizeof(text), format, static_cast<double>(t) * unit);
  return text;
}

// About 20000 events per second, 0.07 per pixel: few.
const std::vector<Event>& some_events() {
  static const auto events = random_events({640, 480}, 3000, 8);
  return events;
}

}  // namespace

TEST_CASE("CsvReader: any order of columns is recognised by what the events can be") {
  for (const std::string& order : kOrders)
    for (const char separator : {',', ' '}) {
      CAPTURE(order);
      CsvReaderOptions options = kSize;
      options.layout.time_unit = TimeUnit::microseconds;
      CHECK(read(lines_of(some_events(), order, whole, zero_or_one, separator), options) == some_events());
      const auto truth = [](int p) { return std::string(p > 0 ? "True" : "False"); };
      CHECK(read(lines_of(some_events(), order, whole, truth, separator), options) == some_events());
    }
}

TEST_CASE("CsvReader: the unit of time in the name of its column") {
  const auto& events = some_events();
  for (const char* name : {"t_ns", "t [ns]", "timestamp_nsec", "ts(ns)", "nanoseconds", "time_ns", "timeNs"})
    CHECK_MESSAGE(
        read("x,y,p," + std::string(name) + "\n" +
             lines_of(
                 events, "xypt", [](Timestamp t) { return std::to_string(1000 * t); }, zero_or_one)) == events,
        name);
  for (const char* name : {"t_us", "time [us]", "time_usec", "ts_us", "timestamp(us)", "Timestamp [\xC2\xB5s]",
                           "microseconds", "time [\xCE\xBCs]", "micros"})
    CHECK_MESSAGE(read("x,y,p," + std::string(name) + "\n" + lines_of(events, "xypt", whole, zero_or_one)) == events,
                  name);
  for (const char* name : {"t_ms", "time [ms]", "timestamp_msec", "milliseconds", "\"ts (ms)\""})
    CHECK_MESSAGE(
        read("x,y,p," + std::string(name) + "\n" +
             lines_of(
                 events, "xypt", [](Timestamp t) { return decimal("%.3f", t, 1e-3); }, zero_or_one)) == events,
        name);
  for (const char* name : {"t_s", "time [s]", "seconds", "timestamp_sec", "ts/s"})
    CHECK_MESSAGE(
        read("x,y,p," + std::string(name) + "\n" +
             lines_of(
                 events, "xypt", [](Timestamp t) { return decimal("%.6f", t, 1e-6); }, zero_or_one)) == events,
        name);
  CHECK(read("x y p time [us]\n" + lines_of(events, "xypt", whole, zero_or_one, ' ')) == events);
}

TEST_CASE("CsvReader: without a unit, the one that makes the events those of a camera") {
  auto events = random_events({640, 480}, 3000, 8);  // 0.7 per pixel and second
  for (Event& event : events) event.t /= 10;
  for (const Timestamp begin : {Timestamp{0}, Timestamp{1468939993067416}})  // a clock since 1970, too
    for (const std::string& header : {std::string(), std::string("x,y,p,t\n"), std::string("x,y,p,time\n")}) {
      auto late = events;
      for (Event& event : late) event.t += begin;
      const auto read_as = [&](auto time) { return read(header + lines_of(late, "xypt", time, zero_or_one)); };
      CHECK(read_as(whole) == late);
      CHECK(read_as([](Timestamp t) { return std::to_string(t) + "000"; }) == late);
      CHECK(read_as([](Timestamp t) { return std::to_string(t) + ".0"; }) == late);
      CHECK(read_as([](Timestamp t) { return std::to_string(t) + ".25"; }) == late);
      const auto point = [](Timestamp t, std::size_t places) {
        std::string text = std::to_string(t);
        text.insert(0, places + 1 - std::min(places + 1, text.size()), '0');
        return text.insert(text.size() - places, ".");
      };
      CHECK(read_as([&](Timestamp t) { return point(t, 3); }) == late);
      CHECK(read_as([&](Timestamp t) { return point(t, 6); }) == late);
      CHECK(read_as([&](Timestamp t) { return point(t, 6) + "000"; }) == late);
    }
  for (const double unit : {1.0, 1e-3, 1e-6})  // as numpy.savetxt writes them
    CHECK(read(lines_of(
              events, "txyp", [&](Timestamp t) { return decimal("%.18e", t, unit); }, zero_or_one, ' ')) == events);
}

TEST_CASE("CsvReader: two units that are plausible, or none, are refused in one line that says what to do") {
  auto events = some_events();  // as microseconds few, as nanoseconds many
  for (Event& event : events) event.t *= 3;
  const std::string text = lines_of(events, "xypt", whole, zero_or_one);
  const std::string refused = error_in(text);
  CHECK(contains(refused, "a.csv: cannot tell the unit of its times: name it, --time-unit s|ms|us|ns"));
  CHECK(refused.find('\n') == std::string::npos);
  CsvReaderOptions options = kSize;
  for (const auto& [unit, divisor] : {std::pair(TimeUnit::microseconds, 1), std::pair(TimeUnit::nanoseconds, 1000)}) {
    options.layout.time_unit = unit;
    auto expected = events;
    for (Event& event : expected) event.t = (event.t + divisor / 2) / divisor;
    CHECK(read(text, options) == expected);
  }
  CHECK(read("%geometry:640,480\n" + text) == events);  // Metavision's CSV has microseconds
  CHECK(contains(error_in(lines_of(
                     events, "xypt", [](Timestamp) { return std::string("7"); }, zero_or_one)),
                 "cannot tell the unit"));
}

TEST_CASE("CsvReader: a unit in which no camera is so fast is refused, fractions of microseconds are read") {
  auto events = some_events();
  const auto seconds = [](Timestamp t) { return decimal("%.6f", t, 1e-6); };
  CsvReaderOptions options = kSize;
  for (const auto& [unit, name] : {std::pair(TimeUnit::microseconds, "us"), std::pair(TimeUnit::nanoseconds, "ns")}) {
    options.layout.time_unit = unit;
    const std::string refused = error_in(lines_of(events, "txyp", seconds, zero_or_one, ' '), options);
    CHECK_MESSAGE(contains(refused, "a.csv: the unit of its times is not " + std::string(name) +
                                        ", in which its first " + std::to_string(events.size()) +
                                        " events would come faster than any camera's: name "
                                        "it, --time-unit s|ms|us|ns"),
                  refused);
    CHECK(refused.find('\n') == std::string::npos);
  }
  CHECK(contains(error_in("x,y,p,t_us\n" + lines_of(events, "xypt", seconds, zero_or_one)), "times is not us"));
  options.layout.time_unit = TimeUnit::seconds;
  CHECK(read(lines_of(events, "txyp", seconds, zero_or_one, ' '), options) == events);
  options.layout.time_unit = TimeUnit::microseconds;
  for (const char* fraction : {".0", ".25"}) {
    const auto time = [&](Timestamp t) { return std::to_string(t) + fraction; };
    CHECK(read(lines_of(events, "txyp", time, zero_or_one, ' '), options) == events);
  }
  for (Event& event : events) event.t = 7;  // an image of which all pixels fire at once, as a simulator may have it
  CHECK(read(lines_of(events, "txyp", whole, zero_or_one, ' '), options) == events);
}

TEST_CASE("CsvReader: an index, quoted names, a byte order mark, names in a comment, numbers of numpy.savetxt") {
  const std::vector<Event> expected{{5, 6, 1, 100}, {7, 8, 0, 101}};
  CHECK(read(",x,y,p,t\n0,5,6,1,100\n1,7,8,0,101\n") == expected);                            // pandas
  CHECK(read("\"x\" \"y\" \"p\" \"t_us\"\n\"1\" 5 6 1 100\n\"2\" 7 8 0 101\n") == expected);  // R
  CHECK(read("\tx\ty\tp\tt\n0\t5\t6\t1\t100\n1\t7\t8\t0\t101\n") == expected);
  CHECK(read("0,5,6,1,100\n1,7,8,0,101\n") == expected);  // without names
  CHECK(read("\"t\",\"x\",\"y\",\"p\"\n100,5,6,1\n101,7,8,0\n") == expected);
  CHECK(read("\xEF\xBB\xBFt,x,y,p\n100,5,6,1\n101,7,8,0\n") == expected);
  CHECK(read("\xEF\xBB\xBF%geometry:640,480\n5,6,1,100\n7,8,0,101\n", {}) == expected);
  CHECK(read("# timestamp[us] x y polarity\n100 5 6 1\n101 7 8 0\n") == expected);
  CHECK(read("t,x,y,p\n100,5,6,True\n101,7,8,False\n") == expected);
  CHECK(read("t,x,y,p\n100,5,6,1.0\n101,7,8,-1.0\n") == expected);
  CHECK(read("5.000000000000000000e+00 6.000000000000000000e+00 1.000000000000000000e+00 1.000000000000000000e-04\n"
             "7.000000000000000000e+00 8.000000000000000000e+00 0.000000000000000000e+00 1.010000000000000000e-04\n") ==
        expected);
}

TEST_CASE("CsvReader: sensor sizes and coordinates that events cannot hold are refused with line and value") {
  const std::string events = "5,6,1,100\n7,8,0,101\n";
  for (const char* size :
       {"70000,480", "640,65536", "0,480", "-640,480", "640", "wide,480", "640,480,2", "99999999999,480"}) {
    const std::string error = error_in("%geometry:" + std::string(size) + "\n" + events);
    CHECK_MESSAGE(contains(error, "a.csv: line 1: sensor size is '" + std::string(size) + "'"), error);
  }
  CHECK(contains(error_in("70000 480\n100 5 6 1\n", {}), "line 1: sensor size is '70000 480'"));
  CHECK(contains(error_in("%geometry:65535,65535\n65534,65534,1,100\n65535,0,1,101\n7,8,0,102\n"),
                 "line 3: x is '65535'"));
  CHECK(contains(error_in("5,6,1,100\n5,65541,1,101\n7,8,0,102\n"), "line 2: y is '65541'"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   read(events, {.sensor_size = SensorSize{65537, 480}});
                 }),
                 "sensor_size is 65537 x 480"));
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
                               "700,1,1,104\n2,2,1,90\n3,3,0,95\n");
  CsvReader reader(path, {.shift_first_time_to_zero = true});
  CHECK(drain(reader) == std::vector<Event>{{1, 1, 1, 0}, {2, 2, 1, -10}, {3, 3, 0, -5}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 3, .off_sensor = 4, .time_steps_back = 1});
}

TEST_CASE("CsvReader: one clear line for a file that cannot be read") {
  CHECK(contains(error_in(""), "a.csv: the file is empty"));
  CHECK(contains(error_in("5,6,1,100\n", {}), "no sensor size: give it, --size 640,480 (in the options: sensor_size)"));
  CHECK(contains(error_in("this is a letter\nto someone\n"), "cannot recognise the columns"));
  CHECK(contains(error_in("5,6\n7,8\n"), "cannot recognise the columns"));
  CHECK(contains(error_of([&] { CsvReader("/no/such/file.csv", kSize); }), "/no/such/file.csv: cannot open"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   read("5,6,1,100\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "xyp"}});
                 }),
                 "columns is 'xyp'"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   read("5,6,1,100\n", {.sensor_size = SensorSize{640, 480}, .layout = {.columns = "x,y,p,t,q"}});
                 }),
                 "columns is 'x,y,p,t,q'"));
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
  CHECK(opened > 400);  // the others' times are a tie
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
