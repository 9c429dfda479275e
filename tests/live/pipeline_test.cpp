#include "evmarker/live/pipeline.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <forward_list>
#include <functional>
#include <iterator>
#include <mutex>
#include <random>
#include <ranges>
#include <span>
#include <stdexcept>
#include <thread>
#include <vector>

#include "evmarker/tracking/tracker.hpp"
#include "live/test_support.hpp"
#include "simulated.hpp"

using namespace evmarker;
using namespace evmarker::live::test;
using simulated::TrueDetector;
using namespace std::chrono_literals;
using live::OverloadPolicy;

namespace {

/// In the pieces that a camera would deliver.
template <typename Pipeline>
void push(Pipeline& pipeline, const std::vector<Event>& events, std::size_t piece = 500) {
  for (std::size_t i = 0; i < events.size(); i += piece)
    pipeline.push(events.data() + i, events.data() + std::min(i + piece, events.size()));
}

double elapsed_ms(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - since).count();
}

const Settings kLikeTracker{.overload = OverloadPolicy::block, .queue_events = 1024, .wait_for_detector = true};

}  // namespace

TEST_CASE("the pipeline gives the tracker's poses, bit for bit, whatever the detector's latency and the pieces") {
  for (const auto latency : {0us, 7000us})
    for (const std::size_t piece : {1u, 77u, 5000u}) {
      CAPTURE(latency.count());
      CAPTURE(piece);
      Settings settings = kLikeTracker;
      settings.tracker.detection_latency = latency;
      Tracker tracker(simulated::camera, TrueDetector{motion()}, settings.tracker);
      std::vector<PoseEstimate> expected, poses;
      for (const Event& event : events())
        for (const PoseEstimate& pose : tracker.push(event)) expected.push_back(pose);
      REQUIRE(expected.size() > 500);

      live::Pipeline pipeline(
          simulated::camera, TrueDetector{motion()}, [&](const PoseEstimate& pose) { poses.push_back(pose); },
          settings);
      push(pipeline, events(), piece);
      pipeline.flush();
      const live::Status status = pipeline.status();
      const Timestamp soon = events().back().t + 5000;
      const auto ticks = pipeline.poses_at(soon);
      pipeline.stop();

      REQUIRE(poses.size() == expected.size());
      for (std::size_t i = 0; i < poses.size(); ++i) {
        REQUIRE(poses[i].t == expected[i].t);
        REQUIRE(poses[i].T_camera_marker.matrix() == expected[i].T_camera_marker.matrix());
        REQUIRE(poses[i].covariance == expected[i].covariance);
      }
      CHECK(status.running);
      CHECK(status.events == events().size());
      CHECK(status.filtered == tracker.statistics().filtered);
      CHECK(status.filtered > 0);
      CHECK(status.off_sensor == 3);
      CHECK(status.dropped == 0);
      CHECK(status.queue_depth == 0);
      CHECK(status.backlog_us == 0);
      CHECK(status.replayed == tracker.statistics().replayed);
      CHECK(status.detections == tracker.statistics().detections);
      CHECK(status.poses == poses.size());
      CHECK(status.push_to_pose.count == poses.size());
      CHECK(status.push_to_pose.p50_us <= status.push_to_pose.p99_us);
      CHECK(status.push_to_pose.p99_us <= status.push_to_pose.max_us);
      CHECK(status.detection.count + 1 >= status.detections);  // the last detection may not be due yet
      check_sum(status);
      REQUIRE(status.markers.size() == 1);
      CHECK(status.markers[0].id == 0);
      CHECK(status.markers[0].updated_t == poses.back().quality.updated_t);

      REQUIRE(ticks.size() == 1);
      const PoseEstimate predicted = tracker.markers().front().pose_at(soon);
      CHECK(ticks[0].t == soon);
      CHECK(ticks[0].T_camera_marker.matrix() == predicted.T_camera_marker.matrix());
      CHECK(ticks[0].covariance == predicted.covariance);
      CHECK(ticks[0].quality.updated_t == predicted.quality.updated_t);
    }
}

