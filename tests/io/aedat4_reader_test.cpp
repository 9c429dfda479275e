#include "evmarker/io/aedat4_reader.hpp"

#include <doctest/doctest.h>

#include <algorithm>

#include "evmarker/events/event_stream.hpp"
#include "io/recording_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;
using namespace std::string_literals;

static_assert(EventSource<Aedat4Reader>);

TEST_CASE("Aedat4Reader: the first stream of events, in every compression, among other streams") {
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 30000, 5, true);
  std::uint64_t steps_back = 0;
  for (std::size_t i = 1; i < events.size(); ++i) steps_back += events[i].t < events[i - 1].t;
  for (const auto compression : built_compressions()) {
    Aedat4Reader reader(write_file(folder / "a.aedat4", make_aedat4(events, {346, 260}, compression)));
    CHECK(reader.sensor_size() == SensorSize{346, 260});
    CHECK(drain(reader) == events);
    CHECK(reader.statistics() == RecordingStatistics{.events = events.size(), .time_steps_back = steps_back});
    CHECK(reader.bytes_read() == reader.bytes_total());
    CHECK(reader.next_batch().empty());
  }
}

TEST_CASE("Aedat4Reader: triggers at the input, among the events and behind them, in every compression") {
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 20, 4);
  const std::vector<Aedat4Trigger> before{{-7, 1}, {40, 2}, {0x7FFFFFFFFFFFFFFF, 3}};
  const std::vector<Aedat4Trigger> behind{{0, 0}, {50, 1}, {51, 4}, {52, 5}, {53, 9}, {54, -1}, {55, 2}};
  for (const auto compression : built_compressions()) {
    const auto packet = [&](int stream, const std::string& content) {
      return aedat4_packet(stream, compress(content, compression));
    };
    Aedat4Reader reader(write_file(folder / "a.aedat4",
                                   aedat4_header(2 * static_cast<int>(compression), -1, aedat4_streams({346, 260})) +
                                       packet(3, aedat4_triggers(before)) + packet(1, aedat4_events(events)) +
                                       packet(3, aedat4_triggers({})) + packet(3, aedat4_triggers(behind))));
    CHECK(reader.next_batch().size() == events.size());
    const auto first = reader.triggers();
    CHECK(std::vector(first.begin(), first.end()) ==
          std::vector<TriggerEvent>{{0, true, -7}, {0, false, 40}, {0, true, 0x7FFFFFFFFFFFFFFF}});
    CHECK(reader.next_batch().empty());
    const auto last = reader.triggers();
    CHECK(std::vector(last.begin(), last.end()) == std::vector<TriggerEvent>{{0, true, 50}, {0, false, 55}});
    CHECK(reader.statistics().triggers == 5);
  }
}

TEST_CASE("Aedat4Reader: garbled packets of triggers") {
  const TemporaryFolder folder;
  const std::string header = aedat4_header(0, -1, aedat4_streams({346, 260}));
  const auto error_of_packet = [&](const std::string& content) {
    Aedat4Reader reader(write_file(folder / "a.aedat4", header + aedat4_packet(3, content)));
    return error_of([&] { reader.next_batch(); });
  };
  const std::string one = aedat4_triggers(std::vector<Aedat4Trigger>{{5, 1}});
  for (std::size_t cut = 4; cut < one.size() - 3; ++cut)  // the last three bytes fill up
    CHECK(contains(error_of_packet(one.substr(0, cut)), "a.aedat4: packet: garbled flatbuffer"));
  CHECK(contains(error_of_packet(flatbuffer_of_vector("TRIG", 1, little(0x7FFFFFF0, 4))), "garbled flatbuffer"));
  CHECK(contains(error_of_packet(flatbuffer_of_vector("TRIG", 0x40000001, little(4, 4))), "garbled flatbuffer"));
  std::string offsets;  // many of one table
  constexpr std::size_t kCount = 2000000;
  for (std::size_t i = 0; i < kCount; ++i) offsets += little(4 * (kCount - i) + 8, 4);
  const std::string table =
      little(8, 2) + little(16, 2) + little(4, 2) + little(12, 2) + little(8, 4) + little(5, 8) + little(1, 4);
  CHECK(contains(error_of_packet(flatbuffer_of_vector("TRIG", kCount, offsets + table)),
                 "a.aedat4: garbled: 1048577 triggers among 0 events"));
}

