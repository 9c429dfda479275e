#include "evmarker/io/evt2.hpp"

#include <doctest/doctest.h>

#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

Decoded decode_evt2(const std::vector<std::uint32_t>& words) {
  return decode_with(Evt2Decoder({640, 480}), as_span(to_bytes(words)));
}

constexpr std::uint32_t cd20(unsigned x, unsigned y, unsigned p, unsigned t) {
  return p << 28U | t << 22U | x << 11U | y;
}
constexpr std::uint32_t high20(unsigned v) { return 8U << 28U | v; }

constexpr std::uint64_t cd21(std::uint64_t x, std::uint64_t y, std::uint64_t p, std::uint64_t t, std::uint64_t mask) {
  return p << 60U | t << 54U | x << 43U | y << 32U | mask;
}
constexpr std::uint64_t high21(std::uint64_t v) { return std::uint64_t{8} << 60U | v << 32U; }

}  // namespace

TEST_CASE("EVT2: events carry pixel, polarity and time") {
  // The first three words of a real recording, worked out by hand.
  const auto [events, triggers, statistics] = decode_evt2({0x80D9D8D0, 0x100119BB, 0x100121BB});
  CHECK(events == std::vector<Event>{{35, 443, 1, 913716224}, {36, 443, 1, 913716224}});
  CHECK(statistics == RecordingStatistics{.events = 2});
  CHECK(decode_evt2({high20(3), cd20(639, 479, 0, 63)}).events == std::vector<Event>{{639, 479, 0, 3 * 64 + 63}});
}

TEST_CASE("EVT2: everything before the first TIME_HIGH is dropped and counted") {
  const auto [events, triggers, statistics] = decode_evt2({cd20(1, 1, 1, 5), 0xA0000001, high20(0), cd20(2, 2, 1, 5)});
  CHECK(events == std::vector<Event>{{2, 2, 1, 5}});
  CHECK(triggers.empty());
  CHECK(statistics == RecordingStatistics{.events = 1, .dropped_before_time = 2});
}

TEST_CASE("EVT2: the clock wraps after 2^34 us, a small step back is not a wrap") {
  const auto [events, triggers, statistics] =
      decode_evt2({high20(0xFFFFFFF), cd20(0, 0, 0, 63), high20(0xFFFFFFE), cd20(0, 0, 0, 0), high20(0xFFFFFFF),
                   high20(0), cd20(0, 0, 0, 1), cd20(0, 0, 0, 0)});
  const Timestamp loop = Timestamp{1} << 34;
  REQUIRE(events.size() == 4);
  CHECK(events[0].t == loop - 1);
  CHECK(events[1].t == loop - 128);
  CHECK(events[2].t == loop + 1);
  CHECK(events[3].t == loop);
  CHECK(statistics.time_steps_back == 2);
}

TEST_CASE("EVT2 and EVT2.1: a garbled TIME_HIGH that the next contradicts is not followed, a lasting jump is") {
  const unsigned range = 1U << 28U;
  for (const unsigned last : {5U, range / 2, range - 1})
    for (const unsigned jump : {2000U, 100000U, range / 2 - 1, range / 2, range - 2000U}) {
      const unsigned garbled = (last + jump) % range, next = (last + 1) % range;
      const auto decoded = [&](unsigned second, unsigned third) {
        return decode_evt2(
            {high20(last), cd20(0, 0, 0, 1), high20(second), cd20(1, 0, 0, 2), high20(third), cd20(2, 0, 0, 3)});
      };
      const auto decoded21 = [&](unsigned second, unsigned third) {
        return decode_with(Evt21Decoder({640, 480}),
                           as_span(to_bytes<std::uint64_t>({high21(last), cd21(0, 0, 0, 1, 1), high21(second),
                                                            cd21(1, 0, 0, 2, 1), high21(third), cd21(2, 0, 0, 3, 1)})));
      };
      CAPTURE(last);
      CAPTURE(jump);
      CHECK(decoded(garbled, next).events == decoded(last, next).events);
      CHECK(decoded(garbled, next).statistics.garbled_times == 1);
      CHECK(decoded21(garbled, next).events == decoded(last, next).events);
      CHECK(decoded21(garbled, next).statistics.garbled_times == 1);
      const Decoded lasting = decoded(garbled, (garbled + 1) % range);
      CHECK(lasting.statistics.garbled_times == 0);
      CHECK(lasting.events[1].t % (Timestamp{range} * 64) == Timestamp{garbled} * 64 + 2);
      CHECK(lasting.events[2].t == lasting.events[1].t + 65);
    }
}

