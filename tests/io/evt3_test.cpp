#include "evmarker/io/evt3.hpp"

#include <doctest/doctest.h>

#include "io/test_support.hpp"
#include "sanitized.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

Decoded decode_evt3(const std::vector<std::uint16_t>& words, SensorSize size = {640, 480}) {
  return decode_with(Evt3Decoder(size), as_span(to_bytes(words)));
}

// Words by hand, from the format's description.
constexpr std::uint16_t y(unsigned v) { return static_cast<std::uint16_t>(v); }
constexpr std::uint16_t x(unsigned v, unsigned p) { return static_cast<std::uint16_t>(0x2000U | p << 11U | v); }
constexpr std::uint16_t base(unsigned v, unsigned p) { return static_cast<std::uint16_t>(0x3000U | p << 11U | v); }
constexpr std::uint16_t v12(unsigned v) { return static_cast<std::uint16_t>(0x4000U | v); }
constexpr std::uint16_t v8(unsigned v) { return static_cast<std::uint16_t>(0x5000U | v); }
constexpr std::uint16_t low(unsigned v) { return static_cast<std::uint16_t>(0x6000U | v); }
constexpr std::uint16_t high(unsigned v) { return static_cast<std::uint16_t>(0x8000U | v); }

std::vector<Timestamp> times(const std::vector<Event>& events) {
  std::vector<Timestamp> t;
  for (const Event& event : events) t.push_back(event.t);
  return t;
}

Decoded round_trip(const std::vector<Event>& events, SensorSize size, std::size_t* bytes_written = nullptr) {
  std::vector<std::byte> bytes;
  Evt3Encoder encoder(size.width);
  encoder.encode(events, bytes);
  if (bytes_written != nullptr) *bytes_written = bytes.size();
  return decode_with(Evt3Decoder(size), bytes);
}

}  // namespace

TEST_CASE("EVT3: single events carry row, column, polarity and time") {
  const auto [events, triggers, statistics] =
      decode_evt3({0x8001, 0x6002, 0x0064, 0x2832, 0x2033});  // high 1, low 2, row 100, x 50 ON, x 51 OFF
  CHECK(events == std::vector<Event>{{50, 100, 1, 4098}, {51, 100, 0, 4098}});
  CHECK(triggers.empty());
  CHECK(statistics == RecordingStatistics{.events = 2});
}

TEST_CASE("EVT3: each bit of a vector is a column, and the next vector begins behind it") {
  const auto [events, triggers, statistics] =
      decode_evt3({high(0), low(7), y(3), base(100, 1), v12(0b100000000001), v8(0b10000001), v12(0b10)});
  const std::vector<Event> expected{{100, 3, 1, 7}, {111, 3, 1, 7}, {112, 3, 1, 7}, {119, 3, 1, 7}, {121, 3, 1, 7}};
  CHECK(events == expected);
  CHECK(statistics.events == 5);
}

TEST_CASE("EVT3: VECT_8 holds eight bits, a single event keeps the vector's base") {
  const auto events = decode_evt3({high(0), y(3), base(100, 0), v8(0xF01), x(5, 1), v8(0x01)}).events;
  CHECK(events == std::vector<Event>{{100, 3, 0, 0}, {5, 3, 1, 0}, {108, 3, 0, 0}});
}

TEST_CASE("EVT3: a changed TIME_HIGH clears the low part, a repeated one does not") {
  const auto events = decode_evt3({high(5), low(9), y(0), x(0, 0), high(5), x(1, 0), high(6), x(2, 0)}).events;
  CHECK(times(events) == std::vector<Timestamp>{5 * 4096 + 9, 5 * 4096 + 9, 6 * 4096});
}

TEST_CASE("EVT3: the clock wraps every 2^24 us, any number of times") {
  const auto [events, triggers, statistics] = decode_evt3(
      {high(4095), low(4095), y(0), x(0, 0), high(0), x(1, 0), high(2047), high(4094), x(2, 0), high(1), x(3, 0)});
  CHECK(times(events) == std::vector<Timestamp>{(1 << 24) - 1, 1 << 24, (1 << 24) + (4094 << 12), (2 << 24) + 4096});
  CHECK(statistics.time_steps_back == 0);
}

