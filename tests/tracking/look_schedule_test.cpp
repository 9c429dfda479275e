#include "evmarker/tracking/look_schedule.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;
using namespace std::chrono_literals;

namespace {

const TrackerSettings<> settings{
    .detection_interval = 20ms, .search_interval = 4ms, .detection_latency = 3ms, .min_events_per_detection = 10};

void pass_events(LookSchedule& looks, int events) {
  for (int i = 0; i < events; ++i) looks.count_event();
}

}  // namespace

TEST_CASE("looks come at their interval, one at a time, and only after enough events") {
  LookSchedule looks(settings);
  CHECK(!looks.due(0, true));
  pass_events(looks, 9);
  CHECK(!looks.due(0, true));
  pass_events(looks, 1);
  CHECK(looks.due(0, true));
  CHECK(!looks.answer_awaited());
  looks.begin(0);
  CHECK(looks.answer_awaited());
  CHECK(!looks.answer_due(2999));
  CHECK(looks.answer_due(3000));
  pass_events(looks, 100);
  CHECK(!looks.due(100000, true));  // the answer is awaited
  looks.end();
  CHECK(!looks.answer_due(3000));
  CHECK(!looks.due(3999, true));
  CHECK(looks.due(4000, true));
  CHECK(!looks.due(19999, false));
  CHECK(looks.due(20000, false));
}

TEST_CASE("where one marker was found, others are looked for as often for a while") {
  LookSchedule looks(settings);
  pass_events(looks, 10);
  looks.begin(50000);
  looks.end();
  pass_events(looks, 10);
  CHECK(!looks.due(54000, false));
  looks.note_found(50000);
  CHECK(looks.due(54000, false));
  looks.begin(149000);
  looks.end();
  pass_events(looks, 10);
  CHECK(!looks.due(153000, false));
  CHECK(looks.due(169000, false));
}

TEST_CASE("a step back in time does not stop the looks") {
  LookSchedule looks(settings);
  pass_events(looks, 10);
  looks.begin(std::numeric_limits<Timestamp>::max());
  looks.end();
  pass_events(looks, 10);
  CHECK(looks.due(5, false));
  CHECK(looks.due(std::numeric_limits<Timestamp>::min(), false));
}
