#include "evmarker/io/mcap_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/io/evt2.hpp"
#include "io/recording_bytes.hpp"
#include "io/ros_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;
using namespace std::string_literals;

static_assert(EventSource<McapReader>);

namespace {

constexpr SensorSize kMcapSize{346, 260};

/// An MCAP recording of these records, without index.
std::string mcap_of(const std::string& records) { return mcap_begin() + records + mcap_record(15, little(0, 4)); }

/// One of a single topic and these messages.
std::string mcap_of_messages(const std::vector<std::string>& messages, const std::string& type) {
  std::string records = mcap_channel(1, "/events", type);
  for (const std::string& message : messages) records += mcap_message(1, message);
  return mcap_of(records);
}

std::string mcap_of_packet(const std::string& encoding, std::uint64_t time_base_ns, const std::string& words) {
  return mcap_of_messages({event_packet(kMcapSize, encoding, time_base_ns, words, true)},
                          "event_camera_msgs/msg/EventPacket");
}

}  // namespace

TEST_CASE("McapReader: every encoding of events, in every compression, in CDR and as ROS 1 writes it") {
  const TemporaryFolder folder;
  const auto events = random_events(kMcapSize, 30000, 5, true);
  std::uint64_t steps_back = 0;
  for (std::size_t i = 1; i < events.size(); ++i) steps_back += events[i].t < events[i - 1].t;
  for (const auto kind :
       {RosEvents::array, RosEvents::mono, RosEvents::libcaer_cmp, RosEvents::evt3, RosEvents::libcaer})
    for (const auto compression : built_compressions())
      for (const bool cdr : {true, false}) {
        CAPTURE(static_cast<int>(kind));
        CAPTURE(cdr);
        McapReader reader(write_file(folder / "a.mcap", make_mcap(events, kMcapSize, kind, compression, cdr)));
        CHECK(reader.sensor_size() == kMcapSize);
        CHECK(drain(reader) == events);
        CHECK(reader.statistics() == RecordingStatistics{.events = events.size(), .time_steps_back = steps_back});
        CHECK(reader.bytes_read() == reader.bytes_total());
        CHECK(reader.next_batch().empty());
      }
}

TEST_CASE("McapReader: EVT2.1 in either order of the halves, with triggers, across packets") {
  const TemporaryFolder folder;
  const std::uint64_t high = 8ULL << 60U | 5ULL << 32U,
                      two = 1ULL << 60U | 3ULL << 54U | 100ULL << 43U | 20ULL << 32U | 5U,
                      trigger = 10ULL << 60U | 4ULL << 54U | 2ULL << 40U | 1ULL << 32U;
  const auto swapped = [](std::uint64_t word) { return word << 32U | word >> 32U; };
  for (const bool swap : {false, true}) {
    std::string first, second;
    for (const std::uint64_t word : {high, two, two}) first += little(swap ? swapped(word) : word, 8);
    for (const std::uint64_t word : {trigger, two}) second += little(swap ? swapped(word) : word, 8);
    McapReader reader(write_file(folder / "a", mcap_of_messages({event_packet(kMcapSize, "evt21", 0, first, true),
                                                                 event_packet(kMcapSize, "evt21", 0, second, true)},
                                                                "event_camera_msgs/msg/EventPacket")));
    std::vector<TriggerEvent> triggers;
    const Event a{100, 20, 1, 5 * 64 + 3}, b{102, 20, 1, 5 * 64 + 3};
    CHECK(drain(reader, &triggers) == std::vector<Event>{a, b, a, b, a, b});
    CHECK(triggers == std::vector<TriggerEvent>{{2, true, 5 * 64 + 4}});
    CHECK(reader.statistics() == RecordingStatistics{.events = 6, .triggers = 1});
  }
}

