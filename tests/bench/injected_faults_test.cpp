#include "../../bench/injected_faults.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <string>
#include <vector>

using namespace evmarker;
using bench::Fault;
using bench::RecordingPiece;

namespace {

constexpr SensorSize kSensor{64, 48};
constexpr Timestamp kLength_us = 10000;
const std::vector<Timestamp> kMoments{2000, 6000};

// An event every microsecond, as the camera's clock says it.
std::vector<Event> plain_events(Timestamp begin, Timestamp end, Timestamp clock_ahead_us = bench::kClockAtBegin_us) {
  std::vector<Event> events;
  for (Timestamp t = begin; t < end; ++t) events.push_back({1, 2, 0, t + clock_ahead_us});
  return events;
}

std::vector<RecordingPiece> inject(const Fault& fault) {
  return with_fault(fault, plain_events(0, kLength_us, 0), kSensor, kMoments, 1);
}

std::vector<Event> only_piece(const Fault& fault) {
  const auto pieces = inject(fault);
  REQUIRE(pieces.size() == 1);
  CHECK(pieces.front().clock_ahead_us == bench::kClockAtBegin_us);
  return pieces.front().events;
}

bool in_fault(const Event& event, Timestamp duration_us) {
  return std::ranges::any_of(kMoments, [&](Timestamp begin) {
    const Timestamp since = event.t - bench::kClockAtBegin_us - begin;
    return since >= 0 && since < duration_us;
  });
}

// Those that a fault of this length does not concern.
std::vector<Event> outside(std::vector<Event> events, Timestamp duration_us) {
  std::erase_if(events, [&](const Event& event) { return in_fault(event, duration_us); });
  return events;
}

std::vector<Event> inside(std::vector<Event> events, Timestamp duration_us) {
  std::erase_if(events, [&](const Event& event) { return !in_fault(event, duration_us); });
  return events;
}

}  // namespace

TEST_CASE("missing events are those of the fault, and no others") {
  for (const Timestamp us : {1, 100, 3000}) {
    const auto events = only_piece(bench::missing_events("", us));
    CHECK(events == outside(plain_events(0, kLength_us), us));
    CHECK(events.size() == static_cast<std::size_t>(kLength_us - 2 * us));
  }
}

TEST_CASE("packets come twice, each in its order") {
  const auto events = only_piece(bench::packets_twice("", 1000, 300));
  REQUIRE(events.size() == kLength_us + 2 * 1000);
  const auto first = plain_events(2000, 2300);
  CHECK(std::equal(first.begin(), first.end(), events.begin() + 2000));
  CHECK(std::equal(first.begin(), first.end(), events.begin() + 2300));
  CHECK(outside(events, 1000) == outside(plain_events(0, kLength_us), 1000));
}

TEST_CASE("packets are exchanged by pairs, and none is lost") {
  auto events = only_piece(bench::packets_exchanged("", 1000, 300));
  REQUIRE(events.size() == kLength_us);
  const auto second = plain_events(2300, 2600), first = plain_events(2000, 2300);
  CHECK(std::equal(second.begin(), second.end(), events.begin() + 2000));
  CHECK(std::equal(first.begin(), first.end(), events.begin() + 2300));
  std::ranges::sort(events, {}, &Event::t);
  CHECK(events == plain_events(0, kLength_us));
}

TEST_CASE("of the garbled times, one in so many is wrong") {
  const auto events = only_piece(bench::garbled_times("", 1000, 100, 0x1p40)), right = plain_events(0, kLength_us);
  REQUIRE(events.size() == right.size());
  int wrong = 0;
  for (std::size_t i = 0; i < events.size(); ++i) wrong += events[i].t != right[i].t;
  CHECK(wrong == 20);
}

TEST_CASE("where the clock steps, a new piece begins, and without a fault none") {
  CHECK(only_piece(bench::clock_step("", 0)) == plain_events(0, kLength_us));
  for (const Timestamp step : {1000, -1000000}) {
    const auto pieces = inject(bench::clock_step("", step));
    REQUIRE(pieces.size() == 3);
    CHECK(pieces[0].events == plain_events(0, 2000));
    CHECK(pieces[1].events == plain_events(2000, 6000, bench::kClockAtBegin_us + step));
    CHECK(pieces[2].events == plain_events(6000, kLength_us, bench::kClockAtBegin_us + 2 * step));
    CHECK(pieces[2].clock_ahead_us == bench::kClockAtBegin_us + 2 * step);
  }
}

TEST_CASE("a hot column fires at its rate in every row, beside the events that there are") {
  constexpr Timestamp kFault_us = 2000;
  const auto events = only_piece(bench::hot_column("", kFault_us, 10000));
  CHECK(std::ranges::is_sorted(events, {}, &Event::t));
  std::vector<int> rows(kSensor.height);
  for (const Event& event : inside(events, kFault_us))
    if (event.x == kSensor.width / 2) ++rows[event.y];
  for (const int count : rows) {
    CHECK(count >= 2 * 17);  // 20 a fault, each pixel up to a tenth more or less
    CHECK(count <= 2 * 23);
  }
  int on = 0, off = 0;
  for (const Event& event : inside(only_piece(bench::hot_column("", kFault_us, 10000, true)), kFault_us))
    if (event.x == kSensor.width / 2) ++(event.p > 0 ? on : off);
  CHECK(off > 17 * kSensor.height);
  CHECK(on >= off);
  CHECK(outside(events, kFault_us) == outside(plain_events(0, kLength_us), kFault_us));
}

TEST_CASE("a burst of noise has its rate, on all of the sensor") {
  const auto events = only_piece(bench::noise_burst("", 1000, 20));
  CHECK(std::ranges::is_sorted(events, {}, &Event::t));
  CHECK(static_cast<double>(events.size()) == doctest::Approx(kLength_us + 2 * 20000).epsilon(0.001).scale(0));
  std::vector<bool> touched(static_cast<std::size_t>(kSensor.width * kSensor.height));
  for (const Event& event : events) {
    REQUIRE(kSensor.contains(event.x, event.y));
    touched[static_cast<std::size_t>(event.y * kSensor.width + event.x)] = true;
  }
  CHECK(std::ranges::count(touched, false) == 0);
}

TEST_CASE("a sensor that is restarted is silent, then every pixel fires, and its clock begins at 0") {
  const auto pieces = inject(bench::sensor_restart("", 3000));
  REQUIRE(pieces.size() == 3);
  const auto pixels = static_cast<std::size_t>(kSensor.width * kSensor.height);
  REQUIRE(pieces[0].events.size() == 2000 + pixels);
  for (std::size_t i = 2000; i < pieces[0].events.size(); ++i)
    CHECK(pieces[0].events[i].t >= bench::kClockAtBegin_us + 2000 + 3000 - 2000);
  CHECK(pieces[1].events.front().t == 0);
  CHECK(pieces[2].events.front().t == 0);
  CHECK(pieces[2].events.size() == static_cast<std::size_t>(kLength_us) - 9000);
}

TEST_CASE("faults have names of their own, and the first is none") {
  const auto faults = bench::all_faults();
  REQUIRE(faults.size() > 10);
  CHECK(only_piece(faults.front()) == plain_events(0, kLength_us));
  for (std::size_t i = 0; i < faults.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) CHECK(faults[i].name != faults[j].name);
}
