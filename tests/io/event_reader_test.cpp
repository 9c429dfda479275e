#include "evmarker/io/event_reader.hpp"

#include <doctest/doctest.h>

#include <future>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/io/csv_writer.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "io/recording_bytes.hpp"
#include "io/ros_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

static_assert(EventSource<EventReader>);

TEST_CASE("EventReader: the same events from every kind, whatever the file name") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 5000, 1);
  write_and_close(RawWriter(folder / "a.raw", {640, 480}, RawFormat::evt2), events);
  write_and_close(RawWriter(folder / "b", {640, 480}, RawFormat::evt3), events);
  write_and_close(CsvWriter(folder / "c.csv", {640, 480}), events);
  write_and_close(CsvWriter(folder / "d.TXT", {640, 480}), events);
  write_file(folder / "e.bin", make_dat(events, {640, 480}));
  write_file(folder / "f", make_aedat2(events, {640, 480}));
  write_file(folder / "g", make_aedat3(events, {640, 480}));
  write_file(folder / "h", make_aedat4(events, {640, 480}));
  write_file(folder / "i", make_mcap(events, {640, 480}, RosEvents::evt3));
  write_file(folder / "j", make_rosbag(events, {640, 480}, RosEvents::array));
  for (const auto& [name, kind] : {std::pair{"a.raw", RecordingKind::raw}, std::pair{"b", RecordingKind::raw},
                                   std::pair{"c.csv", RecordingKind::text}, std::pair{"d.TXT", RecordingKind::text},
                                   std::pair{"e.bin", RecordingKind::dat}, std::pair{"f", RecordingKind::aedat2},
                                   std::pair{"g", RecordingKind::aedat3}, std::pair{"h", RecordingKind::aedat4},
                                   std::pair{"i", RecordingKind::mcap}, std::pair{"j", RecordingKind::rosbag}}) {
    EventReader reader(folder / name);
    CHECK(reader.kind() == kind);
    CHECK(reader.sensor_size() == SensorSize{640, 480});
    CHECK(drain(reader) == events);
    CHECK(reader.statistics().events == events.size());
    CHECK(reader.bytes_read() == reader.bytes_total());
    EventReader shifted(folder / name, {.shift_first_time_to_zero = true});
    CHECK(shifted.next_batch().front().t == 0);
  }
}

TEST_CASE("EventReader: a FIFO yields the events of the file, long and short") {
  const TemporaryFolder folder;
  for (const std::size_t count : {std::size_t{3}, std::size_t{3000}, std::size_t{300000}}) {
    const auto events = random_events({640, 480}, count, 4);
    write_and_close(RawWriter(folder / "evt2", {640, 480}, RawFormat::evt2), events);
    write_and_close(RawWriter(folder / "evt3", {640, 480}, RawFormat::evt3), events);
    write_and_close(CsvWriter(folder / "text", {640, 480}), events);
    write_file(folder / "dat", make_dat(events, {640, 480}));
    write_file(folder / "aedat2", make_aedat2(events, {640, 480}));
    write_file(folder / "aedat3", make_aedat3(events, {640, 480}));
    write_file(folder / "aedat4", make_aedat4(events, {640, 480}));
    write_file(folder / "mcap", make_mcap(events, {640, 480}, RosEvents::libcaer));
    write_file(folder / "rosbag", make_rosbag(events, {640, 480}, RosEvents::mono));
    for (const char* name : {"evt2", "evt3", "text", "dat", "aedat2", "aedat3", "aedat4", "mcap", "rosbag"}) {
      CAPTURE(name);
      CAPTURE(count);
      const auto path = folder / "fifo";
      Fifo fifo(path, read_file(folder / name));
      auto end = std::async(std::launch::async, [&] { fifo.end(); });
      EventReader reader(path);
      CHECK(reader.bytes_total() == 0);
      CHECK(reader.sensor_size() == SensorSize{640, 480});
      CHECK(drain(reader) == events);
      CHECK(reader.bytes_read() == std::filesystem::file_size(folder / name));
      end.get();
      std::filesystem::remove(path);
    }
  }
}

TEST_CASE("EventReader: a silent FIFO prevents neither the end of the reader nor that of reading on request") {
  const TemporaryFolder folder;
  const auto events = random_events({640, 480}, 100000, 5);
  write_and_close(RawWriter(folder / "a.raw", {640, 480}, RawFormat::evt2), events);
  REQUIRE(std::filesystem::file_size(folder / "a.raw") > 2 * BlockReader::kPipeBlockBytes);
  const Fifo fifo(folder / "fifo", read_file(folder / "a.raw"));
  {
    EventReader reader(folder / "fifo");
    CHECK_FALSE(reader.next_batch().empty());
  }
  const Fifo other(folder / "other", read_file(folder / "a.raw"));
  std::atomic<bool> stop = false;
  EventReader reader(folder / "other", {.stop = &stop});
  CHECK_FALSE(reader.next_batch().empty());
  auto rest = std::async(std::launch::async, [&] { return drain(reader).size(); });
  stop = true;
  CHECK(rest.get() < events.size());
}

TEST_CASE("EventReader: a recording that is stopped before its first byte is not called empty") {
  const TemporaryFolder folder;
  const Fifo silent(folder / "silent", "");
  std::atomic<bool> stop = false;
  auto error = std::async(std::launch::async,
                          [&] { return error_of([&] { EventReader(folder / "silent", {.stop = &stop}); }); });
  stop = true;
  CHECK(contains(error.get(), "silent: stopped before its first byte"));
}