TEST_CASE("EVT3: a step back by 2048 time words or more is a wrap") {
  CHECK(times(decode_evt3({high(3000), high(952), y(0), x(0, 0)}).events) ==
        std::vector<Timestamp>{(Timestamp{1} << 24) + 952 * 4096});
  CHECK(times(decode_evt3({high(3000), high(953), y(0), x(0, 0)}).events) == std::vector<Timestamp>{953 * 4096});
}

TEST_CASE("EVT3: a step back in time is delivered, counted and not carried over to later times") {
  const auto [events, triggers, statistics] =
      decode_evt3({high(9), low(500), y(0), x(0, 0), low(100), x(1, 0), high(8), x(2, 0), high(9), low(600), x(3, 0)});
  CHECK(times(events) == std::vector<Timestamp>{9 * 4096 + 500, 9 * 4096 + 100, 8 * 4096, 9 * 4096 + 600});
  CHECK(statistics.time_steps_back == 2);
  CHECK(decode_evt3({high(9), low(500), y(0), x(0, 0), low(100), low(700), x(1, 0)}).statistics.time_steps_back == 0);
}

TEST_CASE("EVT3: a step back is counted once however the stream is cut into pieces") {
  const std::string bytes = to_bytes<std::uint16_t>(
      {high(9), low(500), y(0), x(0, 0), low(100), x(1, 0), x(2, 0), high(10), x(3, 0), low(9), low(4), x(4, 1)});
  for (const std::size_t piece : {2U, 4U, 6U, 10U, 24U}) {
    Evt3Decoder decoder({640, 480});
    std::vector<Event> events;
    std::vector<TriggerEvent> triggers;
    for (std::size_t i = 0; i < bytes.size(); i += piece)
      decode_append(decoder, as_span(bytes).subspan(i, std::min(piece, bytes.size() - i)), events, triggers);
    CHECK(events.size() == 5);
    CHECK(decoder.statistics().time_steps_back == 1);
  }
}

TEST_CASE("EVT3: a garbled TIME_HIGH that the next contradicts is not followed") {
  for (const unsigned last : {0U, 5U, 2047U, 2048U, 4090U, 4095U})
    for (unsigned garbled = 0; garbled < 4096; garbled += 7)
      for (const unsigned step : {0U, 1U, 3U}) {
        const unsigned next = (last + step) % 4096;
        const auto stream = [&](unsigned second) {
          return decode_evt3({high(last), low(9), y(0), x(0, 0), high(second), x(1, 0), high(next), low(20), x(2, 0),
                              high((next + 1) % 4096), low(1), x(3, 0)});
        };
        const Decoded intact = stream(last), decoded = stream(garbled);
        const unsigned ahead = (garbled - last) % 4096, behind = (last - garbled) % 4096;
        if (ahead < 16 + step || behind < 16) continue;  // no jump
        CAPTURE(last);
        CAPTURE(garbled);
        CAPTURE(step);
        CHECK(decoded.events == intact.events);
        CHECK(decoded.statistics.garbled_times == 1);
        CHECK(decoded.statistics.time_steps_back == 0);
      }
}

TEST_CASE("EVT3: two garbled TIME_HIGH in a row shift nothing behind the next one") {
  for (const unsigned last : {0U, 2048U, 4090U})
    for (unsigned first = 0; first < 4096; first += 37)
      for (unsigned second = 0; second < 4096; second += 37) {
        const unsigned next = (last + 1) % 4096;
        const auto far = [](unsigned a, unsigned b) { return (a - b) % 4096 > 20 && (b - a) % 4096 > 20; };
        if (!far(first, last) || !far(second, last) || !far(first, second)) continue;
        const auto behind = [&](unsigned one, unsigned two) {
          const Decoded decoded = decode_evt3({high(last), y(0), x(0, 0), high(one), x(1, 0), high(two), x(2, 0),
                                               high(next), x(3, 0), high((last + 2) % 4096), x(4, 0)});
          REQUIRE(decoded.events.size() == 5);
          return std::pair(decoded.events[3].t, decoded.events[4].t);
        };
        CAPTURE(last);
        CAPTURE(first);
        CAPTURE(second);
        CHECK(behind(first, second) == behind(last, last));
      }
}