TEST_CASE("the pipeline takes single events, and any range of any type of event") {
  const auto poses_of = [](const auto& push_all) {
    std::vector<PoseEstimate> poses;
    live::Pipeline pipeline(
        simulated::camera, TrueDetector{motion()}, [&](const PoseEstimate& pose) { poses.push_back(pose); },
        kLikeTracker);
    push_all(pipeline);
    pipeline.flush();
    CHECK(pipeline.status().events == events().size());
    check_sum(pipeline.status());
    pipeline.stop();
    push_all(pipeline);  // while it is stopped, everything is dropped
    CHECK(pipeline.status().events - events().size() == pipeline.status().dropped);
    return poses;
  };
  struct Foreign {
    long long t;
    int x, y;
    bool p;
  };
  const auto foreign = [](const Event& event) { return Foreign{event.t, event.x, event.y, event.p > 0}; };
  const std::forward_list<Event> list(events().begin(), events().end());
  std::forward_list<Foreign> foreign_list;  // no view: Clang 14 does not accept those of GCC's library
  std::ranges::transform(events(), std::front_inserter(foreign_list), foreign);
  foreign_list.reverse();

  const auto expected = poses_of([](auto& pipeline) { push(pipeline, events()); });
  REQUIRE(expected.size() > 500);
  const auto check = [&](const std::vector<PoseEstimate>& poses) {
    REQUIRE(poses.size() == expected.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      REQUIRE(poses[i].t == expected[i].t);
      REQUIRE(poses[i].T_camera_marker.matrix() == expected[i].T_camera_marker.matrix());
    }
  };
  check(poses_of([](auto& pipeline) {
    for (const Event& event : events()) pipeline.push(event);
  }));
  check(poses_of([&](auto& pipeline) {
    for (const Event& event : events()) pipeline.push(foreign(event));
  }));
  check(poses_of([&](auto& pipeline) { pipeline.push(list); }));
  check(poses_of([&](auto& pipeline) { pipeline.push(foreign_list); }));
}

TEST_CASE("without events, poses are extrapolated: later ones are less certain, and age") {
  live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, kLikeTracker);
  CHECK(pipeline.poses_at(0).empty());
  push(pipeline, events());
  pipeline.flush();
  const Timestamp end = events().back().t;
  double last_variance = 0;
  Timestamp last_age = -1;
  for (const Timestamp ahead : {0, 2000, 10000, 30000}) {
    CAPTURE(ahead);
    const auto poses = pipeline.poses_at(end + ahead);
    REQUIRE(poses.size() == 1);
    const auto& P = poses[0].covariance;
    REQUIRE(P);
    CHECK(P->topLeftCorner<3, 3>().trace() > last_variance);
    last_variance = P->topLeftCorner<3, 3>().trace();
    CHECK(poses[0].t - poses[0].quality.updated_t > last_age);
    last_age = poses[0].t - poses[0].quality.updated_t;
    const double off_m =
        (poses[0].T_camera_marker.translation() - motion()(static_cast<double>(end + ahead) * 1e-6).translation())
            .norm();
    CHECK(off_m < 0.01);
  }
  CHECK(pipeline.poses_at(0).front().t > 0);  // not backwards
}

TEST_CASE("detection takes its time on its own thread, and no event is lost in it") {
  std::atomic<int> frames = 0;
  live::Pipeline pipeline(simulated::camera,
                          TrueDetector{motion(),
                                       [&] {
                                         ++frames;
                                         std::this_thread::sleep_for(3ms);
                                       }},
                          kNoPoses, {.overload = OverloadPolicy::block});
  push(pipeline, events(), 200);
  pipeline.flush();
  // The detection of the marker may have ended after the last event: more events, until it is confirmed.
  for (int i = 0; i < 200 && pipeline.status().poses == 0; ++i) {
    push(pipeline, events(), 200);
    pipeline.flush();
  }
  const live::Status status = pipeline.status();
  CHECK(frames > 0);
  CHECK(status.replayed > 0);
  CHECK(status.poses > 0);
  CHECK(status.dropped == 0);
  CHECK(status.detection.p50_us > 2900);
  CHECK(status.events == status.processed + status.filtered + status.off_sensor + status.hot);
}

