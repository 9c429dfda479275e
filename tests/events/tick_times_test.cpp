#include "evmarker/events/tick_times.hpp"

#include <doctest/doctest.h>

#include <chrono>
#include <limits>
#include <span>
#include <vector>

using namespace evmarker;
using namespace std::chrono_literals;

namespace {

// The ticks before each event of a batch, as those who push events to a tracker take them.
std::vector<Timestamp> ticks_of(TickTimes& ticks, const std::vector<Timestamp>& times) {
  std::vector<Event> events;
  for (const Timestamp t : times) events.push_back({.t = t});
  std::vector<Timestamp> taken;
  ticks.begin(times.front(), times.back());
  for (std::span<const Event> left = events; !left.empty();) {
    while (const auto t = ticks.take_due(left.front().t)) taken.push_back(*t);
    const auto until_tick = ticks.before_next(left);
    for (std::size_t i = 1; i < until_tick.size(); ++i) CHECK(until_tick[i].t < ticks.next());
    left = left.subspan(until_tick.size());
  }
  return taken;
}

}  // namespace

TEST_CASE(
    "ticks are the multiples of the interval that events have come to, each before the first event at or after it") {
  TickTimes ticks(1000us, 1s);
  CHECK_FALSE(ticks.started());
  CHECK_FALSE(ticks.take_due(5000));
  CHECK(ticks_of(ticks, {1500, 1999, 2000, 2001, 4100}) == std::vector<Timestamp>{2000, 3000, 4000});
  CHECK(ticks.next() == 5000);
  CHECK(ticks.last_t() == 4100);
  CHECK(ticks_of(ticks, {4200, 5000, 5001}) == std::vector<Timestamp>{5000});
}

TEST_CASE("a restarted clock, a pause and a jump are survived without a million ticks") {
  TickTimes ticks(10000us, 1s);
  CHECK(ticks_of(ticks, {500000, 510000}) == std::vector<Timestamp>{500000, 510000});
  CHECK(ticks_of(ticks, {509000, 521000}) == std::vector<Timestamp>{520000});  // a little disorder
  CHECK(ticks_of(ticks, {100, 10100}) == std::vector<Timestamp>{10000});       // restarted
  CHECK(ticks_of(ticks, {910000}).size() == 90);
  CHECK(ticks_of(ticks, {Timestamp{1} << 40}).size() <= 1);
  CHECK(ticks_of(ticks, {std::numeric_limits<Timestamp>::max()}).size() <= 1);
}
