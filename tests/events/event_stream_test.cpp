#include "evmarker/events/event_stream.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstddef>
#include <iterator>
#include <span>
#include <utility>
#include <vector>

using evmarker::Event;
using evmarker::EventFilter;
using evmarker::EventSource;
using evmarker::SensorSize;
using evmarker::Timestamp;

namespace {

// Batches of the sizes 3, 1 and 2, then the end.
struct ThreeBatches {
  using event_type = Event;
  std::array<Event, 6> events{
      {{0, 0, 1, 10}, {1, 0, 0, 11}, {2, 0, 1, 12}, {3, 0, 0, 13}, {4, 0, 1, 14}, {5, 0, 0, 15}}};
  int batch = 0;

  SensorSize sensor_size() const { return {6, 1}; }
  std::span<const Event> next_batch() {
    const std::span<const Event> all(events);
    switch (batch++) {
      case 0: return all.subspan(0, 3);
      case 1: return all.subspan(3, 1);
      case 2: return all.subspan(4, 2);
      default: return {};
    }
  }
};

struct VectorSource {  // a container converts to a span
  using event_type = Event;
  std::vector<Event> events;
  SensorSize sensor_size() const { return {1, 1}; }
  const std::vector<Event>& next_batch() { return events; }
};
struct WithoutEventType {
  SensorSize sensor_size() const;
  std::span<const Event> next_batch();
};
struct WithoutSize {
  using event_type = Event;
  std::span<const Event> next_batch();
};
struct MutableSize {
  using event_type = Event;
  SensorSize sensor_size();
  std::span<const Event> next_batch();
};
struct PairSize {
  using event_type = Event;
  std::pair<int, int> sensor_size() const;
  std::span<const Event> next_batch();
};
struct WithoutBatches {
  using event_type = Event;
  SensorSize sensor_size() const;
  bool next(Event&);
};
struct OtherBatches {
  using event_type = Event;
  SensorSize sensor_size() const;
  std::span<const int> next_batch();
};
struct NoEvents {
  using event_type = int;
  SensorSize sensor_size() const;
  std::span<const int> next_batch();
};

struct OnlyOn {
  bool accept(const Event& event) { return event.p > 0; }
};
struct CountingAccept {
  int accept(const Event&);
};
struct WritesEvents {
  bool accept(Event&);
};

// 300 events at even times, of an input range that is not constant. Written out because Clang 14 cannot compile
// libstdc++'s views.
struct EvenTimes {
  struct Iterator {
    using difference_type = std::ptrdiff_t;
    using value_type = Event;
    Timestamp t = 0;

    Event operator*() const { return {0, 0, 0, t}; }
    Iterator& operator++() {
      t += 2;
      return *this;
    }
    void operator++(int) { ++*this; }
    bool operator==(std::default_sentinel_t) const { return t == 600; }
  };

  Iterator begin() { return {}; }
  std::default_sentinel_t end() { return {}; }
};

}  // namespace

static_assert(EventSource<ThreeBatches>);
static_assert(EventSource<VectorSource>);
static_assert(!EventSource<WithoutEventType>);
static_assert(!EventSource<WithoutSize>);
static_assert(!EventSource<MutableSize>);
static_assert(!EventSource<PairSize>);
static_assert(!EventSource<WithoutBatches>);
static_assert(!EventSource<OtherBatches>);
static_assert(!EventSource<NoEvents>);

static_assert(EventFilter<evmarker::AcceptAll>);
static_assert(EventFilter<OnlyOn>);
static_assert(!EventFilter<Event>);
static_assert(!EventFilter<CountingAccept>);
static_assert(!EventFilter<WritesEvents>);

TEST_CASE("every event of every batch is used once and in order") {
  ThreeBatches source;
  std::vector<Event> seen;
  evmarker::for_each_event(source, [&](const Event& event) { seen.push_back(event); });
  REQUIRE(seen.size() == 6);
  for (std::size_t i = 0; i < seen.size(); ++i) CHECK(seen[i] == source.events[i]);
  CHECK(source.batch == 4);  // the end was asked for once
}

TEST_CASE("an empty source uses nothing") {
  VectorSource source;
  int used = 0;
  evmarker::for_each_event(source, [&](const Event&) { ++used; });
  CHECK(used == 0);
}

TEST_CASE("AcceptAll accepts all") {
  evmarker::AcceptAll filter;
  CHECK(filter.accept({0, 0, 0, 0}));
  CHECK(filter.accept({65535, 65535, -1, -1}));
}

TEST_CASE("blocks are made of ranges that can be read once, and only by who may change them") {
  EvenTimes even;
  std::vector<Timestamp> times;
  evmarker::for_each_block(even, [&](std::span<const Event> block) {
    for (const Event& event : block) times.push_back(event.t);
  });
  REQUIRE(times.size() == 300);
  for (std::size_t i = 0; i < times.size(); ++i) CHECK(times[i] == static_cast<Timestamp>(2 * i));
}
