#include "evmarker/io/evt2.hpp"

#include <doctest/doctest.h>

#include <random>

#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

struct Decoded {
  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
  RecordingStatistics statistics;
};

Decoded decode(std::span<const std::byte> bytes, SensorSize size = {640, 480}) {
  Decoded result;
  Evt2Decoder decoder(size);
  decoder.decode(bytes, result.events, result.triggers);
  result.statistics = decoder.statistics();
  return result;
}

Decoded decode(const std::vector<std::uint32_t>& words, SensorSize size = {640, 480}) {
  const std::string bytes = to_bytes(words);
  return decode(as_span(bytes), size);
}

constexpr std::uint32_t cd(unsigned x, unsigned y, unsigned p, unsigned t) {
  return p << 28U | t << 22U | x << 11U | y;
}
constexpr std::uint32_t high(unsigned v) { return 8U << 28U | v; }

}  // namespace

TEST_CASE("EVT2: events carry pixel, polarity and time") {
  // The first three words of a real recording, worked out by hand.
  const auto [events, triggers, statistics] = decode({0x80D9D8D0, 0x100119BB, 0x100121BB});
  CHECK(events == std::vector<Event>{{35, 443, 1, 913716224}, {36, 443, 1, 913716224}});
  CHECK(statistics == RecordingStatistics{.events = 2});
  CHECK(decode({high(3), cd(639, 479, 0, 63)}).events == std::vector<Event>{{639, 479, 0, 3 * 64 + 63}});
}

TEST_CASE("EVT2: everything before the first TIME_HIGH is dropped and counted") {
  const auto [events, triggers, statistics] = decode({cd(1, 1, 1, 5), 0xA0000001, high(0), cd(2, 2, 1, 5)});
  CHECK(events == std::vector<Event>{{2, 2, 1, 5}});
  CHECK(triggers.empty());
  CHECK(statistics == RecordingStatistics{.events = 1, .dropped_before_time = 2});
}

TEST_CASE("EVT2: the clock wraps after 2^34 us, and a small step back is none") {
  const auto [events, triggers, statistics] = decode({high(0xFFFFFFF), cd(0, 0, 0, 63), high(0xFFFFFFE), cd(0, 0, 0, 0),
                                                      high(0xFFFFFFF), high(0), cd(0, 0, 0, 1), cd(0, 0, 0, 0)});
  const Timestamp loop = Timestamp{1} << 34;
  REQUIRE(events.size() == 4);
  CHECK(events[0].t == loop - 1);
  CHECK(events[1].t == loop - 128);
  CHECK(events[2].t == loop + 1);
  CHECK(events[3].t == loop);
  CHECK(statistics.time_steps_back == 2);
}

TEST_CASE("EVT2: triggers, words to skip, unknown words and events off the sensor") {
  const auto [events, triggers, statistics] =
      decode({high(1), 10U << 28U | 9U << 22U | 31U << 8U | 1U, 10U << 28U | 10U << 22U, 14U << 28U, 15U << 28U,
              2U << 28U, 9U << 28U, cd(640, 0, 0, 0), cd(0, 480, 0, 0), cd(2047, 2047, 1, 0)});
  CHECK(events.empty());
  CHECK(triggers == std::vector<TriggerEvent>{{31, true, 73}, {0, false, 74}});
  CHECK(statistics == RecordingStatistics{.triggers = 2, .off_sensor = 3, .unknown_words = 2});
}

TEST_CASE("EVT2: garbled data neither crashes nor leaves the sensor") {
  std::mt19937 random(7);
  const SensorSize size{300, 200};
  std::string bytes(400003, '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  const auto [events, triggers, statistics] = decode(as_span(bytes), size);
  CHECK(events.size() > 100);
  bool inside = true;
  for (const Event& event : events) inside = inside && size.contains(event.x, event.y) && (event.p & ~1) == 0;
  CHECK(inside);
  CHECK(statistics.off_sensor > 100);
}

TEST_CASE("EVT2: what is written is read back, event for event") {
  const Timestamp loop = Timestamp{1} << 34;
  auto events = random_events({640, 480}, 20000, 3, true);
  for (const Timestamp t : {loop - 1, loop, loop + 70, loop, 4 * loop + 5}) events.push_back({1, 2, 0, t});
  std::vector<std::byte> bytes;
  Evt2Encoder encoder;
  encoder.encode(events, bytes);
  encoder.encode(TriggerEvent{31, true, 4 * loop + 6}, bytes);
  const Decoded decoded = decode(bytes);
  CHECK(decoded.events == events);
  CHECK(decoded.statistics.time_steps_back > 10);
  CHECK(decoded.triggers == std::vector<TriggerEvent>{{31, true, 4 * loop + 6}});
}

TEST_CASE("EVT2: what it cannot hold is refused by name") {
  std::vector<std::byte> bytes;
  Evt2Encoder encoder;
  const auto refuse = [&](Timestamp t) {
    const std::vector<Event> events{{0, 0, 0, t}};
    return error_of<std::invalid_argument>([&] { encoder.encode(events, bytes); });
  };
  CHECK(refuse(Timestamp{1} << 34).empty());
  CHECK(contains(refuse((Timestamp{1} << 34) - 1), "t is 17179869183"));
  CHECK(contains(refuse(-1), "t is -1"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   encoder.encode(TriggerEvent{32, true, 0}, bytes);
                 }),
                 "id is 32"));
}