TEST_CASE("Aedat4Reader: a packet longer than a block, and a header without the position of the index") {
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 200000, 6);
  for (const auto compression : built_compressions()) {
    const int number = 2 * static_cast<int>(compression);  // the stronger variants of both
    Aedat4Reader reader(
        write_file(folder / "a.aedat4", aedat4_header(number, -1, aedat4_streams({346, 260})) +
                                            aedat4_packet(1, compress(aedat4_events(events), compression)) +
                                            aedat4_packet(0, std::string(3000000, 'x')) +
                                            aedat4_packet(1, compress(aedat4_events({&events[0], 1}), compression))));
    const auto read = drain(reader);
    REQUIRE(read.size() == events.size() + 1);
    CHECK(std::equal(events.begin(), events.end(), read.begin()));
    CHECK(read.back() == events[0]);
  }
}

TEST_CASE("Aedat4Reader: cut at any byte, it yields every whole packet before the cut") {
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 20, 3);
  for (const auto compression : built_compressions()) {
    const auto packet = [&](std::size_t first, std::size_t count) {
      return aedat4_packet(1, compress(aedat4_events(std::span(events).subspan(first, count)), compression));
    };
    const std::string header = aedat4_header(2 * static_cast<int>(compression), -1, aedat4_streams({346, 260}));
    const std::size_t first = header.size() + packet(0, 8).size(), second = first + packet(8, 12).size();
    const std::string whole = header + packet(0, 8) + packet(8, 12);
    for (std::size_t cut = 0; cut <= whole.size(); ++cut) {
      const auto path = write_file(folder / "a.aedat4", whole.substr(0, cut));
      if (cut < header.size()) {
        CHECK(
            contains(error_of([&] { Aedat4Reader reader(path); }), cut < 14 ? "not an AEDAT 4" : "inside its header"));
        continue;
      }
      Aedat4Reader reader(path);
      const auto read = drain(reader);
      REQUIRE(read.size() == (cut < first ? 0U : cut < second ? 8U : 20U));
      CHECK(std::equal(read.begin(), read.end(), events.begin()));
      const std::size_t packet_begin = cut < first ? header.size() : cut < second ? first : second;
      CHECK(reader.statistics().truncated_bytes == cut - packet_begin);
    }
  }
}

TEST_CASE("Aedat4Reader: one clear line for a header that cannot be read") {
  const TemporaryFolder folder;
  const auto refuses_header = [&](const std::string& header, const char* part) {
    return refuses<Aedat4Reader>(folder / "a.aedat4", header, part);
  };
  const std::string streams = aedat4_streams({346, 260});
  CHECK(refuses_header("", "a.aedat4: not an AEDAT 4 recording"));
  CHECK(refuses_header(aedat4_header(5, -1, streams), "header: compression is 5, which is not supported"));
  CHECK(refuses_header(aedat4_header(0, -1, "<dv></dv>"), "header: no stream of events (typeIdentifier EVTS) in it"));
  CHECK(refuses_header(aedat4_header(0, -1, aedat4_streams({0, 260})), "no sensor size in it"));
  CHECK(refuses_header(aedat4_header(0, -1, aedat4_streams({99999, 260})), "sensor size is 99999 x 260 px, AEDAT 4"));
  CHECK(refuses_header("#!AER-DAT4.0\r\n" + little(0xFFFFFFFF, 4), "header of 4294967295 bytes, of which at most"));
  CHECK(refuses_header("#!AER-DAT4.0\r\n" + little(8, 4) + little(0x7FFFFFFF, 8), "header: garbled flatbuffer"));
#ifndef EVMARKER_HAS_LZ4
  CHECK(refuses_header(aedat4_header(1, -1, streams),
                       "compressed by lz4, which this build leaves out: install liblz4-dev"));
#endif
#ifndef EVMARKER_HAS_ZSTD
  CHECK(refuses_header(aedat4_header(3, -1, streams),
                       "compressed by zstd, which this build leaves out: install libzstd-dev"));
#endif
}

