#include "evmarker/io/event_writer.hpp"

#include <doctest/doctest.h>

#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "evmarker/io/event_reader.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

#ifdef EVMARKER_HAS_HDF5
const std::vector<WrittenFormat> kWritten{WrittenFormat::evt2, WrittenFormat::evt3, WrittenFormat::csv,
                                          WrittenFormat::hdf5};
#else
const std::vector<WrittenFormat> kWritten{WrittenFormat::evt2, WrittenFormat::evt3, WrittenFormat::csv};
#endif

Event event_at(Timestamp t) { return {1, 2, 1, t}; }

}  // namespace

TEST_CASE("format_by_extension: the formats of customary extensions, in either case") {
  CHECK(format_by_extension("a.raw") == WrittenFormat::evt3);
  CHECK(format_by_extension("b/A.RAW") == WrittenFormat::evt3);
  CHECK(format_by_extension("a.csv") == WrittenFormat::csv);
  CHECK(format_by_extension("a.txt") == WrittenFormat::csv);
  CHECK(format_by_extension("a.h5") == WrittenFormat::hdf5);
  CHECK(format_by_extension("a.raw.hdf5") == WrittenFormat::hdf5);
  CHECK_FALSE(format_by_extension("a.dat"));
  CHECK_FALSE(format_by_extension("raw"));
}

TEST_CASE("create_recording: every format gives the same events, and RAW the triggers") {
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 50000, 41);
  const std::vector<TriggerEvent> triggers{{3, true, events[100].t}, {5, false, events.back().t}};
  for (const WrittenFormat format : kWritten) {
    CAPTURE(to_string(format));
    const auto writer = create_recording(folder / "recording", {346, 260}, format);
    const bool raw = format == WrittenFormat::evt2 || format == WrittenFormat::evt3;
    CHECK(writer->sensor_size() == SensorSize{346, 260});
    CHECK(writer->count_writable(events) == events.size());
    for (const TriggerEvent& trigger : triggers) {
      CHECK(writer->can_write(trigger) == raw);
      if (raw) writer->write_trigger(trigger);
      if (!raw) CHECK_THROWS_AS(writer->write_trigger(trigger), std::invalid_argument);
      writer->write(std::span(events).subspan(trigger == triggers[0] ? 0 : events.size() / 2, events.size() / 2));
    }
    writer->close();
    CHECK(writer->events_written() == events.size());
    EventReader reader(folder / "recording");
    std::vector<TriggerEvent> read_triggers;
    CHECK(reader.sensor_size() == SensorSize{346, 260});
    CHECK(drain(reader, &read_triggers) == events);
    CHECK(read_triggers == (raw ? triggers : std::vector<TriggerEvent>()));
  }
}

TEST_CASE("RecordingWriter: tells which times and triggers the format cannot express, before it would throw") {
  const TemporaryFolder folder;
  constexpr Timestamp evt3_wrap = Timestamp{1} << 24, evt2_wrap = Timestamp{1} << 34;  // of the formats' clocks
  constexpr Timestamp last = std::numeric_limits<Timestamp>::max();
  struct Case {
    Timestamp before, t;
    bool evt2, evt3, csv;
  };
  for (const auto& times : std::vector<Case>{{0, 5, true, true, true},
                                             {0, -1, false, false, false},
                                             {50, 20, true, true, true},
                                             {evt3_wrap, evt3_wrap - 1, true, false, true},
                                             {evt3_wrap + 1, evt3_wrap, true, true, true},
                                             {evt2_wrap, evt2_wrap - 1, false, false, true},
                                             {0, (evt3_wrap << 17) + evt3_wrap - 1, true, true, true},
                                             {0, (evt3_wrap << 17) + evt3_wrap, true, false, true},
                                             {0, last, false, false, true}}) {
    CAPTURE(times.before);
    CAPTURE(times.t);
    const auto& [before, t, evt2, evt3, csv] = times;
    for (const auto& writable :
         {std::pair(WrittenFormat::evt2, evt2), {WrittenFormat::evt3, evt3}, {WrittenFormat::csv, csv}}) {
      CAPTURE(to_string(writable.first));
      const auto& [format, expected] = writable;
      const auto writer = create_recording("/dev/null", {10, 10}, format);
      const std::vector<Event> events{event_at(before), event_at(t), event_at(t)};
      CHECK(writer->count_writable(events) == (expected ? 3 : 1));
      writer->write(std::span(events).first(1));
      CHECK(writer->count_writable(std::span(events).subspan(1)) == (expected ? 2 : 0));
      if (format != WrittenFormat::csv) CHECK(writer->can_write({1, true, t}) == expected);
      CHECK(error_of<std::invalid_argument>([&] { writer->write(std::span(events).subspan(1)); }).empty() == expected);
    }
  }
  const auto evt2 = create_recording("/dev/null", {10, 10}, WrittenFormat::evt2);
  const auto evt3 = create_recording("/dev/null", {10, 10}, WrittenFormat::evt3);
  for (const auto& [id, in_evt2, in_evt3] :
       {std::tuple(-1, false, false), {15, true, true}, {16, true, false}, {31, true, false}, {32, false, false}}) {
    CHECK(evt2->can_write({id, true, 0}) == in_evt2);
    CHECK(evt3->can_write({id, true, 0}) == in_evt3);
  }
}
