#include "evmarker/io/hdf5_reader.hpp"

#include <doctest/doctest.h>

#include "io/test_support.hpp"

#ifndef EVMARKER_HAS_HDF5

TEST_CASE("open_hdf5: a build without libhdf5 says how to have it") {
  MESSAGE("the other tests of HDF5 are left out: this build has no libhdf5");
  const auto error = evmarker::io::test::error_of([] { evmarker::io::open_hdf5("a.h5", {}); });
  CHECK(
      error ==
      "a.h5: HDF5 recordings need libhdf5, which this build leaves out: install libhdf5-dev and build with evmarker's "
      "component hdf5");
}

#else

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <memory>
#include <numeric>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/io/event_reader.hpp"
#include "io/ecf_chunks.hpp"
#include "io/hdf5_bytes.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

static_assert(EventSource<Hdf5Reader>);

namespace {

constexpr Hdf5Storage kChunks{.chunk_rows = 1000, .deflate_level = 1};

std::filesystem::path write_hdf5(const TemporaryFolder& folder, const Hdf5Bytes& file) {
  return write_file(folder / "a.h5", file.bytes());
}

/// The first time of a file whose times are these.
Timestamp first_time(const std::vector<double>& times, hid_t type, const char* name = "t",
                     std::optional<TimeUnit> unit = std::nullopt) {
  const TemporaryFolder folder;
  Hdf5Bytes file;
  const std::vector<std::int64_t> ones(times.size(), 1);
  for (const char* column : {"events/x", "events/y", "events/p"}) file.add(column, ones, H5T_STD_I32LE);
  file.add(std::string("events/") + name, times, type);
  Hdf5Reader reader(write_hdf5(folder, file), {{.sensor_size = SensorSize{640, 480}}, unit});
  return reader.next_batch()[0].t;
}

}  // namespace

TEST_CASE("Hdf5Reader: DSEC's datasets of a group, with the offset of the times") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 100000, 1, true);
  std::uint64_t steps_back = 0;
  for (std::size_t i = 1; i < events.size(); ++i) steps_back += events[i].t < events[i - 1].t;
  for (const auto& storage : {Hdf5Storage{}, kChunks}) {
    Hdf5Bytes file;
    file.add_columns("events", events, storage);
    file.add("ms_to_idx", std::vector<std::int64_t>(100, 0), H5T_STD_U64LE);
    file.add_number("t_offset", 49599300523);
    Hdf5Reader reader(write_hdf5(folder, file), {{.sensor_size = SensorSize{640, 480}}});
    auto read = drain(reader);
    for (Event& event : read) event.t -= 49599300523;
    CHECK(read == events);
    CHECK(reader.statistics() == RecordingStatistics{.events = events.size(), .time_steps_back = steps_back});
    CHECK(reader.bytes_read() == reader.bytes_total());
    CHECK(reader.bytes_total() == std::filesystem::file_size(folder / "a.h5"));
    CHECK(reader.next_batch().empty());
  }
}

TEST_CASE("Hdf5Reader: Prophesee's compounds, with their sensor size") {
  const TemporaryFolder folder;
  const auto events = random_events({1280, 720}, 40000, 2);
  Hdf5Bytes file;
  file.add_compounds("CD/events", events, kChunks);
  file.add("CD/indexes", std::vector<std::int64_t>(10, 0), H5T_STD_U64LE);
  file.add_attribute("geometry", "1280x720");
  Hdf5Reader reader(write_hdf5(folder, file));
  CHECK(reader.sensor_size() == SensorSize{1280, 720});
  CHECK(drain(reader) == events);
  Hdf5Reader shifted(folder / "a.h5", {{.shift_first_time_to_zero = true}});
  CHECK(shifted.next_batch()[1].t == events[1].t - events[0].t);
}

TEST_CASE("Hdf5Reader: compounds as in memory are kept or left out like others") {
  const TemporaryFolder folder;
  auto events = random_events({640, 480}, 20000, 3);
  Hdf5Bytes file;
  events[9000].p = -1;
  events[9001].x = 640;
  events[9002].t = events[9000].t - 1;
  file.add_compounds("CD/events", events, kChunks);
  file.add_attribute("geometry", "640x480");
  Hdf5Reader reader(write_hdf5(folder, file));
  events[9000].p = 0;
  events.erase(events.begin() + 9001);
  CHECK(drain(reader) == events);
  CHECK(reader.statistics() == RecordingStatistics{.events = events.size(), .off_sensor = 1, .time_steps_back = 1});
}

