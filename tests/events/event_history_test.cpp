#include "evmarker/events/event_history.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <deque>
#include <random>
#include <string>

#include "message_of.hpp"

using evmarker::Event;
using evmarker::EventHistory;
using evmarker::Timestamp;

namespace {

Event timed(Timestamp t) { return {static_cast<std::uint16_t>(t % 640), 0, 1, t}; }

std::vector<Timestamp> in_order(const EventHistory& history) {
  std::vector<Timestamp> times;
  for (std::size_t i = 0; i < history.size(); ++i) times.push_back(history[i].t);
  return times;
}
std::vector<Timestamp> since(const EventHistory& history, std::uint64_t position) {
  std::vector<Timestamp> times;
  for (auto i = std::max(position, history.pushed() - history.size()); i < history.pushed(); ++i)
    times.push_back(history.at(i).t);
  return times;
}
using Times = std::vector<Timestamp>;

}  // namespace

TEST_CASE("capacity is rounded up to a power of two and never 0") {
  CHECK(EventHistory(1).capacity() == 1);
  CHECK(EventHistory(2).capacity() == 2);
  CHECK(EventHistory(3).capacity() == 4);
  CHECK(EventHistory(1000).capacity() == 1024);
  try {
    EventHistory history(0);
    FAIL("capacity 0 was accepted");
  } catch (const std::invalid_argument& error) {
    CHECK(std::string(error.what()) == "event history: capacity is 0");
  }
}

TEST_CASE("a capacity beyond all memory is refused with its value") {
  for (const std::size_t capacity : {SIZE_MAX, SIZE_MAX / 2 + 2, SIZE_MAX / 16})
    CHECK(message_of([&] { (void)EventHistory(capacity); }) ==
          "event history: capacity is " + std::to_string(capacity));
}

TEST_CASE("an empty history has nothing to tell") {
  const EventHistory history(4);
  CHECK(history.size() == 0);
  CHECK_FALSE(history.full());
  CHECK(history.pushed() == 0);
  CHECK(since(history, 0).empty());
}

TEST_CASE("events are kept in order until the ring is full, then the oldest goes") {
  EventHistory history(4);
  for (Timestamp t = 1; t <= 3; ++t) history.push(timed(t));
  CHECK(in_order(history) == Times{1, 2, 3});
  CHECK_FALSE(history.full());
  history.push(timed(4));
  CHECK(in_order(history) == Times{1, 2, 3, 4});
  CHECK(history.full());
  history.push(timed(5));
  CHECK(in_order(history) == Times{2, 3, 4, 5});
  CHECK(history.full());
  CHECK(history.pushed() == 5);
  CHECK(history[0] == timed(2));  // whole events, not only their times
}

TEST_CASE("events since a position are those pushed after it that are still kept") {
  EventHistory history(4);
  for (Timestamp t = 0; t < 3; ++t) history.push(timed(t));
  const std::uint64_t position = history.pushed();
  CHECK(since(history, position).empty());
  history.push(timed(3));
  history.push(timed(4));
  CHECK(since(history, position) == Times{3, 4});
  CHECK(since(history, 0) == Times{1, 2, 3, 4});
  for (Timestamp t = 5; t < 12; ++t) history.push(timed(t));
  CHECK(since(history, position) == Times{8, 9, 10, 11});  // the rest is forgotten
  CHECK(since(history, history.pushed() + 5).empty());
}

TEST_CASE("clearing forgets the events and keeps the position in the stream") {
  EventHistory history(4);
  for (Timestamp t = 0; t < 6; ++t) history.push(timed(t));
  history.clear();
  CHECK(history.size() == 0);
  CHECK_FALSE(history.full());
  CHECK(history.pushed() == 6);
  CHECK(since(history, 0).empty());
  history.push(timed(6));
  CHECK(in_order(history) == Times{6});
  CHECK(since(history, 3) == Times{6});
  for (Timestamp t = 7; t < 12; ++t) history.push(timed(t));
  CHECK(in_order(history) == Times{8, 9, 10, 11});
}

TEST_CASE("a copy goes on by itself") {
  EventHistory history(2);
  history.push(timed(1));
  EventHistory copy = history;
  history.push(timed(2));
  copy.push(timed(3));
  CHECK(in_order(history) == Times{1, 2});
  CHECK(in_order(copy) == Times{1, 3});
}

TEST_CASE("a long stream with clears agrees with a deque") {
  EventHistory history(5);
  std::deque<Timestamp> expected;
  std::mt19937 random(3);
  for (Timestamp t = 0; t < 5000; ++t) {
    if (random() % 23 == 0) {
      history.clear();
      expected.clear();
    }
    history.push(timed(t));
    expected.push_back(t);
    if (expected.size() > 8) expected.pop_front();
    REQUIRE(in_order(history) == Times(expected.begin(), expected.end()));
    const std::uint64_t position = history.pushed() - random() % 12 % (history.pushed() + 1);
    Times later;
    for (const Timestamp kept : expected)
      if (kept >= static_cast<Timestamp>(position)) later.push_back(kept);
    REQUIRE(since(history, position) == later);
  }
}