TEST_CASE("EVT3: a jump that the next TIME_HIGH goes on from is followed") {
  const auto after = [](unsigned from, unsigned to) {
    const Decoded decoded = decode_evt3({high(from), y(0), x(0, 0), high(to), x(1, 0), high(to + 1), x(2, 0)});
    CHECK(decoded.statistics.garbled_times == 0);
    return times(decoded.events);
  };
  const auto us = [](Timestamp count) { return count * 4096; };
  CHECK(after(3000, 10) == std::vector<Timestamp>{us(3000), us(4096 + 10), us(4096 + 11)});
  CHECK(after(1000, 10) == std::vector<Timestamp>{us(1000), us(10), us(11)});  // the camera was restarted
  CHECK(after(1000, 900) == std::vector<Timestamp>{us(1000), us(900), us(901)});
  CHECK(after(1000, 2500) == std::vector<Timestamp>{us(1000), us(2500), us(2501)});
}

TEST_CASE("EVT3: however the stream is cut into pieces, a garbled TIME_HIGH does not shift what is behind the next") {
  const std::string bytes = to_bytes<std::uint16_t>({high(100), low(1), y(0), x(0, 0), high(3000), low(2), x(1, 0),
                                                     x(2, 0), high(101), low(3), x(3, 0), high(102), low(4), x(4, 0)});
  for (std::size_t piece = 2; piece <= bytes.size(); piece += 2) {
    Evt3Decoder decoder({640, 480});
    std::vector<Event> events;
    std::vector<TriggerEvent> triggers;
    for (std::size_t i = 0; i < bytes.size(); i += piece)
      decode_append(decoder, as_span(bytes).subspan(i, std::min(piece, bytes.size() - i)), events, triggers);
    REQUIRE(events.size() == 5);
    CHECK(events[3].t == 101 * 4096 + 3);
    CHECK(events[4].t == 102 * 4096 + 4);
    CHECK(decoder.statistics().garbled_times == 1);
  }
}

TEST_CASE("EVT3: everything before the first TIME_HIGH is dropped and counted") {
  const auto [events, triggers, statistics] =
      decode_evt3({low(5), y(1), x(0, 0), base(0, 0), v12(0xFFF), v8(0xFFF), 0xA001, high(1), y(2), x(7, 1)});
  CHECK(events == std::vector<Event>{{7, 2, 1, 4096}});
  CHECK(triggers.empty());
  CHECK(statistics.dropped_before_time == 1 + 12 + 8 + 1);
}

TEST_CASE("EVT3: events off the sensor are counted, not delivered") {
  const SensorSize size{20, 10};
  CHECK(decode_evt3({high(0), x(3, 0), y(1), v12(1)}, size).statistics.off_sensor == 2);  // no row yet; no base yet
  const auto [events, triggers, statistics] =
      decode_evt3({high(0), y(9), x(19, 0), x(20, 0), x(2047, 0), base(15, 1), v12(0xFFF), v12(0x3), v8(0xFF), y(10),
                   x(0, 0), base(0, 0), v12(0x7)},
                  size);
  CHECK(events ==
        std::vector<Event>{{19, 9, 0, 0}, {15, 9, 1, 0}, {16, 9, 1, 0}, {17, 9, 1, 0}, {18, 9, 1, 0}, {19, 9, 1, 0}});
  CHECK(statistics.off_sensor == 2 + 7 + 2 + 8 + 1 + 3);
}

TEST_CASE("EVT3: a run of vectors past the sensor's edge yields nothing, however long") {
  Evt3Decoder decoder({640, 480});
  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
  decode_append(decoder, as_span(to_bytes<std::uint16_t>({high(1), y(3), base(0, 1)})), events, triggers);
  // The column would pass 2^32 after 357913942 words; under sanitizers those are too many.
  constexpr std::size_t kWords = std::size_t{1} << 20, kRuns = kSanitized ? 4 : 342;
  const std::string run = to_bytes(std::vector<std::uint16_t>(kWords, v12(0xFFF)));
  std::uint64_t count = 0;
  std::vector<Event> buffer(kWords * Evt3Decoder::kMaxEventsPerWord);
  for (std::size_t i = 0; i < kRuns; ++i) count += decoder.decode(as_span(run), buffer, triggers);
  CHECK(count == 640);
  CHECK(decoder.statistics().off_sensor == 12 * kWords * kRuns - 640);
}