TEST_CASE("overload: each policy does what it says, drops are counted to the event, poses resume") {
  const auto all = simulated::near_events(motion(), 0.6, 71);
  const auto between = [&](Timestamp from, Timestamp to) {
    std::vector<Event> part;
    std::ranges::copy_if(all, std::back_inserter(part), [&](const Event& e) { return e.t >= from && e.t < to; });
    return part;
  };
  for (const auto policy : {OverloadPolicy::block, OverloadPolicy::drop_oldest, OverloadPolicy::thin}) {
    CAPTURE(static_cast<int>(policy));
    std::atomic<bool> slow = false;
    std::atomic<int> slow_poses = 0, late_poses = 0;
    live::Pipeline pipeline(simulated::camera, TrueDetector{motion()},
                            [&](const PoseEstimate& pose) {
                              late_poses += pose.t > 500000 && pose.quality.state == TrackingState::tracking;
                              if (!slow) return;
                              ++slow_poses;
                              std::this_thread::sleep_for(1ms);
                            },
                            {.overload = policy, .queue_events = 4096});
    const auto detecting = [&] {
      const live::Status status = pipeline.status();
      return status.detection.count < status.detections;
    };
    const auto push_calmly = [&](const std::vector<Event>& events) {
      for (std::size_t i = 0; i < events.size(); i += 500) {
        pipeline.push(events.data() + i, events.data() + std::min(i + 500, events.size()));
        pipeline.flush();
        while (detecting()) std::this_thread::sleep_for(100us);  // however long that takes on a busy machine
      }
    };
    push_calmly(between(0, 150000));
    const live::Status calm = pipeline.status();
    REQUIRE(calm.poses > 100);
    REQUIRE(calm.dropped == 0);

    slow = true;
    std::uint64_t most_waiting = 0;
    const auto burst = between(150000, 200000);
    REQUIRE(burst.size() > 10000);
    for (std::size_t i = 0; i < burst.size(); i += 300) {
      pipeline.push(burst.data() + i, burst.data() + std::min(i + 300, burst.size()));
      const live::Status status = pipeline.status();
      check_sum(status);
      CHECK(status.backlog_us >= 0);
      most_waiting = std::max(most_waiting, status.queue_depth);
    }
    while (slow_poses == 0 && pipeline.status().queue_depth > 0) std::this_thread::sleep_for(1ms);
    slow = false;
    pipeline.flush();
    const live::Status after = pipeline.status();
    REQUIRE(slow_poses > 0);
    CHECK(most_waiting > 1000);
    CHECK(most_waiting <= 4096 + 2 * 300);  // the queue, the rest of a push, and the one that tracking has in hand
    CHECK(after.events == calm.events + burst.size());
    CHECK(after.queue_depth == 0);
    check_sum(after);
    if (policy == OverloadPolicy::block)
      CHECK(after.dropped == 0);
    else
      CHECK(after.dropped > 1000);

    push_calmly(between(200000, 600000));
    const live::Status end = pipeline.status();
    CHECK(end.events == all.size());
    CHECK(end.dropped == after.dropped);
    check_sum(end);
    CHECK(late_poses > 100);
    pipeline.stop();
  }
}

TEST_CASE("poses at a fixed rate are the tracker's, moved on to each tick from the events before it") {
  std::vector<std::vector<PoseEstimate>> ticks, expected;
  std::vector<Timestamp> times;
  Settings settings = kLikeTracker;
  settings.on_tick = [&](Timestamp t, std::span<const PoseEstimate> poses) {
    times.push_back(t);
    ticks.emplace_back(poses.begin(), poses.end());
  };
  live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, settings);
  push(pipeline, events());
  pipeline.flush();
  CHECK(pipeline.status().ticks == ticks.size());
  pipeline.stop();

  REQUIRE(times.size() > 290);  // 0.3 s, from the first event to the last
  CHECK(times.front() < 1000 + events().front().t);
  for (std::size_t i = 0; i < times.size(); ++i) CHECK(times[i] == times.front() + static_cast<Timestamp>(1000 * i));

  Tracker tracker(simulated::camera, TrueDetector{motion()}, settings.tracker);
  for (const Event& event : events()) {
    for (; expected.size() < times.size() && event.t >= times[expected.size()];) {
      const Timestamp t = times[expected.size()];
      expected.emplace_back();
      for (const auto& marker : tracker.markers()) expected.back().push_back(marker.pose_at(t, t));
    }
    tracker.push(event);
  }
  REQUIRE(expected.size() == ticks.size());
  CHECK(ticks.front().empty());  // there is a call where no marker is known, too
  int tracking = 0;
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    REQUIRE(ticks[i].size() == expected[i].size());
    if (ticks[i].empty()) continue;
    const PoseEstimate& pose = ticks[i][0];
    CHECK(pose.t == times[i]);
    CHECK(pose.T_camera_marker.matrix() == expected[i][0].T_camera_marker.matrix());
    CHECK(pose.covariance == expected[i][0].covariance);
    CHECK(pose.quality.updated_t <= pose.t);
    if (pose.quality.state != TrackingState::tracking) continue;
    ++tracking;
    const auto truth = motion()(static_cast<double>(times[i]) * 1e-6);
    CHECK((pose.T_camera_marker.translation() - truth.translation()).norm() < 0.005);
  }
  CHECK(tracking > 200);
}

TEST_CASE("without events, poses go on at the fixed rate by the wall clock, ever less certain") {
  std::mutex mutex;
  std::vector<PoseEstimate> ticks;
  Settings settings{.overload = OverloadPolicy::block};
  settings.tick_interval = 2ms;
  settings.on_tick = [&](Timestamp, std::span<const PoseEstimate> poses) {
    const std::lock_guard lock(mutex);
    ticks.insert(ticks.end(), poses.begin(), poses.end());
  };
  live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, settings);
  for (std::size_t i = 0; i < events().size(); i += 500) {  // in step, so that the marker is found early
    pipeline.push(events().data() + i, events().data() + std::min(i + 500, events().size()));
    pipeline.flush();
  }
  REQUIRE(pipeline.status().markers.size() == 1);
  const auto since_then = [&] {
    const std::lock_guard lock(mutex);
    return ticks;
  };
  {
    const std::lock_guard lock(mutex);
    ticks.clear();
  }
  while (since_then().size() < 20) std::this_thread::sleep_for(2ms);
  pipeline.stop();
  const auto silent = since_then();
  CHECK(silent.back().t > events().back().t + 20000);
  for (std::size_t i = 1; i < silent.size(); ++i) {
    CHECK(silent[i].t == silent[i - 1].t + 2000);
    CHECK(silent[i].quality.updated_t == silent[0].quality.updated_t);
    const auto &before = silent[i - 1].covariance, &after = silent[i].covariance;
    REQUIRE(before);
    REQUIRE(after);
    CHECK(after->topLeftCorner<3, 3>().trace() > before->topLeftCorner<3, 3>().trace());
  }
}

