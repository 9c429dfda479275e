#include "evmarker/io/event_collector.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/io/packed_events.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

constexpr SensorSize kSensor{640, 480};

/// What should become of the events of a file.
struct Kept {
  std::vector<Event> events;
  RecordingStatistics statistics;
};
Kept kept_of(const std::vector<Event>& recorded) {
  Kept kept;
  for (const Event& event : recorded) {
    if (event.x >= kSensor.width || event.y >= kSensor.height) {
      ++kept.statistics.off_sensor;
      continue;
    }
    if (!kept.events.empty() && event.t < kept.events.back().t) ++kept.statistics.time_steps_back;
    kept.events.push_back(event);
    kept.events.back().p = event.p > 0 ? 1 : 0;
  }
  kept.statistics.events = kept.events.size();
  return kept;
}

std::vector<Event> events_of(const EventCollector& collector) {
  return {collector.events().begin(), collector.events().end()};
}

/// Adds the events in three parts, in the way that `add` does it, and compares what is kept.
template <typename Add>
void check_added(const std::vector<Event>& recorded, const Add& add) {
  EventCollector collector("a file", false);
  collector.set_sensor_size(kSensor);
  collector.start_batch();
  const std::size_t third = recorded.size() / 3;
  const auto all = std::span(recorded);
  for (const auto part : {all.first(third), all.subspan(third, third), all.subspan(2 * third)}) add(collector, part);
  const Kept expected = kept_of(recorded);
  CHECK(events_of(collector) == expected.events);
  CHECK(collector.statistics == expected.statistics);
}

void check_added(const std::vector<Event>& recorded) {
  check_added(recorded, [](EventCollector& collector, std::span<const Event> events) {
    for (const Event& event : events) collector.add(event.x, event.y, event.p > 0, event.t);
  });
  check_added(recorded, [](EventCollector& collector, std::span<const Event> events) {
    collector.add_each(events.size(), [&](std::size_t i) {
      const Event& event = events[i];
      return packed_event(event.x, event.y, static_cast<std::uint16_t>(event.p), event.t);
    });
  });
  check_added(recorded, [](EventCollector& collector, std::span<const Event> events) {
    std::ranges::copy(events, collector.room(events.size() + 5).begin());
    collector.add_filled(events.size());
  });
}

}  // namespace

TEST_CASE("EventCollector: keeps the same events however they are added") {
  const auto events = random_events(kSensor, 300, 1);
  check_added({});
  check_added(events);
  constexpr Timestamp kFirst = std::numeric_limits<Timestamp>::min(), kLast = std::numeric_limits<Timestamp>::max();
  const Event& some = events[150];
  for (const std::size_t at : {std::size_t{0}, std::size_t{99}, std::size_t{100}, std::size_t{150}, std::size_t{299}})
    for (const Event& unusual :
         {Event{639, 479, 1, some.t}, Event{640, 0, 1, some.t}, Event{0, 480, 1, some.t},
          Event{0xFFFF, 0xFFFF, 0, some.t}, Event{0x8000, 7, 1, some.t}, Event{7, 7, -1, some.t},
          Event{7, 7, 2, some.t}, Event{7, 7, 256, some.t},
          Event{7, 7, std::numeric_limits<std::int16_t>::min(), some.t}, Event{7, 7, 1, some.t - 1}, Event{7, 7, 1, -1},
          Event{7, 7, 1, kFirst}, Event{7, 7, 1, kLast}}) {
      CAPTURE(at);
      CAPTURE(unusual.x);
      CAPTURE(unusual.t);
      auto with_it = events;
      with_it[at] = unusual;
      check_added(with_it);
    }
}

TEST_CASE("EventCollector: of blocks of events, each is kept in its place") {
  auto events = random_events(kSensor, 5000, 2);
  events[600].x = 640;
  events[2500].y = 480;
  check_added(events);
}

