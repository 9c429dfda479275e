#include "evmarker/events/time_guard.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <span>
#include <vector>

using namespace evmarker;

namespace {

// What comes out of a guard, in order.
std::vector<Timestamp> through(TimeGuard& guard, const std::vector<Timestamp>& times) {
  std::vector<Timestamp> out;
  for (const Timestamp t : times) {
    const Event event{.t = t};
    TimeGuard::Verdict verdict;
    while ((verdict = guard.judge(event)) == TimeGuard::Verdict::release) out.push_back(guard.held().t);
    if (verdict == TimeGuard::Verdict::pass) out.push_back(t);
  }
  return out;
}

using Times = std::vector<Timestamp>;

}  // namespace

TEST_CASE("a single wrong time is discarded, of whatever size and sign") {
  for (Timestamp jump = 1000; jump <= Timestamp{1} << 40; jump *= 2)
    for (const Timestamp by : {jump, -jump}) {
      CAPTURE(by);
      TimeGuard guard;
      CHECK(through(guard, {0, 10, 20, 30 + by, 40, 50}) == Times{0, 10, 20, 40, 50});
      CHECK(guard.faults() == 1);
    }
}

TEST_CASE("a jump that lasts is followed, without an event lost") {
  for (Timestamp jump = 501; jump <= Timestamp{1} << 40; jump *= 2)
    for (const Timestamp by : {jump, -jump}) {
      CAPTURE(by);
      TimeGuard guard;
      const Times times{0, 10, 20, 30 + by, 40 + by, 35 + by, 50 + by};
      CHECK(through(guard, times) == times);
      CHECK(guard.faults() == 0);
    }
}

TEST_CASE("disorder passes at once") {
  TimeGuard guard;
  const Times times{1000, 1080, 1010, 1300, 1000, 1500};
  CHECK(through(guard, times) == times);
  CHECK(guard.faults() == 0);
}

TEST_CASE("events that are far apart wait for the next one, no longer") {
  TimeGuard guard;
  CHECK(through(guard, {0}) == Times{0});
  CHECK(through(guard, {10000}).empty());
  CHECK(guard.next_t(20000) == Timestamp{10000});
  CHECK(through(guard, {20000}) == Times{10000});
  CHECK(guard.next_t(30000) == Timestamp{20000});
  CHECK(through(guard, {20010}) == Times{20000, 20010});
  CHECK(guard.next_t(30000) == std::nullopt);
  CHECK(guard.next_t(20020) == Timestamp{20020});
  CHECK(guard.faults() == 0);
}

TEST_CASE("several wrong times in a row are discarded one by one, unless they agree") {
  TimeGuard guard;
  CHECK(through(guard, {0, 10, 1 << 20, -(1 << 25), 20, 1 << 30, 30}) == Times{0, 10, 20, 30});
  CHECK(guard.faults() == 3);
}

TEST_CASE("the ends of the range of times do no harm") {
  constexpr Timestamp kFirst = std::numeric_limits<Timestamp>::min(), kLast = std::numeric_limits<Timestamp>::max();
  for (const Timestamp wrong : {kFirst, kLast}) {
    TimeGuard guard;
    CHECK(through(guard, {0, wrong, 10}) == Times{0, 10});
    CHECK(through(guard, {wrong, wrong}) == Times{wrong, wrong});
    CHECK(through(guard, {5, 6}) == Times{5, 6});
  }
}

TEST_CASE("after events that are missing it goes on at the time that it is told") {
  TimeGuard guard;
  through(guard, {0, 10, 50000});
  guard.restart(100000);
  CHECK(guard.faults() == 1);
  CHECK(through(guard, {100010}) == Times{100010});
}

TEST_CASE("many events at once come out as they do one by one") {
  std::mt19937 random(1);
  Times times;
  for (Timestamp t = 0; times.size() < 5000; t += static_cast<Timestamp>(random() % 20)) {
    if (random() % 50 == 0) t += static_cast<Timestamp>(random() % 2000) - 1000;  // stays there
    times.push_back(t);
    if (random() % 50 == 0) times.back() += static_cast<Timestamp>(random() % 20000) - 10000;  // a fault
  }
  TimeGuard one_by_one, at_once;
  const Times expected = through(one_by_one, times);
  std::vector<Event> events;
  for (const Timestamp t : times) events.push_back({.t = t});
  Times out;
  for (std::span<const Event> all(events); !all.empty();) {
    std::span<const Event> batch = all.first(std::min<std::size_t>(all.size(), random() % 1500));
    all = all.subspan(batch.size());
    while (!batch.empty())
      for (const Event& event : at_once.next(batch)) out.push_back(event.t);
  }
  CHECK(out == expected);
  CHECK(at_once.faults() == one_by_one.faults());
  CHECK(at_once.faults() > 10);
  CHECK(out.size() > 4000);
}
