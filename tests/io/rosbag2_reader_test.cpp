#include "evmarker/io/rosbag2_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>

#include "evmarker/events/event_stream.hpp"
#include "io/recording_bytes.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag2_file.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

#ifdef EVMARKER_HAS_SQLITE3

static_assert(EventSource<Rosbag2Reader>);

namespace {

constexpr SensorSize kBag2Size{346, 260};

std::string bag2_events(std::span<const Event> events) { return event_array(kBag2Size, events, true); }

}  // namespace

TEST_CASE("Rosbag2Reader: every encoding of events, among another topic's messages") {
  const TemporaryFolder folder;
  const auto events = random_events(kBag2Size, 30000, 5, true);
  std::uint64_t steps_back = 0;
  for (std::size_t i = 1; i < events.size(); ++i) steps_back += events[i].t < events[i - 1].t;
  const auto path = folder / "a bag, 100%?#.db3";  // a name with all that an address of SQLite means otherwise
  for (const auto kind :
       {RosEvents::array, RosEvents::mono, RosEvents::libcaer_cmp, RosEvents::evt3, RosEvents::libcaer}) {
    write_rosbag2(path, events, kBag2Size, kind);
    Rosbag2Reader reader(path);
    CHECK(reader.sensor_size() == kBag2Size);
    CHECK(reader.bytes_read() < reader.bytes_total() / 10);
    CHECK(drain(reader) == events);
    CHECK(reader.statistics() == RecordingStatistics{.events = events.size(), .time_steps_back = steps_back});
    CHECK(reader.bytes_read() == reader.bytes_total());
    CHECK(reader.bytes_total() == std::filesystem::file_size(path));
    CHECK(reader.next_batch().empty());
  }
  CHECK(folder.files() == 1);  // none beside it
}

TEST_CASE("Rosbag2Reader: messages that are compressed one by one") {
  if (built_compressions({Compression::zstd}).empty()) {
    MESSAGE("skipped: this build has no ZSTD");
    return;
  }
  const TemporaryFolder folder;
  const auto events = random_events(kBag2Size, 5000, 6);
  {
    Rosbag2File file(folder / "a.db3");
    file.add_topic(1, "/events", "dvs_msgs/msg/EventArray");
    for (const std::string& message : event_messages(events, kBag2Size, RosEvents::array, true))
      file.add_message(1, compress(message, Compression::zstd));
  }
  Rosbag2Reader reader(folder / "a.db3");
  CHECK(drain(reader) == events);
}

TEST_CASE("Rosbag2Reader: what was cut off is an error, once all messages before the cut are delivered") {
  const TemporaryFolder folder;
  const auto events = random_events(kBag2Size, 30000, 3);
  write_rosbag2(folder / "whole", events, kBag2Size, RosEvents::array);
  const std::string whole = read_file(folder / "whole");
  std::size_t before = 0;
  for (std::size_t cut = 0; cut < whole.size(); cut += whole.size() / 50) {
    std::vector<Event> read;
    const std::string error = error_of([&] {
      Rosbag2Reader reader(write_file(folder / "a.db3", whole.substr(0, cut)));
      for (auto batch = reader.next_batch(); !batch.empty(); batch = reader.next_batch())
        read.insert(read.end(), batch.begin(), batch.end());
    });
    CHECK(contains(error, "a.db3: SQLite: "));
    CHECK(read.size() >= before);
    CHECK(std::equal(read.begin(), read.end(), events.begin()));
    before = read.size();
  }
  CHECK(before > events.size() * 9 / 10);
}

TEST_CASE("Rosbag2Reader: the topic that is chosen, or the only one of events, else those that are there are listed") {
  const TemporaryFolder folder;
  const Event left{1, 2, 1, 5}, right{3, 4, 0, 6};
  const auto path = folder / "a.db3";
  {
    Rosbag2File file(path);
    file.add_topic(1, "/left", "dvs_msgs/msg/EventArray");
    file.add_topic(2, "/right", "dvs_msgs/msg/EventArray");
    file.add_topic(3, "/imu", "sensor_msgs/msg/Imu");
    file.add_message(1, bag2_events({&left, 1}));
    file.add_message(2, bag2_events({&right, 1}));
    file.add_message(1, bag2_events({&left, 1}));
  }
  const auto events_of = [&](const char* topic) {
    Rosbag2Reader reader(path, {{.topic = topic}});
    return drain(reader);
  };
  CHECK(events_of("/left") == std::vector<Event>{left, left});
  CHECK(events_of("/right") == std::vector<Event>{right});
  CHECK(contains(error_of([&] { events_of(""); }), "a.db3: several topics of events, /left and /right: name one"));
  CHECK(contains(error_of([&] { events_of("/imu"); }), "topic is '/imu', of which no events are in it, but of /left"));
  { Rosbag2File(path).add_topic(1, "/e", "dvs_msgs/msg/EventArray", "proto"); }
  CHECK(contains(error_of([&] { events_of(""); }), "no topic of events in it"));
}