TEST_CASE("Hdf5Reader: chunks of any length that are not compressed") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 70001, 4);
  for (const hsize_t rows : {10U, 1000U, 8192U, 16384U, 16385U, 40000U, 70001U}) {
    CAPTURE(rows);
    for (const bool as_columns : {false, true}) {
      Hdf5Bytes file;
      if (as_columns)
        file.add_columns("CD/events", events, {.chunk_rows = rows});
      else
        file.add_compounds("CD/events", events, {.chunk_rows = rows});
      file.add_attribute("geometry", "640x480");
      Hdf5Reader reader(write_hdf5(folder, file));
      CHECK(drain(reader) == events);
    }
  }
}

TEST_CASE("Hdf5Reader: a chunk of many pieces is decompressed once") {
  static int decompressed;
  const auto count = [](unsigned flags, std::size_t, const unsigned*, std::size_t bytes, std::size_t*, void**) {
    if ((flags & H5Z_FLAG_REVERSE) != 0) ++decompressed;
    return bytes;
  };
  constexpr H5Z_filter_t kFilter = 300;
  const H5Z_class2_t filter{H5Z_CLASS_T_VERS, kFilter, 1, 1, "counts", nullptr, nullptr, count};
  REQUIRE(H5Zregister(&filter) >= 0);
  constexpr hsize_t kRows = 100000;  // 1.6 MB: what libhdf5 has room for by itself is 1 MB
  constexpr int kChunks = 5;
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, kChunks * kRows, 4);
  Hdf5Bytes file;
  file.add_compounds("CD/events", events, {.chunk_rows = kRows, .filter = kFilter});
  file.add_attribute("geometry", "640x480");
  const auto path = write_hdf5(folder, file);
  decompressed = 0;
  CHECK(drain(*std::make_unique<Hdf5Reader>(path)) == events);
  CHECK(decompressed >= kChunks);
  CHECK(decompressed <= kChunks + 1);  // libhdf5 does so to one of them twice, sometimes
  REQUIRE(H5Zunregister(kFilter) >= 0);
}

TEST_CASE("Hdf5Reader: compounds of numbers of any kind and order of bytes, beside members that are passed over") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 20000, 5);
  struct Row {
    double x, y;
    std::int64_t t;
    std::int64_t p;
  };
  std::vector<Row> rows;
  for (const Event& event : events)
    rows.push_back({static_cast<double>(event.x), static_cast<double>(event.y), event.t, event.p});
  const hid_t in_memory = H5Tcreate(H5T_COMPOUND, sizeof(Row));
  H5Tinsert(in_memory, "x", offsetof(Row, x), H5T_NATIVE_DOUBLE);
  H5Tinsert(in_memory, "y", offsetof(Row, y), H5T_NATIVE_DOUBLE);
  H5Tinsert(in_memory, "t", offsetof(Row, t), H5T_NATIVE_INT64);
  H5Tinsert(in_memory, "p", offsetof(Row, p), H5T_NATIVE_INT64);
  const std::array<hsize_t, 1> many{300};
  const hid_t name = H5Tcopy(H5T_C_S1), long_array = H5Tarray_create2(H5T_STD_I8LE, 1, many.data());
  H5Tset_size(name, H5T_VARIABLE);
  const hid_t none = H5T_STD_U8BE;
  for (const hid_t beside : {none, name, long_array}) {  // the last two are read column by column
    const std::size_t bytes = 8 + 4 + 8 + 1 + H5Tget_size(beside);
    const hid_t stored = H5Tcreate(H5T_COMPOUND, bytes);
    H5Tinsert(stored, "x", 0, H5T_IEEE_F64BE);
    H5Tinsert(stored, "beside", 21, beside);
    H5Tinsert(stored, "y", 8, H5T_IEEE_F32LE);
    H5Tinsert(stored, "t", 12, H5T_STD_U64BE);
    H5Tinsert(stored, "p", 20, H5T_STD_I8LE);
    Hdf5Bytes file;
    file.add("CD/events", {rows.size()}, stored, in_memory, rows.data(), kChunks);
    file.add_attribute("geometry", "640x480");
    Hdf5Reader reader(write_hdf5(folder, file));
    CHECK(drain(reader) == events);
    H5Tclose(stored);
  }
  for (const hid_t type : {in_memory, name, long_array}) H5Tclose(type);
}