TEST_CASE("EVT3: a vector of which words are missing yields exactly its events") {
  const std::vector<Event> first{{100, 3, 1, 4096}, {111, 3, 1, 4096}}, second{{112, 3, 1, 4096}},
      last{{5, 4, 0, 4096}, {200, 4, 0, 4096}};
  for (const bool two : {false, true})
    for (const std::uint16_t other : {y(4), x(9, 1), low(0), high(1), base(50, 1), std::uint16_t{0xA001},
                                      std::uint16_t{0xE123}, std::uint16_t{0x1000}}) {
      std::vector<std::uint16_t> words{high(1), y(3), base(100, 1), v12(0x801)};
      if (two) words.push_back(v12(1));
      words.insert(words.end(), {other, y(4), x(5, 0), base(200, 0), v12(1), v12(0), v8(0)});
      std::vector<Event> expected = first;
      if (two) expected.insert(expected.end(), second.begin(), second.end());
      if (other == x(9, 1)) expected.push_back({9, 3, 1, 4096});
      expected.insert(expected.end(), last.begin(), last.end());
      CHECK(decode_evt3(words).events == expected);
    }
}

TEST_CASE("EVT3: triggers, ignored words and unknown words") {
  const auto [events, triggers, statistics] =
      decode_evt3({high(1), low(1), 0xA601, 0xA100, 0x7ABC, 0xE123, 0xF456, 0x1000, 0x9000, 0xB000, 0xC000, 0xD000});
  CHECK(events.empty());
  CHECK(triggers == std::vector<TriggerEvent>{{6, true, 4097}, {1, false, 4097}});
  CHECK(statistics.triggers == 2);
  CHECK(statistics.unknown_words == 5);
}

TEST_CASE("EVT3: what is written is read back, event for event") {
  const SensorSize size{640, 480};
  for (const bool steps_back : {false, true}) {
    const auto events = random_events(size, 30000, steps_back ? 5U : 4U, steps_back);
    const Decoded decoded = round_trip(events, size);
    CHECK(decoded.events == events);
    std::uint64_t back = 0;
    for (std::size_t i = 1; i < events.size(); ++i) back += events[i].t < events[i - 1].t ? 1U : 0U;
    CHECK((back > 0) == steps_back);
    CHECK(decoded.statistics == RecordingStatistics{.events = events.size(), .time_steps_back = back});
  }
}

TEST_CASE("EVT3: events at any times, with jumps to and fro, are read back") {
  std::mt19937 random(7);
  std::vector<Event> events;
  for (int i = 0; i < 3000; ++i)
    events.push_back({1, 2, 1, (Timestamp{i / 500} << 24) + static_cast<Timestamp>(random() % (1U << 24))});
  const Decoded decoded = round_trip(events, {640, 480});
  CHECK(decoded.events == events);
  CHECK(decoded.statistics.garbled_times == 0);
}

TEST_CASE("EVT3: the order of events is kept where a vector would change it") {
  const std::vector<Event> events{{5, 1, 1, 10}, {4, 1, 1, 10},   {4, 1, 1, 10}, {6, 1, 1, 10}, {7, 1, 1, 10},
                                  {8, 1, 0, 10}, {9, 1, 1, 10},   {7, 1, 1, 10}, {8, 1, 1, 10}, {9, 1, 1, 10},
                                  {9, 1, 1, 10}, {639, 1, 1, 10}, {0, 0, 0, 10}};
  CHECK(round_trip(events, {640, 480}).events == events);
}

TEST_CASE("EVT3: neighbours in a row share words") {
  std::vector<Event> events;
  for (std::uint16_t column = 0; column < 640; ++column) events.push_back({column, 3, 1, 77});
  std::size_t bytes = 0;
  CHECK(round_trip(events, {640, 480}, &bytes).events == events);
  CHECK(bytes == 2 * (2 + 1 + 20 * 4));  // time, row, 640 / 32 vectors of four words
}

