#include "evmarker/io/rosbag_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>

#include "evmarker/events/event_stream.hpp"
#include "io/recording_bytes.hpp"
#include "io/ros_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;
using namespace std::string_literals;

static_assert(EventSource<RosbagReader>);

namespace {

constexpr SensorSize kBagSize{346, 260};

std::string bag_events(int connection, std::span<const Event> events) {
  return bag_message(connection, event_array(kBagSize, events, false));
}

}  // namespace

TEST_CASE("RosbagReader: every encoding of events, in every compression, with and without an index") {
  const TemporaryFolder folder;
  const auto events = random_events(kBagSize, 30000, 5, true);
  std::uint64_t steps_back = 0;
  for (std::size_t i = 1; i < events.size(); ++i) steps_back += events[i].t < events[i - 1].t;
  for (const auto kind :
       {RosEvents::array, RosEvents::mono, RosEvents::libcaer_cmp, RosEvents::evt3, RosEvents::libcaer})
    for (const auto compression : built_compressions(kRosbagCompressions)) {
      CAPTURE(static_cast<int>(kind));
      const std::string bag = make_rosbag(events, kBagSize, kind, compression);
      RosbagReader reader(write_file(folder / "a.bag", bag));
      CHECK(reader.sensor_size() == kBagSize);
      CHECK(drain(reader) == events);
      CHECK(reader.statistics() == RecordingStatistics{.events = events.size(), .time_steps_back = steps_back});
      CHECK(reader.bytes_read() == reader.bytes_total());
      CHECK(reader.next_batch().empty());
      RosbagReader active(write_file(folder / "a.bag.active", bag_begin() + bag.substr(bag_begin().size())));
      CHECK(drain(active) == events);
    }
}

TEST_CASE("RosbagReader: cut at any byte, it yields every whole message before the cut") {
  const TemporaryFolder folder;
  const auto events = random_events(kBagSize, 20, 3);
  const auto messages = [&](std::size_t first, std::size_t count) {
    return bag_events(1, std::span(events).subspan(first, count));
  };
  const std::string begin = "#ROSBAG V2.0\n" + bag_record(3, {{"index_pos", little(0, 8)}}, "");
  for (const auto compression : built_compressions(kRosbagCompressions)) {
    const bool whole_chunks = compression != Compression::none;
    const std::string chunk =
        bag_chunk(bag_connection(1, "/events", "dvs_msgs/EventArray") + messages(0, 8) + messages(8, 5), compression);
    const std::string last = messages(13, 7), whole = begin + chunk + last;
    const std::size_t behind_chunk = begin.size() + chunk.size(), end = whole.size();
    const std::size_t first_end = whole_chunks ? behind_chunk : behind_chunk - messages(8, 5).size();
    for (std::size_t cut = 0; cut <= whole.size(); ++cut) {
      CAPTURE(cut);
      const auto path = write_file(folder / "a.bag", whole.substr(0, cut));
      if (cut < first_end) {
        CHECK(contains(error_of([&] { RosbagReader reader(path); }), cut < 13 ? "a.bag: not a rosbag" : "a.bag: no "));
        continue;
      }
      RosbagReader reader(path);
      const auto read = drain(reader);
      REQUIRE(read.size() == (cut < behind_chunk ? 8U : cut < end ? 13U : 20U));
      CHECK(std::equal(read.begin(), read.end(), events.begin()));
      const std::size_t record = cut < behind_chunk ? first_end : cut < end ? behind_chunk : end;
      CHECK(reader.statistics().truncated_bytes == cut - record);
    }
  }
}

TEST_CASE("RosbagReader: the topic that is chosen, or the only one of events, else those that are there are listed") {
  const TemporaryFolder folder;
  const Event left{1, 2, 1, 5}, right{3, 4, 0, 6};
  const std::string of_left = bag_connection(0, "/left", "dvs_msgs/EventArray"),
                    of_right = bag_connection(1, "/right", "dvs_msgs/EventArray"),
                    again = bag_connection(2, "/left", "dvs_msgs/EventArray"),
                    data = bag_chunk(of_left + bag_events(0, {&left, 1}) + of_right + bag_events(1, {&right, 1}) +
                                     again + bag_events(2, {&left, 1}));
  const auto path =
      write_file(folder / "a.bag", bag_begin(bag_begin().size() + data.size()) + data + of_left + of_right + again);
  const auto without_index = write_file(folder / "b.bag", bag_begin() + data);
  const auto events_of = [&](const std::filesystem::path& file, const char* topic) {
    RosbagReader reader(file, {.topic = topic});
    return drain(reader);
  };
  for (const auto& file : {path, without_index}) {
    CHECK(events_of(file, "/left") == std::vector<Event>{left, left});  // of both of its publishers
    CHECK(events_of(file, "/right") == std::vector<Event>{right});
    CHECK(contains(error_of([&] { events_of(file, "/top"); }),
                   "topic is '/top', of which no events are in it, but of /left and /right"));
  }
  CHECK(contains(error_of([&] { RosbagReader reader(path); }), "a.bag: several topics of events, /left and /right"));
  RosbagReader reader(without_index);
  CHECK(reader.next_batch().front() == left);
  CHECK(contains(error_of([&] { reader.next_batch(); }), "b.bag: several topics of events, /left and /right"));
}