TEST_CASE("Hdf5Reader: numbers that no coordinate or time can be, of any kind, are off the sensor or an error") {
  const TemporaryFolder folder, other_folder;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::vector<double> x{1, 1e300, -kInfinity, -1, 2};
  Hdf5Bytes file;
  file.add("events/x", x, H5T_IEEE_F64LE);
  file.add("events/y", std::vector<std::int64_t>{3, 3, 3, 3, 3}, H5T_STD_U64LE);
  file.add("events/p", std::vector<double>{0, 1, 1, 1, 1}, H5T_IEEE_F32LE);
  file.add("events/t", std::vector<std::int64_t>{1, 2, 3, 4, 5}, H5T_STD_U32LE);
  Hdf5Reader reader(write_hdf5(folder, file), {{SensorSize{640, 480}}, TimeUnit::microseconds});
  CHECK(drain(reader) == std::vector<Event>{{1, 3, 0, 1}, {2, 3, 1, 5}});
  CHECK(reader.statistics().off_sensor == 3);

  Hdf5Bytes late;
  const std::vector<std::uint64_t> t{7, std::numeric_limits<std::uint64_t>::max()};
  for (const char* column : {"events/x", "events/y", "events/p"})
    late.add(column, std::vector<std::int64_t>{1, 1}, H5T_STD_U8LE);
  late.add("events/t", {2}, H5T_STD_U64LE, H5T_NATIVE_UINT64, t.data());
  Hdf5Reader of_late(write_hdf5(other_folder, late), {{SensorSize{640, 480}}, TimeUnit::seconds});
  CHECK(of_late.next_batch().size() == 1);
  CHECK(contains(error_of([&] { of_late.next_batch(); }), "no time that microseconds can express"));
}

TEST_CASE("Hdf5Reader: Prophesee's triggers, each among the events of its time, and behind them") {
  const TemporaryFolder folder;
  std::vector<Event> events;
  for (Timestamp t = 0; t < 40000; ++t) events.push_back({5, 6, 1, 100 + 10 * t});  // more than one batch
  std::vector<TriggerEvent> triggers{{0, true, -5}};
  for (Timestamp t = 0; t < 9000; ++t) triggers.push_back({static_cast<int>(t % 2), t % 3 == 0, 100 + 50 * t});
  for (const auto& storage : {Hdf5Storage{}, kChunks}) {
    Hdf5Bytes file;
    file.add_compounds("CD/events", events, kChunks);
    file.add_triggers("EXT_TRIGGER/events", triggers, storage);
    file.add("EXT_TRIGGER/indexes", std::vector<std::int64_t>(10, 0), H5T_STD_U64LE);
    file.add_attribute("geometry", "1280x720");
    Hdf5Reader reader(write_hdf5(folder, file));
    std::vector<TriggerEvent> read;
    Timestamp before = std::numeric_limits<Timestamp>::min();
    for (bool more = true; more;) {
      const auto batch = reader.next_batch();
      more = !batch.empty();
      for (const TriggerEvent& trigger : reader.triggers()) {
        CHECK_MESSAGE((trigger.t > before && (!more || trigger.t <= batch.back().t)), trigger.t);
        read.push_back(trigger);
      }
      if (more) before = batch.back().t;
    }
    CHECK(read == triggers);
    CHECK(reader.statistics().triggers == 9001);
    CHECK(reader.next_batch().empty());
    CHECK(reader.triggers().empty());
  }
  Hdf5Reader shifted(folder / "a.h5", {{.shift_first_time_to_zero = true}});
  CHECK(shifted.next_batch()[0].t == 105);
  CHECK(shifted.triggers()[0] == TriggerEvent{0, true, 0});
}

