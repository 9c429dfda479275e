#include "evmarker/tracking/detection_schedule.hpp"

#include <doctest/doctest.h>

#include <limits>

using namespace evmarker;
using namespace std::chrono_literals;

namespace {

const TrackerSettings<> kSettings{.detection_interval = 20ms,
                                  .search_interval = 4ms,
                                  .check_interval = 90ms,
                                  .detection_latency = 3ms,
                                  .min_events_per_detection = 10};

void pass_events(DetectionSchedule& schedule, int events) {
  for (int i = 0; i < events; ++i) schedule.count_event();
}

}  // namespace

TEST_CASE("detections begin at their interval, one at a time, and only after enough events") {
  DetectionSchedule schedule(kSettings);
  CHECK(!schedule.due(0, true));
  pass_events(schedule, 9);
  CHECK(!schedule.due(0, true));
  pass_events(schedule, 1);
  CHECK(schedule.due(0, true));
  CHECK(!schedule.running());
  schedule.begin(0);
  CHECK(schedule.running());
  CHECK(!schedule.result_due(2999));
  CHECK(schedule.result_due(3000));
  pass_events(schedule, 100);
  CHECK(!schedule.due(100000, true));  // one is going on
  schedule.end();
  CHECK(!schedule.result_due(3000));
  CHECK(!schedule.due(3999, true));
  CHECK(schedule.due(4000, true));
  CHECK(!schedule.due(19999, false));
  CHECK(schedule.due(20000, false));
}

TEST_CASE("where one marker was found, others are searched as often for a while") {
  DetectionSchedule schedule(kSettings);
  pass_events(schedule, 10);
  schedule.begin(50000);
  schedule.end();
  pass_events(schedule, 10);
  CHECK(!schedule.due(54000, false));
  schedule.note_found(50000);
  CHECK(schedule.due(54000, false));
  schedule.begin(149000);
  schedule.end();
  pass_events(schedule, 10);
  CHECK(!schedule.due(153000, false));
  CHECK(schedule.due(169000, false));
}

TEST_CASE("while all that can be found is tracked, detections are rare, also where the last was found just now") {
  DetectionSchedule schedule(kSettings);
  pass_events(schedule, 10);
  schedule.begin(50000);
  schedule.end();
  pass_events(schedule, 10);
  schedule.note_found(50000);
  schedule.note_all_tracked(true);
  CHECK(!schedule.due(139999, false));
  CHECK(schedule.due(140000, false));
  CHECK(schedule.due(54000, true));  // one is missing
  schedule.note_all_tracked(false);
  CHECK(schedule.due(54000, false));
}

TEST_CASE("a step back in time does not stop the schedule") {
  DetectionSchedule schedule(kSettings);
  pass_events(schedule, 10);
  schedule.begin(std::numeric_limits<Timestamp>::max());
  schedule.end();
  pass_events(schedule, 10);
  CHECK(schedule.due(5, false));
  CHECK(schedule.due(std::numeric_limits<Timestamp>::min(), false));
}