TEST_CASE("McapReader: what the encodings leave out is counted, and times roll over within a packet") {
  const TemporaryFolder folder;
  const auto read = [&](const std::string& encoding, std::uint64_t time_base_ns, const std::string& words) {
    McapReader reader(write_file(folder / "a", mcap_of_packet(encoding, time_base_ns, words)));
    const auto events = drain(reader);
    return std::pair(events, reader.statistics());
  };
  const std::vector<Event> two{{1, 2, 1, 0x7FFFFFFF}, {3, 4, 0, 0x80000001}};
  const std::string invalid = little(1U << 17U, 4) + little(1, 4), off = libcaer_words({{Event{346, 4, 0, 1}}}, 0);
  const auto [rolled, of_libcaer] = read("libcaer", 5999, libcaer_words(two, 0) + invalid + off + "cut");
  CHECK(rolled == std::vector<Event>{{1, 2, 1, 5 + 0x7FFFFFFFLL}, {3, 4, 0, 5 + 0x80000001LL}});
  CHECK(of_libcaer == RecordingStatistics{.events = 2, .off_sensor = 1, .truncated_bytes = 3});

  // 0.9 us and 0.2 us are more than one; ~0 is the last time that a word can have.
  const auto [mono, of_mono] =
      read("mono", 7900,
           little(200, 4) + little(345, 2) + little(259, 2) + little(~0U, 4) + little(1, 2) + little(0x8000, 2));
  CHECK(mono == std::vector<Event>{{345, 259, 0, 8}, {1, 0, 1, (7900 + 0xFFFFFFFFLL) / 1000}});
  CHECK(of_mono == RecordingStatistics{.events = 2});

  const auto words = to_bytes<std::uint16_t>({0x2005, 0x0001, 0x1002, 0x48FE, 0x50FF, 0x5001, 0x6000, 0xF000, 0x3000});
  const auto [cmp, of_cmp] = read("libcaer_cmp", 0, words);
  REQUIRE(cmp.size() == 7);  // rows 254 to 259 of the first mask's 254 to 261, none of the second's 262, and row 0
  CHECK(cmp.front() == Event{5, 254, 1, 4098});
  CHECK(cmp.back() == Event{5, 0, 0, 4098});
  CHECK(of_cmp == RecordingStatistics{.events = 7, .off_sensor = 3, .unknown_words = 2});
}

TEST_CASE("McapReader: cut at any byte, it yields every whole message before the cut") {
  const TemporaryFolder folder;
  const auto events = random_events(kMcapSize, 20, 3);
  const auto messages = [&](std::size_t first, std::size_t count) {
    return mcap_message(1, event_array(kMcapSize, std::span(events).subspan(first, count), true));
  };
  const std::string channel = mcap_channel(1, "/events", "dvs_msgs/msg/EventArray");
  for (const auto compression : built_compressions()) {
    const bool whole_chunks = compression != Compression::none;
    const std::string begin = mcap_begin(), chunk = mcap_chunk(channel + messages(0, 8) + messages(8, 5), compression),
                      last = messages(13, 7);
    const std::size_t behind_chunk = begin.size() + chunk.size(), end = behind_chunk + last.size();
    const std::string whole = begin + chunk + last;
    for (std::size_t cut = 0; cut <= whole.size(); ++cut) {
      CAPTURE(cut);
      const auto path = write_file(folder / "a.mcap", whole.substr(0, cut));
      const std::size_t second_message = behind_chunk - messages(8, 5).size();
      const std::size_t first_end = whole_chunks ? behind_chunk : second_message;
      if (cut < first_end) {
        CHECK(contains(error_of([&] { McapReader reader(path); }),
                       cut < 8 ? "a.mcap: not an MCAP recording" : "a.mcap: no "));
        continue;
      }
      McapReader reader(path);
      const auto read = drain(reader);
      REQUIRE(read.size() == (cut < behind_chunk ? 8U : cut < end ? 13U : 20U));
      CHECK(std::equal(read.begin(), read.end(), events.begin()));
      const std::size_t record = cut < behind_chunk ? first_end : cut < end ? behind_chunk : end;
      CHECK(reader.statistics().truncated_bytes == cut - record);
    }
  }
}