TEST_CASE("EventReader: options reach the reader") {
  const TemporaryFolder folder;
  const auto path = write_file(folder / "a.txt", "6 5 1 100\n");
  CHECK(contains(error_of([&] { EventReader reader(path); }), "no sensor size"));
  EventReader reader(path, {.sensor_size = SensorSize{64, 48}, .text_layout = {.columns = "yxpt"}});
  CHECK(drain(reader) == std::vector<Event>{{5, 6, 1, 100}});
  EventReader raw(write_file(folder / "b.raw", "% evt 2.0\n% end\n"), {.sensor_size = SensorSize{64, 48}});
  CHECK(raw.sensor_size() == SensorSize{64, 48});
  write_file(folder / "c", make_mcap({}, {64, 48}, RosEvents::array));
  CHECK(contains(error_of([&] { EventReader ros(folder / "c", {.topic = "/left"}); }), "topic is '/left', of which"));
}

TEST_CASE("EventReader: unsupported kinds are reported by name, by content or extension") {
  using namespace std::string_literals;
  const TemporaryFolder folder;
  CHECK(refuses<EventReader>(folder / "a.dat", "\x01\x02", "not a DAT recording"));
  CHECK(refuses<EventReader>(folder / "a", "#!AER-DAT1.0\r\n", "other AEDAT recordings are not supported"));
  CHECK(refuses<EventReader>(folder / "a", "#ROSBAG V1.2\n", "other rosbag recordings are not"));
  CHECK(refuses<EventReader>(folder / "a.BAG", "\x01\x02", "rosbag"));
  CHECK(refuses<EventReader>(folder / "a.mp4", "\x01\x02",
                             "Supported are: Prophesee RAW (EVT2, EVT2.1, EVT3), DAT, AEDAT 2, 3.1 and 4, HDF5, "
                             "ROS (rosbag, MCAP, SQLite), text"));
  CHECK(refuses<EventReader>(folder / "a.raw", "\x01\x02", "not a Prophesee RAW recording"));
  CHECK(refuses<EventReader>(folder / "a.csv", "", "a.csv: the file is empty"));
  CHECK(contains(error_of([&] { EventReader(folder / "none.raw"); }), "none.raw: cannot open"));
}

TEST_CASE("EventReader: a calibration or a board is called so, by content or extension, but events never are") {
  const TemporaryFolder folder;
  const std::string board = "board: 100\nmarkers:\n", settings = "is no recording but settings, like the calibration";
  for (const char* name : {"a.yml", "a.YAML", "a.json", "a.xml"})
    CHECK(refuses<EventReader>(folder / name, board, name + (": " + settings)));
  CHECK(refuses<EventReader>(folder / "a.csv", "%YAML:1.0\n---\nimage_width: 640\n", "a.csv: " + settings));
  write_file(folder / "events.yml", "% evt 3.0\n% geometry 640x480\n% end\n");
  CHECK(EventReader(folder / "events.yml").kind() == RecordingKind::raw);
}

TEST_CASE("EventReader: what is compressed is called so, with the command that unpacks it") {
  const TemporaryFolder folder;
  CHECK(refuses<EventReader>(folder / "a.raw", "\x1f\x8b\x08", "a.raw: is compressed by gzip, unpack it: gunzip <"));
  CHECK(refuses<EventReader>(folder / "a.raw", "\x1f\x8b\x08", "a.raw' >'unpacked_a.raw'"));
  CHECK(refuses<EventReader>(folder / "a", "\x28\xb5\x2f\xfd", "zstd, unpack it: unzstd <"));
  CHECK(refuses<EventReader>(folder / "a.csv", "BZh91AY&SY", "bzip2, unpack it: bunzip2 <"));
  CHECK(refuses<EventReader>(folder / "a.raw",
                             "\xfd"
                             "7zXZ",
                             "xz, unpack it: unxz <"));
}

TEST_CASE("EventReader: real recordings of every kind are recognised by their content") {
  struct Real {
    const char* name;
    RecordingKind kind;
    SensorSize size;
    std::size_t events;
  };
  for (const auto& real : {Real{"formats/sparklers_evt2.raw", RecordingKind::raw, {640, 480}, 521252},
                           Real{"flip/events.csv", RecordingKind::text, {128, 128}, 175136},
                           Real{"formats/ncars.dat", RecordingKind::dat, {64, 64}, 4407},
                           Real{"formats/translating_square.aedat", RecordingKind::aedat2, {240, 180}, 16000},
                           Real{"formats/davis_lz4.aedat4", RecordingKind::aedat4, {320, 240}, 111954},
                           Real{"formats/tags.mcap", RecordingKind::mcap, {346, 260}, 571266},
                           Real{"formats/events_1.bag", RecordingKind::rosbag, {640, 480}, 343474},
                           Real{"formats/libcaer_rollover.db3", RecordingKind::rosbag2, {640, 480}, 334331},
                           Real{"formats/plain_events.hdf5", RecordingKind::hdf5, {346, 260}, 17}}) {
    CAPTURE(real.name);
    const auto& [name, kind, size, events] = real;
    const auto path = real_recording(name);
    if (path.empty()) continue;
    const std::string error = error_of([&, kind = kind, size = size, events = events] {
      EventReader reader(path, {.sensor_size = size});
      CHECK(reader.kind() == kind);
      CHECK(reader.sensor_size() == size);
      CHECK(drain(reader).size() == events);
    });
    if (contains(error, "which this build leaves out"))
      MESSAGE("skipped: " << error);
    else
      CHECK(error == "");
  }
}