TEST_CASE("trigger events come out as they went in, in their place among the poses") {
  const std::vector<TriggerEvent> triggers = [] {
    std::vector<TriggerEvent> made{{7, true, events().front().t - 5}};
    for (Timestamp t = 1000; t < 300000; t += 777) made.push_back({3, made.size() % 2 == 0, t});
    made.push_back({3, true, events().back().t + 5});
    return made;
  }();
  for (const bool wait : {true, false}) {
    CAPTURE(wait);
    std::vector<TriggerEvent> seen;
    int poses = 0, early = 0, late = 0;
    Settings settings = kLikeTracker;
    settings.wait_for_detector = wait;
    settings.on_trigger = [&](const TriggerEvent& trigger) {
      seen.push_back(trigger);
      if (seen.size() == 3) throw std::runtime_error("no third trigger");
    };
    live::Pipeline pipeline(
        simulated::camera, TrueDetector{motion()},
        [&](const PoseEstimate& pose) {
          ++poses;
          early += !seen.empty() && pose.t < seen.back().t;
          late += seen.size() < triggers.size() && pose.t > triggers[seen.size()].t;
        },
        settings);
    auto next = triggers.begin();
    for (std::size_t i = 0; i < events().size();) {
      for (; next != triggers.end() && next->t < events()[i].t; ++next) pipeline.push(*next);
      const std::size_t begin = i;
      while (i < events().size() && i < begin + 500 && (next == triggers.end() || events()[i].t <= next->t)) ++i;
      pipeline.push(events().data() + begin, events().data() + i);
      if (!wait) pipeline.flush();
    }
    for (; next != triggers.end(); ++next) pipeline.push(*next);
    pipeline.flush();
    const live::Status status = pipeline.status();
    CHECK(seen == triggers);
    CHECK(status.triggers == triggers.size());
    CHECK(status.triggers_dropped == 0);
    CHECK(status.callback_errors == 1);
    CHECK(poses > 200);
    CHECK(early == 0);
    CHECK(late == 0);
    CHECK_THROWS_WITH(pipeline.stop(), "no third trigger");
    pipeline.push(triggers[0]);  // to nobody
    CHECK(pipeline.status().triggers_dropped == 1);
  }
}

TEST_CASE("trigger events survive events that are dropped, and too many are dropped and counted") {
  live::EventIntake intake(1024, OverloadPolicy::drop_oldest, 1s);
  intake.open();
  const std::vector<Event> piece(256);
  for (int i = 0; i < 5000; ++i) {
    if (i < 100) intake.push(std::span<const Event>(piece));
    intake.push(TriggerEvent{i % 16, true, i});
  }
  CHECK(intake.dropped() == 96 * 256);
  CHECK(intake.triggers_pushed() == 5000);
  CHECK(intake.triggers_dropped() == 5000 - 4096);
  int taken = 0;
  while (auto* block = intake.pop(0us)) {
    const int place = static_cast<int>(block->number());  // as many triggers are before the block
    for (; const auto trigger = intake.pop_trigger(block->number()); ++taken) CHECK(trigger->t == taken);
    CHECK(taken == place - 1);
    intake.release(block);
  }
  CHECK(taken == 99);
  while (const auto trigger = intake.pop_trigger(101)) CHECK(trigger->t == taken++);
  CHECK(taken == 4096);
}