TEST_CASE("EventCollector: times are shifted however events are added, the first that is kept to zero") {
  auto events = random_events(kSensor, 300, 2);
  events[0].x = 640;
  events[200].x = 640;
  const auto collect = [](const std::vector<Event>& recorded) {
    EventCollector collector("a file", true);
    collector.set_sensor_size(kSensor);
    collector.start_batch();
    std::string error;
    try {
      collector.add_each(recorded.size(), [&](std::size_t i) { return packed_event(recorded[i]); });
    } catch (const std::exception& fault) {
      error = fault.what();
    }
    return std::pair(events_of(collector), error);
  };
  auto shifted = kept_of(events).events;
  const Timestamp first = shifted[0].t;
  for (Event& event : shifted) event.t -= first;
  CHECK(collect(events) == std::pair(shifted, std::string()));

  events[250].t = std::numeric_limits<Timestamp>::min();
  shifted.resize(248);  // those before it, of which two are off the sensor
  const auto [kept, error] = collect(events);
  CHECK(kept == shifted);
  CHECK(contains(error, "too far from the first time"));
}

TEST_CASE("packed_event: an Event as it is in memory, of numbers or of the Event") {
  const Event event{0x1234, 0xFEDC, 1, -5};
  const PackedEvent of_numbers = packed_event(0x1234, 0xFEDC, 1, -5), of_event = packed_event(event);
  Event back;
  std::memcpy(static_cast<void*>(&back), &of_numbers, sizeof back);
  CHECK(back == event);
  CHECK(of_event[1] == of_numbers[1]);
}

TEST_CASE("UsualEvents: events on the sensor, of polarity 0 or 1, at times that do not step back") {
  const auto are_usual = [](const std::vector<Event>& events, SensorSize size = kSensor, Timestamp last = 0) {
    UsualEvents usual(last);
    for (const Event& event : events) usual.add(packed_event(event));
    CHECK(usual.all(size) == evmarker::io::are_usual(events, last, size));
    return usual.all(size);
  };
  CHECK(are_usual({}));
  CHECK(are_usual({{0, 0, 0, 0}, {639, 479, 1, 0}, {5, 5, 1, std::numeric_limits<Timestamp>::max()}}));
  CHECK(are_usual({{0x7FFF, 0x7FFF, 1, 7}}, {0xFFFF, 0xFFFF}));
  CHECK_FALSE(are_usual({{0xFFFF, 0, 1, 7}}, {0xFFFF, 0xFFFF}));
  CHECK_FALSE(are_usual({{0, 0, 0, 0}, {640, 5, 1, 8}, {5, 5, 1, 9}}));
  CHECK_FALSE(are_usual({{0, 480, 1, 8}}));
  CHECK_FALSE(are_usual({{5, 5, 2, 8}}));
  CHECK_FALSE(are_usual({{5, 5, -1, 8}}));
  CHECK_FALSE(are_usual({{5, 5, 1, 8}, {5, 5, 1, 7}}));
  CHECK_FALSE(are_usual({{5, 5, 1, 8}}, kSensor, 9));
  CHECK_FALSE(are_usual({{5, 5, 1, -8}}));
  CHECK_FALSE(are_usual({{5, 5, 1, 8}}, kSensor, -9));
  // Where the difference of the times overflows.
  CHECK_FALSE(are_usual({{5, 5, 1, std::numeric_limits<Timestamp>::max()}, {5, 5, 1, -2}}));
  CHECK_FALSE(are_usual({{5, 5, 1, std::numeric_limits<Timestamp>::min()}, {5, 5, 1, 2}}));
}

TEST_CASE("are_usual: of any number of events, none that is unusual is overlooked") {
  for (std::size_t count = 0; count < 8; ++count) {
    const auto events = random_events(kSensor, count, 3);
    CHECK(are_usual(events, 0, kSensor));
    for (std::size_t at = 0; at < count; ++at) {
      auto with_it = events;
      with_it[at].x = 640;
      CHECK_FALSE(are_usual(with_it, 0, kSensor));
      with_it = events;
      with_it[at].t = at > 0 ? events[at - 1].t - 1 : -1;
      CHECK_FALSE(are_usual(with_it, 0, kSensor));
    }
  }
}