TEST_CASE("McapReader: the topic that is chosen, or the only one of events, else those that are there are listed") {
  const TemporaryFolder folder;
  const Event left{1, 2, 1, 5}, right{3, 4, 0, 6};
  const std::string channels = mcap_channel(1, "/left", "dvs_msgs/msg/EventArray") +
                               mcap_channel(2, "/right", "dvs_msgs/msg/EventArray") +
                               mcap_channel(3, "/imu", "sensor_msgs/msg/Imu");
  const auto message = [](int channel, const Event& event) {
    return mcap_message(channel, event_array(kMcapSize, {&event, 1}, true));
  };
  const std::string data = mcap_begin() + mcap_channel(1, "/left", "dvs_msgs/msg/EventArray") + message(1, left) +
                           mcap_channel(2, "/right", "dvs_msgs/msg/EventArray") + message(2, right) + message(1, left);
  const auto path = write_file(folder / "a.mcap", data + mcap_end(data.size(), channels));
  const auto events_of = [&](const std::filesystem::path& file, const char* topic) {
    McapReader reader(file, {.topic = topic});
    return drain(reader);
  };
  CHECK(events_of(path, "/left") == std::vector<Event>{left, left});
  CHECK(events_of(path, "/right") == std::vector<Event>{right});
  const auto error = [&](const char* topic) { return error_of([&] { McapReader reader(path, {.topic = topic}); }); };
  CHECK(contains(error(""), "a.mcap: several topics of events, /left and /right: name one, --topic /left"));
  CHECK(contains(error("/top"), "topic is '/top', of which no events are in it, but of /left and /right"));
  CHECK(contains(error("/imu"), "topic is '/imu', of which no events are in it, but of /left and /right"));

  const auto without_index = write_file(folder / "b.mcap", data + mcap_end(data.size(), ""));
  CHECK(events_of(without_index, "/left") == std::vector<Event>{left, left});
  CHECK(events_of(without_index, "/right") == std::vector<Event>{right});
  CHECK(contains(error_of([&] { events_of(without_index, "/top"); }), "but of /left and /right"));
  McapReader reader(without_index);
  CHECK(reader.next_batch().front() == left);
  CHECK(contains(error_of([&] { reader.next_batch(); }), "b.mcap: several topics of events, /left and /right"));

  CHECK(refuses<McapReader>(folder / "c", mcap_of(mcap_channel(1, "/imu", "sensor_msgs/msg/Imu")),
                            "c: no topic of events in it (event_camera_msgs/EventPacket, dvs_msgs/EventArray), "
                            "but /imu"));
  CHECK(refuses<McapReader>(folder / "c", mcap_of(mcap_channel(1, "/e", "dvs_msgs/EventArray", "json")), "but /e"));
  CHECK(
      refuses<McapReader>(folder / "c", mcap_of(mcap_channel(1, "/e", "dvs_msgs/EventArray")), "no sensor size in it"));
}