TEST_CASE("every event during a detection is replayed, and a replay that lacks some is counted") {
  // Every event at a time of its own, so that the frame's time tells which are in it.
  static const std::vector<Event> timed = [] {
    std::vector<Event> made = events();
    std::erase_if(made, [](const Event& event) { return event.x > 639; });
    for (std::size_t i = 1; i < made.size(); ++i) made[i].t = std::max(made[i].t, made[i - 1].t + 1);
    return made;
  }();
  struct PatientDetector {
    TrueDetector knowing{motion()};
    std::atomic<Timestamp>* first_frame;
    std::atomic<bool>* released;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) const {
      if (*first_frame == 0) *first_frame = frame.t();
      while (!*released) std::this_thread::sleep_for(1ms);
      return knowing.detect(frame);
    }
    MarkerModel model(MarkerId id) const { return knowing.model(id); }
  };
  const std::size_t pushed = 6000;
  for (const std::size_t history : {1u << 18, 4096u}) {
    CAPTURE(history);
    std::atomic<Timestamp> first_frame = 0;
    std::atomic<bool> released = false;
    Settings settings{.overload = OverloadPolicy::block};
    settings.tracker.history_events = history;
    live::Pipeline pipeline(simulated::camera, PatientDetector{.first_frame = &first_frame, .released = &released},
                            kNoPoses, settings, AcceptAll{});
    pipeline.push(timed.data(), timed.data() + pushed);
    pipeline.flush();
    CHECK(pipeline.status().replayed == 0);
    for (int i = 0; i < 30000 && first_frame == 0; ++i) std::this_thread::sleep_for(1ms);  // the detector has it
    REQUIRE(first_frame != 0);
    released = true;
    const auto since = static_cast<std::uint64_t>(std::ranges::count_if(
        timed.begin(), timed.begin() + pushed, [&](const Event& event) { return event.t > first_frame; }));
    REQUIRE(since > 5000);
    const std::uint64_t expected = std::min<std::uint64_t>(since, history);  // some at a time, while no events come
    for (int i = 0; i < 30000 && pipeline.status().replayed < expected; ++i) std::this_thread::sleep_for(1ms);
    CHECK(pipeline.status().replayed == expected);
    CHECK(pipeline.status().replays_cut == (since > history ? 1 : 0));
    for (std::size_t i = pushed; i < timed.size(); i += 200) {
      pipeline.push(timed.data() + i, timed.data() + std::min(i + 200, timed.size()));
      pipeline.flush();
    }
    CHECK(pipeline.status().poses > 100);
    CHECK(pipeline.status().dropped == 0);
    pipeline.stop();
  }
}

TEST_CASE("detections end while nothing is pushed, too") {
  live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, {.overload = OverloadPolicy::block});
  for (std::size_t i = 0; i < events().size(); i += 500) {
    pipeline.push(events().data() + i, events().data() + std::min(i + 500, events().size()));
    pipeline.flush();
    while (pipeline.status().detection.count < pipeline.status().detections) std::this_thread::sleep_for(1ms);
  }
  const live::Status status = pipeline.status();
  CHECK(status.detections >= 10);
  CHECK(status.poses > 500);
  CHECK(status.detector_errors == 0);
}

TEST_CASE("20 Mev/s around a tracked marker: each policy does what it says, to the event, and poses resume") {
  // The marker's own 2 Mev/s, and in a tenth of a second noise at the border with each of its events.
  constexpr Timestamp kFlood = 100000, kCalm = 200000;
  std::vector<Event> stream;
  std::mt19937 random(3);
  for (const Event& event : events()) {
    stream.push_back(event);
    for (int i = 0; i < 8 && event.t >= kFlood && event.t < kCalm; ++i)
      stream.push_back({static_cast<std::uint16_t>(random() % 60), static_cast<std::uint16_t>(random() % 480),
                        static_cast<std::int16_t>(random() % 2), event.t});
  }
  const auto part = [&](Timestamp from, Timestamp to) {
    const auto begin = std::ranges::lower_bound(stream, from, {}, &Event::t);
    return std::span<const Event>(begin, std::ranges::lower_bound(stream, to, {}, &Event::t));
  };
  REQUIRE(part(kFlood, kCalm).size() > 1000000);
  for (const auto policy : {OverloadPolicy::block, OverloadPolicy::drop_oldest, OverloadPolicy::thin}) {
    CAPTURE(static_cast<int>(policy));
    constexpr std::size_t kQueue = 1 << 14;
    std::atomic<int> in_flood = 0, near = 0, off = 0;
    std::atomic<bool> held_up = false;  // the tracking, so that it is too slow on any machine
    live::Pipeline pipeline(simulated::camera, TrueDetector{motion()},
                            [&](const PoseEstimate& pose) {
                              held_up.wait(true);
                              if (pose.quality.state != TrackingState::tracking) return;
                              in_flood += pose.t >= kFlood && pose.t < kCalm;
                              if (pose.t < kCalm + 50000) return;
                              const auto truth = motion()(static_cast<double>(pose.t) * 1e-6);
                              const double off_m = (pose.T_camera_marker.translation() - truth.translation()).norm();
                              ++(off_m < 0.005 ? near : off);
                            },
                            {.overload = policy, .queue_events = kQueue});
    std::uint64_t most_waiting = 0;
    const auto push_part = [&](std::span<const Event> some, std::size_t piece, bool in_step) {
      for (; !some.empty(); some = some.subspan(std::min(piece, some.size()))) {
        pipeline.push(some.first(std::min(piece, some.size())));
        if (in_step) {
          pipeline.flush();
          while (pipeline.status().detection.count < pipeline.status().detections) std::this_thread::sleep_for(1ms);
        }
        const live::Status status = pipeline.status();
        check_sum(status);
        most_waiting = std::max(most_waiting, status.queue_depth);
      }
      held_up = false;
      held_up.notify_all();
      pipeline.flush();
    };
    push_part(part(0, kFlood), 500, true);
    const live::Status before = pipeline.status();
    REQUIRE(before.markers.size() == 1);
    REQUIRE(before.markers[0].state == TrackingState::tracking);
    REQUIRE(before.dropped == 0);

    held_up = policy != OverloadPolicy::block;
    push_part(part(kFlood, kCalm), 5000, false);  // as fast as they can be pushed
    const live::Status after = pipeline.status();
    MESSAGE("dropped " << after.dropped << " of " << part(kFlood, kCalm).size() << ", poses " << in_flood.load());
    CHECK(after.events == part(0, kCalm).size());
    CHECK(after.events == after.processed + after.filtered + after.off_sensor + after.hot + after.dropped);
    CHECK(most_waiting <= kQueue + 5000);
    if (policy == OverloadPolicy::block) CHECK(in_flood > 500);
    CHECK((after.dropped > 0) == (policy != OverloadPolicy::block));

    push_part(part(kCalm, 300000), 500, true);
    CHECK(pipeline.status().dropped == after.dropped);
    CHECK(near > 100);
    CHECK(off == 0);
  }
}