TEST_CASE("EVT2: triggers, ignored words, unknown words and events off the sensor") {
  const auto [events, triggers, statistics] =
      decode_evt2({high20(1), 10U << 28U | 9U << 22U | 31U << 8U | 1U, 10U << 28U | 10U << 22U, 14U << 28U, 15U << 28U,
                   2U << 28U, 9U << 28U, cd20(640, 0, 0, 0), cd20(0, 480, 0, 0), cd20(2047, 2047, 1, 0)});
  CHECK(events.empty());
  CHECK(triggers == std::vector<TriggerEvent>{{31, true, 73}, {0, false, 74}});
  CHECK(statistics == RecordingStatistics{.triggers = 2, .off_sensor = 3, .unknown_words = 2});
}

TEST_CASE("EVT2: what is written is read back, event for event") {
  const Timestamp loop = Timestamp{1} << 34;
  auto events = random_events({640, 480}, 20000, 3, true);
  for (const Timestamp t : {loop - 1, loop, loop + 70, loop, 4 * loop + 5}) events.push_back({1, 2, 0, t});
  std::vector<std::byte> bytes;
  Evt2Encoder encoder;
  encoder.encode(events, bytes);
  encoder.encode(TriggerEvent{31, true, 4 * loop + 6}, bytes);
  const Decoded decoded = decode_with(Evt2Decoder({640, 480}), bytes);
  CHECK(decoded.events == events);
  CHECK(decoded.statistics.time_steps_back > 10);
  CHECK(decoded.triggers == std::vector<TriggerEvent>{{31, true, 4 * loop + 6}});
}

TEST_CASE("EVT2: times and ids that it cannot express are refused") {
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

TEST_CASE("EVT2.1: a word holds up to 32 events of a row") {
  const std::vector<std::uint64_t> words{
      cd21(0, 0, 0, 0, 0x3),  // before the first time: dropped
      high21(2),
      cd21(32, 7, 1, 5, 0x80000001),
      cd21(620, 7, 0, 6, 0xFFFFFFFF),  // 12 of 32 columns beyond 640
      std::uint64_t{10} << 60U | std::uint64_t{8} << 54U | std::uint64_t{3} << 40U | std::uint64_t{1} << 32U,
      cd21(0, 480, 1, 5, 0x7),
      cd21(9, 1, 1, 2, 0x1),
      std::uint64_t{3} << 60U};
  std::vector<std::uint64_t> swapped;
  for (const std::uint64_t word : words) swapped.push_back(word << 32U | word >> 32U);
  for (const bool legacy : {false, true}) {
    const auto [events, triggers, statistics] =
        decode_with(Evt21Decoder({640, 480}, legacy), as_span(to_bytes(legacy ? swapped : words)));
    REQUIRE(events.size() == 2 + 20 + 1);
    CHECK(events[0] == Event{32, 7, 1, 133});
    CHECK(events[1] == Event{63, 7, 1, 133});
    CHECK(events[2] == Event{620, 7, 0, 134});
    CHECK(events[21] == Event{639, 7, 0, 134});
    CHECK(events[22] == Event{9, 1, 1, 130});
    CHECK(triggers == std::vector<TriggerEvent>{{3, true, 136}});
    CHECK(statistics == RecordingStatistics{.events = 23,
                                            .triggers = 1,
                                            .dropped_before_time = 2,
                                            .off_sensor = 12 + 3,
                                            .time_steps_back = 1,
                                            .unknown_words = 1});
  }
}
