#include "evmarker/io/raw_writer.hpp"

#include <doctest/doctest.h>

#include <stdexcept>

#include "evmarker/io/raw_reader.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

TEST_CASE("RawWriter: what is written is read back, events and triggers") {
  const TemporaryFolder folder;
  for (const RawFormat format : {RawFormat::evt2, RawFormat::evt3}) {
    const auto events = random_events({1280, 720}, 200000, 21, true);
    const std::vector<TriggerEvent> triggers{{3, true, 50}, {3, false, events.back().t}};
    RawWriter writer(folder / "a.raw", {1280, 720}, format);
    writer.write_trigger(triggers[0]);
    writer.write(std::span(events).first(100000));
    for (const Event& event : std::span(events).subspan(100000, 1000)) writer.write(event);
    writer.write(std::span(events).subspan(101000));
    writer.write_trigger(triggers[1]);
    writer.close();
    writer.close();
    CHECK(writer.events_written() == events.size());

    RawReader reader(folder / "a.raw");
    CHECK(reader.sensor_size() == SensorSize{1280, 720});
    CHECK(reader.header().format == format);
    std::vector<TriggerEvent> read_triggers;
    CHECK(drain(reader, &read_triggers) == events);
    CHECK(read_triggers == triggers);
    CHECK(reader.statistics().time_steps_back > 100);
    CHECK(reader.statistics().truncated_bytes == 0);
  }
}

TEST_CASE("RawWriter: a polarity of -1 is OFF") {
  const TemporaryFolder folder;
  RawWriter writer(folder / "a.raw", {10, 10});
  writer.write(Event{1, 2, -1, 3});
  writer.close();
  RawReader reader(folder / "a.raw");
  CHECK(drain(reader) == std::vector<Event>{{1, 2, 0, 3}});
}

TEST_CASE("RawWriter: the file appears complete or not at all") {
  const TemporaryFolder folder;
  write_file(folder / "a.raw", "old");
  try {
    RawWriter writer(folder / "a.raw", {10, 10});
    writer.write(std::vector<Event>{{1, 2, 1, 3}});
    CHECK(std::filesystem::exists(folder / "a.raw.part"));
    throw std::runtime_error("before close");
  } catch (const std::runtime_error&) {
  }
  CHECK(read_file(folder / "a.raw") == "old");
  CHECK(folder.files() == 1);

  RawWriter writer(folder / "a.raw", {10, 10});
  RawWriter moved = std::move(writer);
  moved.write(std::vector<Event>{{1, 2, 1, 3}});
  moved.close();
  CHECK(folder.files() == 1);
  CHECK(read_file(folder / "a.raw").starts_with("% "));
  CHECK(contains(error_of([&] { moved.write(std::vector<Event>(1000000, Event{1, 2, 1, 3})); }), "a.raw"));
}

TEST_CASE("RawWriter: assignment removes the unfinished file of the writer assigned to") {
  const TemporaryFolder folder;
  RawWriter writer(folder / "a.raw", {10, 10});
  writer = RawWriter(folder / "b.raw", {10, 10});
  CHECK(folder.files() == 1);
  writer.close();
  CHECK(std::filesystem::exists(folder / "b.raw"));
}

TEST_CASE("RawWriter: devices are written directly") {
  RawWriter writer("/dev/null", {10, 10});
  writer.write(Event{1, 2, 1, 3});
  writer.close();
  CHECK(std::filesystem::is_character_file("/dev/null"));
  CHECK(!std::filesystem::exists("/dev/null.part"));
}

TEST_CASE("RawWriter: one clear line for what cannot be written") {
  const TemporaryFolder folder;
  const auto refuse = [&](const Event& event) {
    RawWriter writer(folder / "a.raw", {640, 480});
    writer.write(Event{1, 1, 1, 1});
    return error_of<std::invalid_argument>([&] { writer.write(event); });
  };
  CHECK(contains(refuse({640, 0, 1, 1}), "event 1: x is 640"));
  CHECK(contains(refuse({0, 480, 1, 1}), "event 1: y is 480"));
  CHECK(contains(refuse({0, 0, 1, -7}), "event 1: t is -7"));
  CHECK(refuse({639, 479, 1, 0}).empty());
  CHECK(folder.files() == 0);

  const auto open = [&](SensorSize size, RawFormat format) {
    return error_of<std::invalid_argument>([&] { RawWriter(folder / "a.raw", size, format); });
  };
  CHECK(contains(open({0, 480}, RawFormat::evt3), "width is 0"));
  CHECK(contains(open({640, 2049}, RawFormat::evt3), "height is 2049"));
  CHECK(contains(open({640, 480}, RawFormat::evt21), "EVT2.1"));
  CHECK(contains(error_of([&] { RawWriter(folder / "no/such/folder.raw", {10, 10}); }), "cannot create: No such file"));
  CHECK(contains(error_of([&] { RawWriter(folder / ".", {10, 10}); }), "is a directory"));
  CHECK(folder.files() == 0);
}

TEST_CASE("RawWriter: a full disk is reported") {
  if (!std::filesystem::exists("/dev/full")) {
    MESSAGE("skipped: no /dev/full");
    return;
  }
  const std::string error = error_of([&] {
    RawWriter writer("/dev/full", {10, 10});
    writer.write(Event{1, 2, 1, 3});
    writer.close();
  });
  CHECK(contains(error, "/dev/full: cannot write: No space left"));
}