TEST_CASE("EVT3: vectors of 12, 12 and 8 columns, all on the sensor, as cameras write them") {
  for (const int width : {640, 346, 33, 32, 31}) {
    std::vector<Event> events;
    for (int i = 0; i < 4; ++i)
      for (int column = i; column < width; column += 1 + i)
        events.push_back({static_cast<std::uint16_t>(column), static_cast<std::uint16_t>(i), 1, 77 + i});
    CHECK(round_trip(events, {width, 480}).events == events);

    std::vector<std::byte> bytes;
    Evt3Encoder(width).encode(events, bytes);
    std::vector<unsigned> words;
    for (std::size_t i = 0; i < bytes.size(); i += 2)
      words.push_back(std::to_integer<unsigned>(bytes[i]) | std::to_integer<unsigned>(bytes[i + 1]) << 8U);
    int vectors = 0, others = 0;
    for (std::size_t i = 0; i < words.size(); ++i) {
      const auto type = [&](std::size_t ahead) { return i + ahead < words.size() ? words[i + ahead] >> 12U : 0; };
      others += type(0) == 4 || type(0) == 5;
      if (type(0) != 3) continue;
      ++vectors;
      CHECK((type(1) == 4 && type(2) == 4 && type(3) == 5));
      CHECK((words[i] & 0x7FFU) + 32 <= static_cast<unsigned>(width));
      i += 3;
    }
    CHECK(others == 0);
    CHECK((vectors > 0) == (width >= 32));
  }
}

TEST_CASE("EVT3: long pauses, the first event late, and steps back of seconds") {
  const Timestamp loop = Timestamp{1} << 24;
  for (const std::vector<Timestamp>& t :
       {std::vector<Timestamp>{0, 1, loop - 1, loop, 2 * loop + 5, 60 * loop, 60 * loop + loop / 2 + 8000000},
        std::vector<Timestamp>{913716224, 913716225, 913812095},
        std::vector<Timestamp>{loop - 1, 100, 16000000, 200},  // steps back by nearly the whole range
        std::vector<Timestamp>{5 * loop + 4095, 5 * loop + 4094, 5 * loop}}) {
    std::vector<Event> events;
    for (const Timestamp time : t) events.push_back({1, 2, 1, time});
    CHECK(round_trip(events, {640, 480}).events == events);
  }
}

TEST_CASE("EVT3: times and ids that it cannot express are refused") {
  std::vector<std::byte> bytes;
  const auto refuse = [&](Timestamp first, Timestamp second) {
    Evt3Encoder encoder(640);
    const std::vector<Event> events{{0, 0, 0, first}, {0, 0, 0, second}};
    return error_of<std::invalid_argument>([&] { encoder.encode(events, bytes); });
  };
  CHECK(contains(refuse(1 << 24, (1 << 24) - 1), "t is 16777215"));
  CHECK(contains(refuse(5, -3), "t is -3"));
  CHECK(contains(refuse(5, 1700000000000000), "too far ahead"));
  CHECK(refuse((1 << 24) - 1, 1 << 24).empty());
  Evt3Encoder encoder(640);
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   encoder.encode(TriggerEvent{16, true, 0}, bytes);
                 }),
                 "id is 16"));
  CHECK(contains(error_of<std::invalid_argument>([&] {
                   encoder.encode(TriggerEvent{1, true, -1}, bytes);
                 }),
                 "t is -1"));
}

TEST_CASE("EVT3: triggers are written between events") {
  std::vector<std::byte> bytes;
  Evt3Encoder encoder(640);
  encoder.encode(std::vector<Event>{{1, 2, 1, 5000}}, bytes);
  encoder.encode(TriggerEvent{15, true, 5001}, bytes);
  encoder.encode(TriggerEvent{0, false, 9000}, bytes);
  encoder.encode(std::vector<Event>{{1, 2, 0, 9000}}, bytes);
  const auto [events, triggers, statistics] = decode_with(Evt3Decoder({640, 480}), bytes);
  CHECK(events == std::vector<Event>{{1, 2, 1, 5000}, {1, 2, 0, 9000}});
  CHECK(triggers == std::vector<TriggerEvent>{{15, true, 5001}, {0, false, 9000}});
}