TEST_CASE("Aedat4Reader: one clear line for a garbled packet, once all events before it are delivered") {
  const TemporaryFolder folder;
  const Event event{1, 2, 1, 5};
  for (const auto compression : built_compressions()) {
    const std::string good = aedat4_header(2 * static_cast<int>(compression), -1, aedat4_streams({346, 260})) +
                             aedat4_packet(1, compress(aedat4_events({&event, 1}), compression));
    const auto error_behind = [&](const std::string& packet) {
      Aedat4Reader reader(write_file(folder / "a.aedat4", good + packet));
      CHECK(reader.next_batch().size() == 1);
      const std::string error = error_of([&] { reader.next_batch(); });
      CHECK(contains(error, " (byte " + std::to_string(good.size() + (contains(error, "at most") ? 8 : 0)) + ")"));
      return error;
    };
    const auto compressed = [&](const std::string& content) {
      return aedat4_packet(1, compress(content, compression));
    };
    CHECK(contains(error_behind(little(1, 4) + little(~0U, 4)), "packet: size is -1, must not be negative"));
    CHECK(contains(error_behind(little(1, 4) + little(0x7FFFFFFF, 4)), "packet of 2147483647 bytes, of which at most"));
    for (const std::uint64_t count : {2ULL, 0x10000001ULL, 0xFFFFFFFFULL})  // 16 times the second has 32 zero bits
      CHECK(contains(error_behind(compressed(flatbuffer_of_vector("EVTS", count, std::string(16, '\0')))),
                     "packet: garbled flatbuffer: it refers to byte 32 and "));
    CHECK(contains(error_behind(compressed("abc")), "packet: it has no size"));
    CHECK(contains(error_behind(compressed(little(4, 4) + little(0xFFFFFFF0, 4))), "packet: garbled flatbuffer"));
    if (compression != Compression::none)
      CHECK(contains(error_behind(aedat4_packet(1, "no frame at all")),
                     compression == Compression::lz4 ? "LZ4: " : "ZSTD: "));
  }
}

TEST_CASE("Aedat4Reader: a small packet that becomes too long when it is decompressed") {
  if (built_compressions().size() < 2) {
    MESSAGE("skipped: this build has neither LZ4 nor ZSTD");
    return;
  }
  const TemporaryFolder folder;
  for (const auto compression : built_compressions()) {
    if (compression == Compression::none) continue;
    const std::string packet = compress(std::string(Decompressor::kMaxBytes + 1, '\0'), compression);
    CHECK(packet.size() < 400000);
    Aedat4Reader reader(write_file(
        folder / "a.aedat4",
        aedat4_header(2 * static_cast<int>(compression), -1, aedat4_streams({346, 260})) + aedat4_packet(1, packet)));
    CHECK(
        contains(error_of([&] { reader.next_batch(); }), "packet: it is longer than 67108864 bytes when decompressed"));
  }
}

TEST_CASE("Aedat4Reader: times that cannot be shifted, and pixels off the sensor") {
  const TemporaryFolder folder;
  const std::vector<Event> events{{1, 2, 1, -5}, {346, 2, 1, 0}, {1, 0x8000, 1, 0}, {1, 2, 0, 0x7FFFFFFFFFFFFFFFLL}};
  const auto path = write_file(folder / "a.aedat4", make_aedat4(events, {346, 260}));
  Aedat4Reader reader(path);
  CHECK(drain(reader) == std::vector<Event>{events[0], events[3]});
  CHECK(reader.statistics().off_sensor == 2);
  Aedat4Reader shifted(path, {.shift_first_time_to_zero = true});
  CHECK(shifted.next_batch().size() == 1);
  CHECK(contains(error_of([&] { shifted.next_batch(); }),
                 "t is 9223372036854775807 us, too far from the first time, -5"));
}

TEST_CASE("Aedat4Reader: a real recording in LZ4, of events and measurements") {
  const auto path = real_recording("formats/davis_lz4.aedat4");
  if (path.empty()) return;
  if (built_compressions({Compression::lz4}).empty()) {
    MESSAGE("skipped: this build has no LZ4");
    return;
  }
  Aedat4Reader reader(path);
  CHECK(reader.sensor_size() == SensorSize{320, 240});
  const auto events = drain(reader);
  REQUIRE(events.size() == 111954);
  CHECK(events.front() == Event{154, 204, 0, 1605537493718345});
  CHECK(events.back() == Event{88, 237, 1, 1605537494308262});
  CHECK(std::ranges::count_if(events, [](const Event& e) { return e.p > 0; }) == 55023);
  CHECK(reader.statistics() == RecordingStatistics{.events = 111954});
}