TEST_CASE("Hdf5Reader: triggers that cannot be read are one line that names them") {
  const TemporaryFolder folder;
  const std::vector<Event> events{{5, 6, 1, 100}};
  const auto error_with = [&](const auto& add) {
    Hdf5Bytes file;
    file.add_compounds("CD/events", events);
    file.add_attribute("geometry", "1280x720");
    add(file);
    return error_of([&] {
      Hdf5Reader reader(write_hdf5(folder, file));
      while (!reader.next_batch().empty()) {
      }
    });
  };
  const std::string place = "a.h5: /EXT_TRIGGER/events: ";
  CHECK(contains(error_with([&](Hdf5Bytes& file) { file.add_compounds("EXT_TRIGGER/events", events); }),
                 place + "it has no member id, must have p, t and id"));
  CHECK(contains(
      error_with([](Hdf5Bytes& file) { file.add("EXT_TRIGGER/events", std::vector<double>{1}, H5T_IEEE_F64LE); }),
      place + "it has no member p"));
  const std::vector<TriggerEvent> negative{{-1, true, 5}}, many(1100000, {0, true, 5});
  CHECK(contains(error_with([&](Hdf5Bytes& file) { file.add_triggers("EXT_TRIGGER/events", negative); }),
                 place + "id is -1, not the number of an input"));
  CHECK(contains(error_with([&](Hdf5Bytes& file) { file.add_triggers("EXT_TRIGGER/events", many, kChunks); }),
                 "a.h5: garbled: 1048577 triggers among 0 events"));
  CHECK(error_with([](Hdf5Bytes& file) { file.add_triggers("EXT_TRIGGER/events", {}); }).empty());
}

TEST_CASE("Hdf5Reader: MVSEC's columns x, y, t [s] and p of the left camera") {
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 40000, 3);
  std::vector<double> rows;
  for (const Event& e : events)
    rows.insert(rows.end(), {double(e.x), double(e.y), 1504645177.0 + 1e-6 * double(e.t), e.p > 0 ? 1.0 : -1.0});
  Hdf5Bytes file;
  const std::vector<double> other(20, 0.0);
  file.add("davis/right/events", {5, 4}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, other.data());
  file.add("davis/left/events", {events.size(), 4}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, rows.data(), kChunks);
  Hdf5Reader reader(write_hdf5(folder, file), {{.sensor_size = SensorSize{346, 260}}});
  auto read = drain(reader);
  for (Event& event : read) event.t -= 1504645177000000;
  CHECK(read == events);
}

TEST_CASE("Hdf5Reader: a group of any name, and names of columns like those of text") {
  const TemporaryFolder folder;
  Hdf5Bytes file;
  file.add("calibration/K", std::vector<double>{1, 2}, H5T_IEEE_F64LE);
  file.add("recorded/xs", std::vector<std::int64_t>{1, 700}, H5T_STD_I16BE);
  file.add("recorded/ys", std::vector<std::int64_t>{2, 3}, H5T_STD_I16BE);
  file.add("recorded/polarity", std::vector<double>{-1, 1}, H5T_IEEE_F32LE);
  file.add("recorded/time_ms", std::vector<double>{0.5, 0.6}, H5T_IEEE_F64LE);
  Hdf5Reader reader(write_hdf5(folder, file), {{.sensor_size = SensorSize{640, 480}}});
  CHECK(drain(reader) == std::vector<Event>{{1, 2, 0, 500}});
  CHECK(reader.statistics() == RecordingStatistics{.events = 1, .off_sensor = 1});
}

TEST_CASE("Hdf5Reader: the unit of the times, by name, kind of number or the events that there are") {
  std::vector<double> seconds, microseconds, nanoseconds;
  for (int i = 0; i < 2000; ++i) {
    microseconds.push_back(1234567 + 137.0 * i);
    seconds.push_back(1e-6 * microseconds.back());
    nanoseconds.push_back(1e3 * microseconds.back() + i % 10);
  }
  CHECK(first_time(seconds, H5T_IEEE_F64LE) == 1234567);
  CHECK(first_time(microseconds, H5T_STD_U32LE) == 1234567);
  CHECK(first_time(microseconds, H5T_IEEE_F64LE) == 1234567);
  CHECK(first_time(nanoseconds, H5T_STD_U64LE) == 1234567);
  CHECK(first_time(nanoseconds, H5T_STD_U64LE, "t_ns") == 1234567);
  std::vector<double> ambiguous;  // 7300 or 7.3 million events a second
  for (int i = 0; i < 2000; ++i) ambiguous.push_back(0.5 + 0.137 * i);
  CHECK(
      contains(error_of([&] { first_time(ambiguous, H5T_IEEE_F64LE); }), "cannot tell the unit of its times: name it"));
  CHECK(first_time(seconds, H5T_IEEE_F64LE, "t", TimeUnit::seconds) == 1234567);
  CHECK(
      contains(error_of([&] { first_time(seconds, H5T_IEEE_F64LE, "t", TimeUnit::microseconds); }),
               "the unit of its times is not us, in which its first 1000 events would come faster than any camera's"));
  CHECK(first_time({5, 6}, H5T_STD_U64LE, "t_ms") == 5000);
  CHECK(first_time({-0.25, 6}, H5T_IEEE_F32LE) == -250000);
}

