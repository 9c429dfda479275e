#include "evmarker/live/tick_clock.hpp"

#include <doctest/doctest.h>

#include <chrono>
#include <limits>
#include <vector>

using namespace evmarker;
using namespace std::chrono_literals;
using live::Clock;
using live::EventBlock;
using live::TickClock;

namespace {

using Ticks = std::vector<Timestamp>;

Ticks due(TickClock& clock, Timestamp now) {
  Ticks ticks;
  while (const auto t = clock.take_due(now)) ticks.push_back(*t);
  return ticks;
}

/// What the tracking thread does with a block.
Ticks play(TickClock& clock, const Ticks& times, Clock::time_point pushed = {}) {
  EventBlock block;
  block.begin(1, false, pushed);
  for (const Timestamp t : times) block.append(std::vector{Event{.t = t}}, pushed);
  clock.begin(block);
  Ticks ticks;
  for (const Timestamp t : times)
    for (const Timestamp tick : due(clock, t)) ticks.push_back(tick);
  return ticks;
}

}  // namespace

TEST_CASE("ticks come at the multiples of the interval, from the first event on, each once") {
  TickClock clock(1000us, 1s);
  CHECK(due(clock, 1000000).empty());  // no event has told the time yet
  CHECK(play(clock, {1500, 1999}).empty());
  CHECK(play(clock, {2000, 2000, 2001, 4100}) == Ticks{2000, 3000, 4000});
  CHECK(play(clock, {4200, 4999}).empty());
  CHECK(play(clock, {5000}) == Ticks{5000});
  TickClock on_time(1000us, 1s);
  CHECK(play(on_time, {-2000, -1500, 0}) == Ticks{-2000, -1000, 0});
  TickClock before_zero(1000us, 1s);
  CHECK(play(before_zero, {-1500, 10}) == Ticks{-1000, 0});
}

TEST_CASE("a clock that is restarted or jumps begins anew, a little disorder changes nothing") {
  TickClock clock(1000us, 1s);
  CHECK(play(clock, {500000, 502000}) == Ticks{500000, 501000, 502000});
  CHECK(play(clock, {499000, 503000}) == Ticks{503000});  // 3 ms late
  CHECK(play(clock, {100, 1100}) == Ticks{1000});         // restarted
  CHECK(play(clock, {900000}).size() == 899);             // a pause
  CHECK(play(clock, {Timestamp{1} << 40}).empty());       // no million ticks
  CHECK(play(clock, {(Timestamp{1} << 40) + 1000}).size() == 1);
}

TEST_CASE("the last time that there is brings no tick after it") {
  TickClock clock(1000us, 1s);
  constexpr Timestamp kLast = std::numeric_limits<Timestamp>::max();
  CHECK(play(clock, {kLast - 1000, kLast}).size() <= 1);
  CHECK(play(clock, {std::numeric_limits<Timestamp>::min(), kLast}).size() <= 1);
  CHECK(clock.now(Clock::time_point{1h}) == kLast);
  CHECK(play(clock, {1000, 2000}) == Ticks{1000, 2000});
}

TEST_CASE("without events the wall clock runs camera time on") {
  TickClock clock(1000us, 1s);
  const Clock::time_point wall{1h};
  CHECK(clock.wait(wall, 5ms) == 5ms);
  play(clock, {10000, 10200}, wall);
  CHECK(clock.now(wall) == 10200);
  CHECK(clock.now(wall + 700us) == 10900);
  CHECK(clock.wait(wall + 700us, 5ms) == 100us);
  CHECK(clock.wait(wall + 700us, 30us) == 30us);
  CHECK(clock.wait(wall + 900us, 5ms) == 0us);
  CHECK(due(clock, clock.now(wall + 2900us)) == Ticks{11000, 12000, 13000});
  CHECK(clock.wait(wall + 2900us, 5ms) == 900us);
  // Events that come later than that are no restart, and no tick is told again.
  CHECK(play(clock, {10300, 12500}, wall + 3ms).empty());
  CHECK(play(clock, {14000}, wall + 4ms) == Ticks{14000});
}

TEST_CASE("an interval that is none is named") {
  CHECK_THROWS_WITH(TickClock(0us, 1s), "pipeline: tick_interval [us] is 0");
}

TEST_CASE("after a garbled time, or a step back within a block, ticks go on with the next block") {
  for (const Timestamp garbled : {Timestamp{1} << 40, std::numeric_limits<Timestamp>::max(), Timestamp{7000000}}) {
    CAPTURE(garbled);
    TickClock clock(1000us, 1s);
    CHECK(play(clock, {1000, garbled, 2000}).front() == 1000);
    CHECK(play(clock, {3000, 5000}) == Ticks{3000, 4000, 5000});
  }
  TickClock slow(2000000us, 1s);  // an interval longer than the gap is none
  CHECK(play(slow, {100, 200}).empty());
  CHECK(play(slow, {300, 1100000}).empty());
  CHECK(play(slow, {2000000}) == Ticks{2000000});
}
