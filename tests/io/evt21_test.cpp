#include "evmarker/io/evt21.hpp"

#include <doctest/doctest.h>

#include <random>

#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

constexpr std::uint64_t cd(std::uint64_t x, std::uint64_t y, std::uint64_t p, std::uint64_t t, std::uint64_t valid) {
  return p << 60U | t << 54U | x << 43U | y << 32U | valid;
}
constexpr std::uint64_t high(std::uint64_t v) { return std::uint64_t{8} << 60U | v << 32U; }

}  // namespace

TEST_CASE("EVT2.1: a word holds up to 32 events of a row") {
  const std::vector<std::uint64_t> words{
      cd(0, 0, 0, 0, 0x3),  // before the first time: dropped
      high(2),
      cd(32, 7, 1, 5, 0x80000001),
      cd(620, 7, 0, 6, 0xFFFFFFFF),  // 12 of 32 columns beyond 640
      std::uint64_t{10} << 60U | std::uint64_t{8} << 54U | std::uint64_t{3} << 40U | std::uint64_t{1} << 32U,
      cd(0, 480, 1, 5, 0x7),
      cd(9, 1, 1, 2, 0x1),
      std::uint64_t{3} << 60U};
  std::vector<std::uint64_t> swapped;
  for (const std::uint64_t word : words) swapped.push_back(word << 32U | word >> 32U);
  for (const bool legacy : {false, true}) {
    const std::string bytes = to_bytes(legacy ? swapped : words);
    Evt21Decoder decoder({640, 480}, legacy);
    std::vector<Event> events;
    std::vector<TriggerEvent> triggers;
    CHECK(decoder.decode(as_span(bytes), events, triggers) == bytes.size());
    REQUIRE(events.size() == 2 + 20 + 1);
    CHECK(events[0] == Event{32, 7, 1, 133});
    CHECK(events[1] == Event{63, 7, 1, 133});
    CHECK(events[2] == Event{620, 7, 0, 134});
    CHECK(events[21] == Event{639, 7, 0, 134});
    CHECK(events[22] == Event{9, 1, 1, 130});
    CHECK(triggers == std::vector<TriggerEvent>{{3, true, 136}});
    CHECK(decoder.statistics() == RecordingStatistics{.events = 23,
                                                      .triggers = 1,
                                                      .dropped_before_time = 2,
                                                      .off_sensor = 12 + 3,
                                                      .time_steps_back = 1,
                                                      .unknown_words = 1});
  }
}

TEST_CASE("EVT2.1: garbled data neither crashes nor leaves the sensor") {
  std::mt19937 random(11);
  const SensorSize size{1280, 720};
  std::string bytes(100003, '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  Evt21Decoder decoder(size);
  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
  decoder.decode(as_span(bytes), events, triggers);
  CHECK(events.size() > 1000);
  bool inside = true;
  for (const Event& event : events) inside = inside && size.contains(event.x, event.y);
  CHECK(inside);
}