TEST_CASE("RosbagReader: one clear line for what cannot be read, once all events before it are delivered") {
  const TemporaryFolder folder;
  const Event event{1, 2, 1, 5};
  const std::string good = bag_begin() + bag_connection(1, "/e", "dvs_msgs/EventArray") + bag_events(1, {&event, 1});
  const std::string at = " (byte " + std::to_string(good.size()) + ")";
  const auto error_behind = [&](const std::string& records) {
    RosbagReader reader(write_file(folder / "a.bag", good + records + std::string(64, '\0')));
    CHECK(reader.next_batch().size() == 1);
    return error_of([&] { reader.next_batch(); });
  };
  CHECK(
      contains(error_behind(little(0x7FFFFFFF, 4)), "a.bag: record: its fields have 2147483647 bytes: garbled?" + at));
  CHECK(contains(error_behind(little(0, 8)), "record: garbled: no field op" + at));
  CHECK(contains(error_behind(mcap_text(little(99, 4)) + little(0, 4)), "record: garbled: a field of 99 bytes"));
  CHECK(contains(error_behind(mcap_text(bag_fields({{"", "a"}})) + little(0, 4)), "a field without name" + at));
  CHECK(contains(error_behind(mcap_text(bag_fields({{"op", "ab"}})) + little(0, 4)),
                 "field op of 2 bytes, must be of 1"));
  CHECK(contains(error_behind(bag_record(2, {{"conn", "a"}}, "")), "field conn of 1 bytes, must be of 4" + at));
  CHECK(contains(error_behind(bag_connection(3, "/a\nb", "")), "record: garbled: a name with control characters" + at));
  CHECK(contains(error_behind(bag_message(1, "abc")), "message of events: garbled: a field of 4 bytes at byte 0 of 3"));
  CHECK(contains(error_behind(bag_record(5, {{"compression", "zstd"}}, "abc")), "compression is 'zstd', which is not"));
  CHECK(contains(error_behind(mcap_text(bag_fields({{"op", "\5"}, {"compression", "lz4"}})) + little(~0U, 4)),
                 "chunk of 4294967295 bytes, of which at most 67108864 are read"));
  CHECK(refuses<RosbagReader>(folder / "b", "#ROSBAG V2.0\n" + bag_record(3, {{"encryptor", "rosbag/Aes"}}, ""),
                              "b: record: encryptor is 'rosbag/Aes', which is not supported (byte 13)"));
  for (const auto compression : built_compressions(kRosbagCompressions)) {
    if (compression == Compression::none) continue;
    const auto compressed = [&](const std::string& records) { return bag_chunk(records, compression); };
    CHECK(contains(error_behind(compressed(little(0x7FFFFFFF, 4))), "chunk: garbled: a field of 2147483647 bytes"));
    CHECK(contains(error_behind(compressed(std::string(Decompressor::kMaxBytes + 1, '\0'))),
                   "chunk: it is longer than 67108864 bytes when decompressed" + at));
    CHECK(contains(error_behind(bag_record(5, {{"compression", to_string(compression)}}, "no frame at all")),
                   compression == Compression::lz4 ? "chunk: LZ4: " : "chunk: bzip2: "));
  }
}

TEST_CASE("RosbagReader: a real recording of a Prophesee camera in EVT3, with triggers") {
  // Counts, ends and sums by forty lines of Python that follow the description of the words.
  const auto path = real_recording("formats/events_1.bag");
  if (path.empty()) return;
  RosbagReader reader(path);
  CHECK(reader.sensor_size() == SensorSize{640, 480});
  std::vector<TriggerEvent> triggers;
  const auto events = drain(reader, &triggers);
  REQUIRE(events.size() == 343474);
  CHECK(events.front() == Event{479, 441, 0, 7139845});
  CHECK(events.back() == Event{39, 374, 0, 9218023});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 125183);
  std::uint64_t x = 0, y = 0, t = 0;
  for (const Event& event : events) x += event.x, y += event.y, t += static_cast<std::uint64_t>(event.t);
  CHECK(x == 116731888);
  CHECK(y == 80879209);
  CHECK(t == 2851601611994);
  REQUIRE(triggers.size() == 4157);
  CHECK(triggers.front() == TriggerEvent{6, true, 7139840});
  CHECK(triggers.back() == TriggerEvent{6, true, 9217840});
  CHECK(reader.statistics() == RecordingStatistics{.events = 343474, .triggers = 4157});
}