TEST_CASE("thinning out is even: the burst loses some everywhere, not all somewhere") {
  // Nobody takes: what the intake keeps is exactly what the policy says.
  live::EventIntake intake(64 * 256, OverloadPolicy::thin, 1s);
  intake.open();
  std::vector<Event> burst(200000);
  for (std::size_t i = 0; i < burst.size(); ++i) burst[i].t = static_cast<Timestamp>(i);
  intake.push(std::span<const Event>(burst));
  std::vector<Timestamp> kept;
  while (auto* block = intake.pop(0us)) {
    for (const Event& event : block->span()) kept.push_back(event.t);
    intake.release(block);
  }
  CHECK(kept.size() + intake.dropped() == burst.size());
  CHECK(kept.size() > 60 * 256);
  CHECK(std::ranges::is_sorted(kept));
  // All at first; then gaps that grow with the queue, each a step at most wider than the one before.
  CHECK(kept[16 * 256 - 1] == 16 * 256 - 1);
  Timestamp last_gap = 1;
  for (std::size_t i = 16 * 256; i + 256 < kept.size(); ++i) {
    const Timestamp gap = kept[i] - kept[i - 1];
    CHECK(gap <= 2 * last_gap + 1);
    last_gap = std::max(last_gap, gap);
  }
  CHECK(last_gap > 10);
}

TEST_CASE("dropping the oldest keeps the newest, in order") {
  live::EventIntake intake(16 * 256, OverloadPolicy::drop_oldest, 1s);
  intake.open();
  std::vector<Event> burst(100000);
  for (std::size_t i = 0; i < burst.size(); ++i) burst[i].t = static_cast<Timestamp>(i);
  for (std::size_t i = 0; i < burst.size(); i += 1000) intake.push(std::span<const Event>(burst).subspan(i, 1000));
  std::vector<Timestamp> kept;
  while (auto* block = intake.pop(0us)) {
    for (const Event& event : block->span()) kept.push_back(event.t);
    intake.release(block);
  }
  CHECK(kept.size() + intake.dropped() == burst.size());
  REQUIRE(kept.size() > 14 * 232);
  for (std::size_t i = 0; i < kept.size(); ++i)
    REQUIRE(kept[i] == static_cast<Timestamp>(burst.size() - kept.size() + i));
}

TEST_CASE("what the callback and the detector throw is counted, told and thrown by stop, and tracking goes on") {
  int poses = 0;
  {
    live::Pipeline pipeline(
        simulated::camera, TrueDetector{motion()},
        [&](const PoseEstimate&) {
          if (++poses % 2 == 0) throw std::runtime_error("no even poses");
        },
        kLikeTracker);
    push(pipeline, events());
    pipeline.flush();
    const live::Status status = pipeline.status();
    REQUIRE(poses > 500);
    CHECK(status.callback_errors == static_cast<std::uint64_t>(poses / 2));
    CHECK(status.error == "no even poses");
    CHECK_THROWS_WITH(pipeline.stop(), "no even poses");
    CHECK_NOTHROW(pipeline.stop());
  }
  std::atomic<int> frames = 0;
  live::Pipeline pipeline(simulated::camera,
                          TrueDetector{motion(),
                                       [&] {
                                         if (++frames <= 3) throw 42;
                                       }},
                          kNoPoses, kLikeTracker);
  push(pipeline, events());
  pipeline.flush();
  const live::Status status = pipeline.status();
  CHECK(status.detector_errors == 3);
  CHECK(status.error == "unknown exception");
  CHECK(status.poses > 300);
  CHECK_THROWS_AS(pipeline.stop(), int);
}

