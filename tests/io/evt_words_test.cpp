#include "evmarker/io/evt_words.hpp"

#include <doctest/doctest.h>

#include <random>

#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

TEST_CASE_TEMPLATE("EVT decoders: garbled data neither crashes nor yields events off the sensor", Decoder, Evt2Decoder,
                   Evt21Decoder, Evt3Decoder) {
  std::mt19937 random(20240611);
  std::uint64_t yielded = 0, off_sensor = 0;
  for (int round = 0; round < 200; ++round) {
    const SensorSize size{1 + static_cast<int>(random() % 1300), 1 + static_cast<int>(random() % 800)};
    std::string bytes(2001, '\0');
    for (char& c : bytes) c = static_cast<char>(random());
    Decoder decoder(size);
    std::vector<Event> events;
    std::vector<TriggerEvent> triggers;
    CHECK(decode_append(decoder, as_span(bytes), events, triggers) == 2000);
    bool inside = true;
    for (const Event& event : events) inside = inside && size.contains(event.x, event.y) && (event.p & ~1) == 0;
    CHECK(inside);
    CHECK(decoder.statistics().events == events.size());
    yielded += events.size();
    off_sensor += decoder.statistics().off_sensor;
  }
  CHECK(yielded > (Decoder::kMaxEventsPerWord == 1 ? 500 : 5000));
  CHECK(off_sensor > yielded);
}