TEST_CASE("Hdf5Reader: chunks that Prophesee's ECF compresses, without its plugin") {
  const TemporaryFolder folder;
  std::vector<Event> events;
  std::vector<std::string> chunks;
  for (std::size_t chunk = 0; chunk < 3000; ++chunk) {  // more than a batch
    auto of_chunk = ecf_events(chunk % kEcfChunks);
    chunks.push_back(ecf_chunk(chunk % kEcfChunks));
    events.insert(events.end(), of_chunk.begin(), of_chunk.end());
  }
  constexpr std::size_t kFill = 100;  // with what is behind the last event, libhdf5 fills up its chunk
  events.resize(events.size() - kFill);
  Hdf5Bytes file;
  file.add_ecf("CD/events", events.size(), 150, chunks);
  file.add_attribute("geometry", "1280x720");
  Hdf5Reader reader(write_hdf5(folder, file));
  CHECK(drain(reader) == events);
}

TEST_CASE("Hdf5Reader: chunks of ECF that are missing, garbled or no events are named") {
  const TemporaryFolder folder;
  const auto error_with = [&](const std::vector<std::string>& chunks, hsize_t chunk_rows = 150) {
    Hdf5Bytes file;
    file.add_ecf("CD/events", 2 * chunk_rows, chunk_rows, chunks);
    file.add_attribute("geometry", "1280x720");
    return error_of([&] {
      Hdf5Reader reader(write_hdf5(folder, file));
      drain(reader);
    });
  };
  const std::string good = ecf_chunk(0), place = "a.h5: /CD/events: ";
  CHECK(error_with({good, good}).empty());
  CHECK(contains(error_with({good, good.substr(0, 50)}),
                 place + "cannot be read from event 0 on: the chunk of event 150: garbled: a field of"));
  CHECK(contains(error_with({good}), place + "it states 300 numbers, but holds 150: cut off?"));
  CHECK(contains(error_with({good, good}, 100), "the chunk of event 0: garbled: not all events are in it"));
  CHECK(contains(error_with({good, good}, 70000), "its chunks have 70000 events, of which ECF has at most 65535"));
  CHECK(
      contains(error_with({std::string(10000, '\xF1'), good}), "the chunk of event 0: garbled: it has too many bytes"));
}

TEST_CASE("Hdf5Reader: a filter's plugin is named where it is missing") {
  const TemporaryFolder folder;
  const auto identity = [](unsigned, std::size_t, const unsigned*, std::size_t bytes, std::size_t*, void**) {
    return bytes;
  };
  constexpr H5Z_filter_t kZstd = 32015;
  const H5Z_class2_t zstd{H5Z_CLASS_T_VERS, kZstd, 1, 1, "ZSTD", nullptr, nullptr, identity};
  REQUIRE(H5Zregister(&zstd) >= 0);
  const auto events = random_events({640, 480}, 5000, 4);
  {
    Hdf5Bytes file;
    file.add_compounds("CD/events", events, {.chunk_rows = 1000, .filter = kZstd});
    file.add_attribute("geometry", "640x480");
    Hdf5Reader reader(write_hdf5(folder, file));
    CHECK(drain(reader) == events);
  }
  REQUIRE(H5Zunregister(kZstd) >= 0);
  const std::string error = error_of([&] { Hdf5Reader reader(folder / "a.h5"); });
  CHECK(contains(error,
                 "a.h5: /CD/events: it is compressed by ZSTD (filter 32015), whose plugin libhdf5 does not "
                 "find: install it ("));
}