TEST_CASE("stop drops what is left and counts it, start begins anew") {
  std::vector<std::size_t> poses;
  live::Pipeline pipeline(
      simulated::camera, TrueDetector{motion()}, [&](const PoseEstimate&) { ++poses.back(); }, kLikeTracker);
  for (int round = 0; round < 3; ++round) {
    poses.push_back(0);
    pipeline.start();  // the first time it runs already
    push(pipeline, events());
    pipeline.flush();
    CHECK(pipeline.status().events == events().size());
    pipeline.stop();
    CHECK_FALSE(pipeline.status().running);
    CHECK(pipeline.status().markers.empty());
    CHECK(pipeline.poses_at(0).empty());
    push(pipeline, events());  // to nobody
    CHECK(pipeline.status().dropped == events().size());
    check_sum(pipeline.status());
  }
  CHECK(poses[0] > 500);
  CHECK(poses[1] == poses[0]);
  CHECK(poses[2] == poses[0]);
}

TEST_CASE("stop returns while a camera pushes, however full the queue and however slow the callback") {
  for (const auto policy : {OverloadPolicy::block, OverloadPolicy::drop_oldest, OverloadPolicy::thin}) {
    CAPTURE(static_cast<int>(policy));
    // The camera goes on only when its last events have been tracked, until they lead to a pose: what is left of events
    // that come a thousand times too fast, as on a slow machine, may lead to none. From then on it does not wait.
    std::atomic<bool> tracked = false, full = false, ended = false;
    const auto wait_for = [](const std::atomic<bool>& flag) {
      while (!flag) std::this_thread::sleep_for(1ms);
    };
    live::Pipeline<TrueDetector>* self = nullptr;
    const auto slow_callback = [&](const PoseEstimate&) {
      tracked = true;
      while (!full) {
        if (self->status().queue_depth > 3000) full = true;
        std::this_thread::sleep_for(1ms);
      }
      std::this_thread::sleep_for(5ms);
    };
    live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, slow_callback,
                            {.overload = policy, .queue_events = 4096, .wait_for_detector = true});
    self = &pipeline;
    std::thread camera([&] {
      while (!ended)
        for (std::span<const Event> left = events(); !left.empty();) {
          const auto piece = left.first(std::min<std::size_t>(left.size(), 500));
          pipeline.push(piece);
          left = left.subspan(piece.size());
          while (!tracked && !ended && pipeline.status().queue_depth > 0) std::this_thread::sleep_for(1ms);
        }
    });
    std::thread reader([&] {
      while (!ended) {
        check_sum(pipeline.status());
        pipeline.poses_at(100000);
      }
    });
    wait_for(full);
    const auto start = std::chrono::steady_clock::now();
    pipeline.stop();
    MESSAGE("stopped in " << elapsed_ms(start) << " ms");
    tracked = full = false;
    pipeline.start();
    wait_for(full);
    pipeline.stop();
    ended = true;
    camera.join();
    reader.join();
    check_sum(pipeline.status());
    CHECK(pipeline.status().queue_depth == 0);
  }
}

TEST_CASE("a camera that is restarted, and one that pauses, are noticed and survived") {
  live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, kLikeTracker);
  push(pipeline, events());
  pipeline.flush();
  const auto first = pipeline.status();
  CHECK(first.time_steps_back == 0);
  CHECK(first.time_gaps == 0);
  push(pipeline, events());  // its clock begins again
  pipeline.flush();
  const auto second = pipeline.status();
  CHECK(second.time_steps_back == 1);
  CHECK(second.time_gaps == 0);
  CHECK(second.poses > first.poses + 300);
  std::vector<Event> later = events();
  for (Event& event : later) event.t += std::int64_t{1} << 33;
  push(pipeline, later);
  pipeline.flush();
  CHECK(pipeline.status().time_steps_back == 1);
  CHECK(pipeline.status().time_gaps == 1);
  check_sum(pipeline.status());
}

TEST_CASE("single events with wrong times change neither poses nor ticks") {
  const auto run = [](const std::vector<Event>& events, std::size_t piece) {
    struct {
      std::vector<PoseEstimate> poses, ticks;
      live::Status status;
    } result;
    Settings settings = kLikeTracker;
    settings.on_tick = [&](Timestamp t, std::span<const PoseEstimate> poses) {
      result.ticks.insert(result.ticks.end(), poses.begin(), poses.end());
      CHECK(t <= events.back().t);
    };
    live::Pipeline pipeline(
        simulated::camera, TrueDetector{motion()}, [&](const PoseEstimate& pose) { result.poses.push_back(pose); },
        settings);
    push(pipeline, events, piece);
    pipeline.flush();
    result.status = pipeline.status();
    return result;
  };
  const auto expected = run(events(), 500);
  REQUIRE(expected.poses.size() > 500);
  REQUIRE(expected.ticks.size() > 200);
  for (const Timestamp jump : {Timestamp{1000}, Timestamp{20000}, Timestamp{1} << 32, Timestamp{1} << 40}) {
    CAPTURE(jump);
    auto faulty = events();
    for (const std::size_t i : {faulty.size() / 2, faulty.size() / 3}) {
      Event wrong = faulty[i];
      wrong.t += i % 2 == 0 ? jump : -jump;
      faulty.insert(faulty.begin() + static_cast<std::ptrdiff_t>(i), wrong);
    }
    const auto found = run(faulty, 500);
    check_sum(found.status);
    CHECK(found.status.time_faults == 2);
    for (const auto& [a, b] : {std::pair(&found.poses, &expected.poses), std::pair(&found.ticks, &expected.ticks)}) {
      REQUIRE(a->size() == b->size());
      for (std::size_t i = 0; i < a->size(); ++i) {
        REQUIRE((*a)[i].t == (*b)[i].t);
        REQUIRE((*a)[i].T_camera_marker.matrix() == (*b)[i].T_camera_marker.matrix());
      }
    }
  }
}