TEST_CASE("Rosbag2Reader: one clear line for what cannot be read") {
  const TemporaryFolder folder;
  const auto path = folder / "a.db3";
  const Event event{1, 2, 1, 5};
  const auto error_of_file = [&](const auto& fill) {
    {
      Rosbag2File file(path);
      file.add_topic(1, "/e", "dvs_msgs/msg/EventArray");
      file.add_message(1, bag2_events({&event, 1}));
      fill(file);
    }
    const std::string error = error_of([&] {
      Rosbag2Reader reader(path);
      drain(reader);
    });
    CHECK(!contains(error, "\n"));
    return error;
  };
  CHECK(error_of_file([](Rosbag2File&) {}) == "");
  CHECK(contains(error_of_file([](Rosbag2File& file) { file.add_message(1, "abc"); }),
                 "a.db3: message of events: garbled: a field of 4 bytes at byte 0 of 3"));
  CHECK(contains(error_of_file([](Rosbag2File& file) { file.execute("DROP TABLE messages"); }),
                 "a.db3: SQLite: no such table: messages"));
  CHECK(contains(error_of_file([](Rosbag2File& file) {
                   file.execute(
                       "DROP TABLE messages; CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 'a' AS data");
                 }),
                 "a.db3: SQLite: "));
  CHECK(contains(error_of_file([](Rosbag2File& file) { file.add_topic(2, "/a\nb", ""); }), "control characters"));
  CHECK(contains(error_of_file([](Rosbag2File& file) {
                   file.execute("INSERT INTO messages VALUES(9, 1, 5, zeroblob(" +
                                std::to_string(Decompressor::kMaxBytes + 1) + "))");
                 }),
                 "a.db3: SQLite: string or blob too big"));
  CHECK(refuses<Rosbag2Reader>(folder / "b", "SQLite format 3 and no more", "b: SQLite: file is not a database"));
  CHECK(contains(error_of([&] { Rosbag2Reader(folder / "none"); }), "none: SQLite: unable to open database file"));
  CHECK(error_of_file([](Rosbag2File&) {}) == "");
  write_file(folder / "a.db3-wal", "pages");
  CHECK(contains(error_of([&] { Rosbag2Reader reader(path); }), "a.db3-wal: close it: sqlite3"));
}

TEST_CASE("Rosbag2Reader: it ends on request, and is not read from a pipe") {
  const TemporaryFolder folder;
  const auto events = random_events(kBag2Size, 30000, 5);
  write_rosbag2(folder / "a.db3", events, kBag2Size, RosEvents::evt3);
  std::atomic<bool> stop = false;
  Rosbag2Reader reader(folder / "a.db3", {{}, &stop});
  CHECK(!reader.next_batch().empty());
  stop = true;
  CHECK(reader.next_batch().empty());
  const Fifo fifo(folder / "fifo", "");
  CHECK(contains(error_of([&] { Rosbag2Reader(folder / "fifo"); }), "read from files alone, not from pipes"));
}

TEST_CASE("Rosbag2Reader: a real recording of a DAVIS in libcaer, whose clock rolls over") {
  // Counts, ends and sums by forty lines of Python that follow the description of the words.
  const auto path = real_recording("formats/libcaer_rollover.db3");
  if (path.empty()) return;
  Rosbag2Reader reader(path);
  CHECK(reader.sensor_size() == SensorSize{640, 480});
  const auto events = drain(reader);
  REQUIRE(events.size() == 334331);
  CHECK(events.front() == Event{233, 349, 1, 1702309120762236});
  CHECK(events.back() == Event{388, 401, 0, 1702309122762222});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 181908);
  std::uint64_t x = 0, y = 0, since_first = 0;
  for (const Event& event : events)
    x += event.x, y += event.y, since_first += static_cast<std::uint64_t>(event.t - events.front().t);
  CHECK(x == 111651612);
  CHECK(y == 82801007);
  CHECK(since_first == 335100158552);
  CHECK(reader.statistics() == RecordingStatistics{.events = 334331});
}

#else

TEST_CASE("Rosbag2Reader: a build without libsqlite3 says so") {
  CHECK(contains(error_of([] { open_rosbag2("a.db3", {}); }),
                 "SQLite recordings of rosbag2 need libsqlite3, which this build leaves out: install libsqlite3-dev"));
}

#endif