TEST_CASE("McapReader: one clear line for what cannot be read, once all events before it are delivered") {
  const TemporaryFolder folder;
  const Event event{1, 2, 1, 5};
  const std::string packet_type = "event_camera_msgs/msg/EventPacket",
                    good = mcap_begin() + mcap_channel(1, "/e", "dvs_msgs/msg/EventArray") +
                           mcap_message(1, event_array(kMcapSize, {&event, 1}, true));
  const auto error_behind = [&](const std::string& records) {
    McapReader reader(write_file(folder / "a.mcap", good + records + mcap_record(15, little(0, 4))));
    CHECK(reader.next_batch().size() == 1);
    const std::string error = error_of([&] { reader.next_batch(); });
    CHECK(contains(error, "a.mcap: "));
    return error;
  };
  const std::string at = " (byte " + std::to_string(good.size()) + ")";
  const auto packet = [&](const std::string& message) {
    return mcap_channel(2, "/e", packet_type) + mcap_message(2, message);
  };
  CHECK(
      contains(error_behind("\3"s + little(1ULL << 60U, 8)), "record of 1152921504606846976 bytes, of which at most"));
  CHECK(contains(error_behind(std::string(9, '\0')), "record: its type is 0, which none has: garbled" + at));
  CHECK(contains(error_behind(mcap_record(4, "x")), "record: garbled: a field of 2 bytes at byte 0 of 1" + at));
  CHECK(contains(error_behind(mcap_record(3, little(9, 2) + mcap_text("a\nb"))), "a name with control characters"));
  CHECK(contains(
      error_behind(mcap_record(4, little(9, 2) + little(9, 2) + mcap_text(std::string(5000, 'x')) + mcap_text("cdr"))),
      "garbled: more than 4096 topics, or one of so long a name"));
  CHECK(contains(error_behind(mcap_message(1, event_array({347, 260}, {}, true))),
                 "message of events: its sensor has 347 x 260 px, that of the first message 346 x 260" + at));
  CHECK(contains(error_behind(mcap_message(1, "\0\0\0\0abcd"s)), "encapsulation is 0, which is not supported"));
  CHECK(
      contains(error_behind(mcap_message(1, "\0"s)), "message of events: garbled: a field of 4 bytes at byte 0 of 1"));
  std::string too_few = event_array(kMcapSize, {&event, 1}, true);
  too_few.back() = '\1', too_few.pop_back();
  CHECK(contains(error_behind(mcap_message(1, too_few)), "message of events: garbled: a field of 1 bytes"));
  CHECK(contains(error_behind(packet(event_packet(kMcapSize, "evt9", 0, "", true))),
                 "encoding is 'evt9', which is not supported (evt3, evt21, mono, libcaer and libcaer_cmp are)"));
  CHECK(contains(error_behind(packet(event_packet(kMcapSize, "mono", 0, "", true, true))), "is_bigendian is 1"));
  std::string chunk = mcap_chunk("");
  chunk.replace(9 + 28, 4, little(1U << 31U, 4));
  CHECK(contains(error_behind(chunk + std::string(64, 'x')),
                 "chunk: garbled: a field of 2147483648 bytes at byte 32 of "));
  CHECK(contains(error_behind(mcap_record(
                     6, std::string(28, '\0') + mcap_text("brotli") + little(3, 8) + "abc" + std::string(20, '\0'))),
                 "chunk: compression is 'brotli', which is not supported (lz4 and zstd are)" + at));
  for (const auto compression : built_compressions()) {
    if (compression == Compression::none) continue;
    const auto compressed = [&](const std::string& records) { return mcap_chunk(records, compression); };
    CHECK(contains(error_behind(compressed("\5"s + little(1ULL << 60U, 8))),
                   "chunk: garbled: a field of 1152921504606846976 bytes at byte 9 of 9" + at));
    CHECK(contains(error_behind(compressed(std::string(Decompressor::kMaxBytes + 1, '\0'))),
                   "chunk: it is longer than 67108864 bytes when decompressed" + at));
    std::string no_frame = compressed("x");
    no_frame[no_frame.size() - 5] ^= '\x55';
    CHECK(error_behind(no_frame) != "");
  }
}

TEST_CASE("McapReader: a real recording of a DAVIS346 in libcaer_cmp") {
  // Counts, ends and sums by forty lines of Python that follow the description of the words.
  const auto path = real_recording("formats/tags.mcap");
  if (path.empty()) return;
  McapReader reader(path);
  CHECK(reader.sensor_size() == SensorSize{346, 260});
  const auto events = drain(reader);
  REQUIRE(events.size() == 571266);
  CHECK(events.front() == Event{219, 244, 0, 1744227144732712});
  CHECK(events.back() == Event{307, 38, 0, 1744227145732708});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 211043);
  std::uint64_t x = 0, y = 0, since_first = 0;
  for (const Event& event : events)
    x += event.x, y += event.y, since_first += static_cast<std::uint64_t>(event.t - events.front().t);
  CHECK(x == 118469679);
  CHECK(y == 78763572);
  CHECK(since_first == 335555680277);
  CHECK(reader.statistics() == RecordingStatistics{.events = 571266});
}

TEST_CASE("McapReader: a record that is longer than the file is the cut end of the file") {
  const TemporaryFolder folder;
  const Event event{1, 2, 1, 5};
  const std::string good = mcap_begin() + mcap_channel(1, "/e", "dvs_msgs/msg/EventArray") +
                           mcap_message(1, event_array(kMcapSize, {&event, 1}, true));
  for (const char type : {'\1', '\6', '\7', '\xFF'}) {
    McapReader reader(write_file(folder / "a.mcap", good + type + little(1ULL << 60U, 8) + "rest"));
    CHECK(drain(reader).size() == 1);
    CHECK(reader.statistics() == RecordingStatistics{.events = 1, .truncated_bytes = 13});
  }
}