TEST_CASE("without detection no marker is found, those that are tracked stay") {
  live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, kLikeTracker);
  pipeline.set_detection(false);
  push(pipeline, events());
  pipeline.flush();
  CHECK(pipeline.status().detections == 0);
  CHECK(pipeline.status().poses == 0);
  pipeline.set_detection(true);
  push(pipeline, events());
  pipeline.flush();
  CHECK(pipeline.status().poses > 300);
}

TEST_CASE("the detector gets the frame of all events before, however many there were since the last one") {
  // Event i at time i, so that the frame's time tells which events are in it.
  static const std::vector<Event> timed = [] {
    std::vector<Event> numbered = events();
    std::erase_if(numbered, [](const Event& event) { return event.x > 639; });
    for (std::size_t i = 0; i < numbered.size(); ++i) numbered[i].t = static_cast<Timestamp>(i);
    return numbered;
  }();
  struct ComparingDetector {
    std::atomic<int>* frames;
    std::atomic<int>* different;
    PolarityFrame expected{simulated::camera.sensor_size()};
    std::size_t next = 0;
    std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
      while (next <= static_cast<std::size_t>(frame.t())) expected.update(timed[next++]);
      ++*frames;
      *different += !std::ranges::equal(frame.pixels(), expected.pixels()) ||
                    !std::ranges::equal(frame.times(), expected.times());
      return {};
    }
    MarkerModel model(MarkerId) const { return make_square_marker(0.1); }
  };
  for (const bool wait : {true, false})
    for (const std::size_t kept : {64u, 1u << 18}) {
      CAPTURE(kept);
      std::atomic<int> frames = 0, different = 0;
      Settings settings = kLikeTracker;
      settings.wait_for_detector = wait;
      settings.tracker.history_events = kept;
      live::Pipeline pipeline(simulated::camera, ComparingDetector{.frames = &frames, .different = &different},
                              kNoPoses, settings, AcceptAll{});
      push(pipeline, timed, 100);
      pipeline.flush();
      pipeline.stop();
      CHECK(frames > (wait ? 10 : 1));
      CHECK(different == 0);
    }
}

TEST_CASE("latency percentiles agree with sorting") {
  live::LatencyHistogram histogram;
  CHECK(histogram.summary().p50_us == 0);
  std::mt19937 random(1);
  std::lognormal_distribution<double> distribution(3, 2);
  std::vector<double> us;
  for (int i = 0; i < 10000; ++i) {
    us.push_back(distribution(random));
    histogram.add(std::chrono::nanoseconds(static_cast<std::int64_t>(1000 * us.back())));
  }
  std::ranges::sort(us);
  const live::Latency latency = histogram.summary();
  CHECK(latency.count == 10000);
  CHECK(latency.p50_us == doctest::Approx(us[4999]).epsilon(0.04).scale(0));
  CHECK(latency.p90_us == doctest::Approx(us[8999]).epsilon(0.04).scale(0));
  CHECK(latency.p99_us == doctest::Approx(us[9899]).epsilon(0.04).scale(0));
  CHECK(latency.max_us == doctest::Approx(us.back()).epsilon(0.001).scale(0));
  CHECK(histogram.between_us(0, 1e12) == 10000);
  CHECK(histogram.between_us(0, 20) + histogram.between_us(20, 1e12) == 10000);
}

TEST_CASE("settings out of range are named") {
  const auto make = [](const Settings& settings) {
    live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, settings);
  };
  CHECK_THROWS_WITH(make({.queue_events = 100}), doctest::Contains("queue_events is 100"));
  CHECK_THROWS_WITH(make({.tick_interval = -5us}), doctest::Contains("tick_interval [us] is -5"));
  CHECK_THROWS_WITH(make({.gap = 0us}), doctest::Contains("gap"));
  CHECK_THROWS_WITH(make({.tracker = {.max_markers = 0}}), doctest::Contains("max_markers"));
}