TEST_CASE("Hdf5Reader: one clear line for what cannot be read") {
  const TemporaryFolder folder;
  const auto error_for = [&](const Hdf5Bytes& file) {
    const std::string error = error_of([&] {
      Hdf5Reader reader(write_hdf5(folder, file), {{.sensor_size = SensorSize{640, 480}}});
    });
    CHECK(error.find('\n') == std::string::npos);
    return error;
  };
  const std::vector<std::int64_t> three(3, 1), two(2, 1);
  Hdf5Bytes nothing, uneven, missing, unwritten, long_chunks;
  nothing.add("events/x", three, H5T_STD_I32LE);
  CHECK(contains(error_for(nothing), "a.h5: no events in it: neither a group of four datasets"));
  for (const char* column : {"e/x", "e/y", "e/t"}) uneven.add(column, three, H5T_STD_I32LE);
  uneven.add("e/p", two, H5T_STD_I32LE);
  CHECK(contains(error_for(uneven), "/e: its columns have 3 and 2 numbers, must have the same"));
  missing.add_columns("events", random_events({640, 480}, 100, 1));
  CHECK(contains(error_of([&] { Hdf5Reader reader(write_hdf5(folder, missing)); }), "a.h5: no sensor size in it"));

  const hsize_t most = hsize_t{1} << 60;
  unwritten.add("CD/events", {most, 4}, H5T_STD_I64LE, H5T_NATIVE_INT64, nullptr, {.chunk_rows = 1000});
  CHECK(contains(error_for(unwritten), "/CD/events: it states 4611686018427387904 numbers, but holds 0: cut off?"));
  long_chunks.add("events", {1 << 22, 4}, H5T_STD_I64LE, H5T_NATIVE_INT64, nullptr, {.chunk_rows = 1 << 21});
  CHECK(
      contains(error_for(long_chunks), "/events: its chunks have 67108864 bytes, of which at most 33554432 are read"));

  CHECK(contains(error_of([&] { Hdf5Reader reader(folder / "none.h5"); }), "none.h5: cannot be read as HDF5, missing"));
  const Fifo fifo(folder / "fifo", missing.bytes());
  CHECK(contains(error_of([&] { Hdf5Reader reader(folder / "fifo"); }), "from files alone, not from pipes"));
}

TEST_CASE("Hdf5Reader: times that are no numbers or too large, once all events before them are delivered") {
  const TemporaryFolder folder;
  const std::vector<std::int64_t> ones(40000, 1);
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), 1e300}) {
    std::vector<double> times(ones.size());
    std::iota(times.begin(), times.end(), 0.5);
    times[35000] = wrong;
    Hdf5Bytes file;
    for (const char* column : {"events/x", "events/y", "events/p"}) file.add(column, ones, H5T_STD_I32LE);
    file.add("events/t", times, H5T_IEEE_F64LE);
    Hdf5Reader reader(write_hdf5(folder, file), {{.sensor_size = SensorSize{640, 480}}, TimeUnit::microseconds});
    std::size_t read = 0;
    const std::string error = error_of([&] {
      for (auto batch = reader.next_batch(); !batch.empty(); batch = reader.next_batch()) read += batch.size();
    });
    CHECK(read == 35000);
    CHECK(contains(error, "a.h5: /events: t of event 35000 is "));
  }
}

TEST_CASE("Hdf5Reader: cut anywhere, it is refused") {
  const TemporaryFolder folder;
  Hdf5Bytes file;
  file.add_columns("events", random_events({640, 480}, 5000, 4), kChunks);
  const std::string whole = file.bytes();
  for (std::size_t cut = 0; cut < whole.size(); cut += 499) {
    const auto path = write_file(folder / "a.h5", whole.substr(0, cut));
    CHECK(contains(error_of([&] { Hdf5Reader reader(path, {{.sensor_size = SensorSize{640, 480}}}); }), "cut off"));
  }
}

TEST_CASE("Hdf5Reader: ends on request") {
  const TemporaryFolder folder;
  Hdf5Bytes file;
  file.add_columns("events", random_events({640, 480}, 100000, 4));
  std::atomic<bool> stop = false;
  EventReader reader(write_hdf5(folder, file), {.sensor_size = SensorSize{640, 480}, .stop = &stop});
  CHECK(reader.kind() == RecordingKind::hdf5);
  CHECK_FALSE(reader.next_batch().empty());
  stop = true;
  CHECK(reader.next_batch().empty());
}

TEST_CASE("Hdf5Reader: a real file of four datasets, times in seconds, polarities True and False") {
  const auto path = real_recording("formats/plain_events.hdf5");
  if (path.empty()) return;
  Hdf5Reader reader(path, {{.sensor_size = SensorSize{346, 260}}});
  const auto events = drain(reader);
  REQUIRE(events.size() == 17);
  CHECK(events.front() == Event{134, 30, 0, 0});
  CHECK(events[1] == Event{59, 158, 0, 780});
  CHECK(events.back() == Event{74, 181, 0, 5748});
  CHECK(reader.statistics() == RecordingStatistics{.events = 17});
}

#endif
