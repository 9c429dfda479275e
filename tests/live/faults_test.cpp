// What goes wrong around a pipeline: exceptions, threads that cannot be started, pushes that find no room.
#include <dlfcn.h>
#include <doctest/doctest.h>
#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <future>
#include <limits>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/live/pipeline.hpp"
#include "live/test_support.hpp"
#include "simulated.hpp"

using namespace evmarker;
using namespace evmarker::live::test;
using simulated::TrueDetector;
using namespace std::chrono_literals;
using live::EventIntake;
using live::OverloadPolicy;

namespace {

constexpr int kStart = 1 << 20;
std::atomic<int> threads_until_failure{kStart};

}  // namespace

// In place of the C library's function, which it calls: std::thread starts every thread by it.
extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                              void* argument) {
  static const auto original = reinterpret_cast<decltype(&pthread_create)>(dlsym(RTLD_NEXT, "pthread_create"));
  if (threads_until_failure.fetch_sub(1) <= 0) return EAGAIN;
  return original(thread, attributes, run, argument);
}

namespace {

/// As long as it exists, no thread can be started after the next `count` ones.
struct FewThreads {
  explicit FewThreads(int count) { threads_until_failure = count; }
  ~FewThreads() { threads_until_failure = kStart; }
};

/// Events without a marker, on one pixel after the other, a microsecond apart.
std::vector<Event> plain_events(std::size_t count, Timestamp from = 0) {
  std::vector<Event> events(count);
  for (std::size_t i = 0; i < count; ++i)
    events[i] = {static_cast<std::uint16_t>(i % 640), 0, 1, from + static_cast<Timestamp>(i)};
  return events;
}

/// A filter that is called with every event.
struct CallingFilter {
  std::function<void()> call;
  bool accept(const Event&) const {
    call();
    return true;
  }
};
static_assert(EventFilter<CallingFilter>);

/// A detector that finds nothing.
struct NoDetector {
  std::function<void()> before = [] {};
  std::vector<MarkerDetection> detect(const PolarityFrame&) const {
    before();
    return {};
  }
  MarkerModel model(MarkerId) const { return make_square_marker(0.1); }
};

/// Runs it on a thread of its own; false if it has not returned after a long time, which then ends the test program.
void require_returns(const std::function<void()>& function) {
  auto done = std::async(std::launch::async, function);
  if (done.wait_for(30s) == std::future_status::ready) return done.get();
  MESSAGE("it does not return");
  std::fflush(stdout);
  std::_Exit(1);
}

}  // namespace

TEST_CASE("flush returns once what was pushed before it is tracked, while another thread goes on pushing") {
  for (const auto policy : {OverloadPolicy::block, OverloadPolicy::drop_oldest, OverloadPolicy::thin}) {
    CAPTURE(static_cast<int>(policy));
    Settings settings{.overload = policy, .queue_events = 4096};
    std::atomic<int> triggers = 0;
    settings.on_trigger = [&](const TriggerEvent&) { ++triggers; };
    // A tracker that is slower than the camera: there is always something in the queue.
    live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses, settings,
                            CallingFilter{[] { std::this_thread::sleep_for(1us); }});
    std::atomic<bool> done = false;
    std::atomic<std::uint64_t> pushed = 0;
    std::thread camera([&] {
      for (Timestamp t = 0; !done; t += 100, pushed += 100) pipeline.push(plain_events(100, t));
    });
    while (pushed < 10000) std::this_thread::sleep_for(1ms);
    require_returns([&] {
      for (int i = 1; i <= 5; ++i) {
        pipeline.push(TriggerEvent{1, true, 0});
        const std::uint64_t before = pushed;
        pipeline.flush();
        const live::Status status = pipeline.status();
        CHECK(status.events - status.queue_depth >= before - 4096);
        CHECK(triggers >= i);
        check_sum(status);
      }
    });
    done = true;
    camera.join();
    pipeline.flush();
    CHECK(pipeline.status().queue_depth == 0);
    if (policy == OverloadPolicy::block) CHECK(pipeline.status().dropped == 0);
  }
}

TEST_CASE("flush waits for the events before it, not only for as many as it has seen") {
  // With `thin`, later events are dropped while earlier ones wait: a count of both would pass too early.
  std::atomic<bool> go_on = false;
  Timestamp last = -1;
  Settings settings{.overload = OverloadPolicy::thin, .queue_events = 1024};
  settings.on_trigger = [&](const TriggerEvent& trigger) {
    while (trigger.id == 0 && !go_on) std::this_thread::sleep_for(1ms);
    last = trigger.t;
  };
  live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses, settings);
  pipeline.push(TriggerEvent{0, true, 0});
  pipeline.push(plain_events(300));
  pipeline.push(TriggerEvent{1, true, 300});
  auto flushed = std::async(std::launch::async, [&] { pipeline.flush(); });
  pipeline.push(plain_events(100000, 300));
  CHECK(pipeline.status().dropped > 90000);
  CHECK(flushed.wait_for(50ms) == std::future_status::timeout);
  go_on = true;
  require_returns([&] { flushed.get(); });
  pipeline.flush();
  CHECK(last == 300);
}

TEST_CASE("a callback that pushes never waits: without room its events and triggers are dropped and counted") {
  for (const bool camera_waits : {false, true}) {
    CAPTURE(camera_waits);
    live::Pipeline<NoDetector>* running = nullptr;
    std::atomic<bool> ready = false, pushing = false;
    Settings settings{.overload = OverloadPolicy::block, .queue_events = 1024};
    settings.on_trigger = [&](const TriggerEvent& trigger) {
      if (trigger.id != 0) return;
      while (!ready) std::this_thread::sleep_for(1ms);
      if (camera_waits) {  // until the camera has filled the queue and waits
        while (running->status().events < 5000 || !pushing) std::this_thread::sleep_for(1ms);
        std::this_thread::sleep_for(10ms);
      }
      running->push(plain_events(10000));
      for (int i = 0; i < 5000; ++i) running->push(TriggerEvent{1, true, 0});
    };
    live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses, settings);
    running = &pipeline;
    ready = true;
    require_returns([&] {
      pipeline.push(TriggerEvent{0, true, 0});
      pushing = true;
      if (camera_waits) pipeline.push(plain_events(5000));
      pipeline.flush();
      pipeline.flush();  // for what the callback pushed, too
    });
    const live::Status status = pipeline.status();
    check_sum(status);
    CHECK(status.events == (camera_waits ? 15000u : 10000u));
    CHECK(status.dropped >= 10000 - 1024);
    CHECK(status.dropped <= 10000);
    CHECK(status.triggers == 5001);
    CHECK(status.triggers_dropped >= 5000 - 4096);
    pipeline.stop();
  }
}

TEST_CASE("start, stop and flush refuse to be called from a callback, also while another thread stops") {
  live::Pipeline<NoDetector>* running = nullptr;
  std::atomic<int> refused = 0;
  std::atomic<bool> stopping = false, called = false;
  Settings settings;
  settings.on_trigger = [&](const TriggerEvent&) {
    called = true;
    while (!stopping) std::this_thread::sleep_for(1ms);
    std::this_thread::sleep_for(10ms);
    for (const auto call : {&live::Pipeline<NoDetector>::start, &live::Pipeline<NoDetector>::stop}) try {
        (running->*call)();
      } catch (const std::logic_error&) {
        ++refused;
      }
    try {
      running->flush();
    } catch (const std::logic_error&) {
      ++refused;
    }
  };
  live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses, settings);
  running = &pipeline;
  pipeline.push(TriggerEvent{0, true, 0});
  while (!called) std::this_thread::sleep_for(1ms);
  require_returns([&] {
    stopping = true;
    pipeline.stop();
  });
  CHECK(refused == 3);
}

TEST_CASE("start, stop and flush refuse to be called from the detector") {
  struct Caller {
    std::function<void()>* call;  // once it is set
    std::atomic<bool>* ready;
    std::atomic<bool>* called;
    std::vector<MarkerDetection> detect(const PolarityFrame&) const {
      while (!*ready) std::this_thread::sleep_for(1ms);
      if (!called->exchange(true)) (*call)();
      return {};
    }
    MarkerModel model(MarkerId) const { return make_square_marker(0.1); }
  };
  std::function<void()> call;
  std::atomic<bool> ready = false, called = false;
  std::atomic<int> refused = 0;
  live::Pipeline pipeline(simulated::camera, Caller{&call, &ready, &called}, kNoPoses, Settings{});
  const auto refuses = [&](const auto& control) {
    try {
      control();
    } catch (const std::logic_error&) {
      ++refused;
    }
  };
  call = [&] {
    refuses([&] { pipeline.start(); });
    refuses([&] { pipeline.stop(); });
    refuses([&] { pipeline.flush(); });
  };
  ready = true;
  require_returns([&] {
    while (!called) {
      pipeline.push(plain_events(1000));
      std::this_thread::sleep_for(1ms);
    }
    pipeline.stop();
  });
  CHECK(refused == 3);
}

// By a clock that is set back, the consumer would wait for as long as it was set back.
TEST_CASE("a queue that is closed wakes its consumer at once") {
  live::EventIntake intake(1 << 12, live::OverloadPolicy::thin, 1000us);
  intake.open();
  std::atomic<bool> waits = false;
  std::thread consumer([&] {
    waits = true;
    intake.pop(std::chrono::hours(1));
  });
  while (!waits) std::this_thread::sleep_for(1ms);
  std::this_thread::sleep_for(20ms);
  require_returns([&] {
    intake.close();
    consumer.join();
  });
}

TEST_CASE("a thread that cannot be started is an error of the constructor or of start, and the others are joined") {
  const auto make = [] { return live::Pipeline(simulated::camera, NoDetector{}, kNoPoses, Settings{}); };
  for (int started = 0; started < 2; ++started) {
    CAPTURE(started);
    const FewThreads few(started);
    CHECK_THROWS_AS(make(), std::system_error);
  }
  live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses, Settings{});
  pipeline.stop();
  for (int started = 0; started < 2; ++started) {
    CAPTURE(started);
    {
      const FewThreads few(started);
      CHECK_THROWS_AS(pipeline.start(), std::system_error);
    }
    CHECK_FALSE(pipeline.status().running);
    pipeline.push(plain_events(1000));
    CHECK(pipeline.status().dropped >= 1000);
    CHECK(pipeline.status().queue_depth == 0);
    check_sum(pipeline.status());
    pipeline.flush();
    pipeline.stop();
  }
  pipeline.start();
  pipeline.push(plain_events(1000));
  pipeline.flush();
  const live::Status status = pipeline.status();
  CHECK(status.running);
  CHECK(status.events == 1000);
  CHECK(status.dropped == 0);
}

TEST_CASE("a filter that throws ends the tracking: the status, flush and stop say why, every event is counted") {
  for (const bool waiting : {false, true}) {
    CAPTURE(waiting);
    std::atomic<int> calls = 0;
    std::atomic<bool> faulty = true;
    live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses,
                            Settings{.overload = OverloadPolicy::block, .queue_events = 1024}, CallingFilter{[&] {
                              if (++calls == 1000 && faulty) throw std::runtime_error("no thousandth event");
                            }});
    require_returns([&] {
      // More than there is room for: the push waits when the tracking ends, and returns nevertheless.
      for (int i = 0; i < 40; ++i) pipeline.push(plain_events(waiting ? 5000 : 100, 5000 * i));
      CHECK_THROWS_WITH(pipeline.flush(), "no thousandth event");
    });
    const live::Status status = pipeline.status();
    CHECK_FALSE(status.running);
    CHECK(status.error == "no thousandth event");
    CHECK(status.events == (waiting ? 200000 : 4000));
    CHECK(status.processed == 1000);
    CHECK(status.dropped == status.events - 1000);
    CHECK(status.queue_depth == 0);
    CHECK(status.markers.empty());
    check_sum(status);
    CHECK_THROWS_WITH(pipeline.stop(), "no thousandth event");
    CHECK_NOTHROW(pipeline.stop());
    CHECK_NOTHROW(pipeline.flush());

    faulty = false;
    pipeline.start();
    pipeline.push(plain_events(2000));
    pipeline.flush();
    CHECK(pipeline.status().running);
    CHECK(pipeline.status().error.empty());
    CHECK(pipeline.status().processed == 2000);
    faulty = true;
    calls = 999;
    pipeline.push(plain_events(2000, 2000));
    CHECK_THROWS_AS(pipeline.flush(), std::runtime_error);
    pipeline.start();  // without a stop
    pipeline.push(plain_events(10));
    pipeline.flush();
    CHECK(pipeline.status().processed == 10);
  }  // and a pipeline that failed can be destroyed
}

TEST_CASE("single events that wait take room for themselves only, and stay in order among triggers") {
  EventIntake intake(1024, OverloadPolicy::drop_oldest, 1s);
  intake.open();
  const auto single = plain_events(1024);
  for (const Event& event : single) {
    intake.push(std::span(&event, 1));
    if (event.t == 500) intake.push(TriggerEvent{1, true, 500});
  }
  CHECK(intake.dropped() <= 256);  // the trigger ends a block
  EventIntake plain(1024, OverloadPolicy::drop_oldest, 1s);
  plain.open();
  for (const Event& event : single) plain.push(std::span(&event, 1));
  CHECK(plain.dropped() == 0);
  std::vector<Event> taken;
  while (auto* block = plain.pop(0us)) {
    taken.insert(taken.end(), block->span().begin(), block->span().end());
    plain.release(block);
  }
  CHECK(taken == single);

  Timestamp last = -1;
  int triggers = 0;
  while (auto* block = intake.pop(0us)) {
    while (const auto trigger = intake.pop_trigger(block->number())) {
      ++triggers;
      CHECK(trigger->t == last);
      CHECK(block->span().front().t == 501);
    }
    last = block->span().back().t;
    intake.release(block);
  }
  CHECK(triggers == 1);
  CHECK(last == 1023);
}

TEST_CASE("events pushed one by one come out once each, in order, while they are taken") {
  EventIntake intake(1024, OverloadPolicy::block, 1s);
  intake.open();
  const auto pushed = plain_events(200000);
  std::thread camera([&] {
    for (const Event& event : pushed) intake.push(std::span(&event, 1));
  });
  std::vector<Event> taken;
  while (taken.size() < pushed.size())
    if (auto* block = intake.pop(1000us)) {
      taken.insert(taken.end(), block->span().begin(), block->span().end());
      intake.release(block);
    }
  camera.join();
  CHECK(taken == pushed);
  CHECK(intake.dropped() == 0);
}

TEST_CASE("the backlog is never negative, however far apart the times are, nor is what waits, whoever pushes") {
  std::atomic<bool> held = false, go_on = false;
  Settings settings{.overload = OverloadPolicy::drop_oldest, .queue_events = 1024};
  settings.on_trigger = [&](const TriggerEvent&) {
    held = true;
    while (!go_on) std::this_thread::sleep_for(1ms);
  };
  live::Pipeline pipeline(simulated::camera, NoDetector{}, kNoPoses, settings);
  const auto all_at = [](Timestamp t) {
    std::vector<Event> events = plain_events(400);
    for (Event& event : events) event.t = t;
    return events;
  };
  const Timestamp first = std::numeric_limits<Timestamp>::min(), last = std::numeric_limits<Timestamp>::max();
  pipeline.push(all_at(first));
  pipeline.flush();
  pipeline.push(TriggerEvent{0, true, 0});
  while (!held) std::this_thread::sleep_for(1ms);
  for (const auto& [t, backlog] : {std::pair(first + 5, Timestamp{5}), {Timestamp{0}, last}, {last, last}}) {
    pipeline.push(all_at(t));
    CHECK(pipeline.status().backlog_us == backlog);
    CHECK(pipeline.status().queue_depth >= 400);
  }
  go_on = true;

  std::atomic<bool> done = false;
  std::vector<std::thread> cameras;
  for (int c = 0; c < 2; ++c)
    cameras.emplace_back([&] {
      for (bool later = false; !done; later = !later) pipeline.push(all_at(later ? last : first));
    });
  std::uint64_t events = 0, negative = 0;  // a negative number of unsigned ones is a huge one
  Timestamp least = 0;
  while (events < 500000) {
    const live::Status status = pipeline.status();
    events = status.events;
    negative += status.queue_depth > events ? 1 : 0;
    least = std::min(least, status.backlog_us);
  }
  done = true;
  for (std::thread& camera : cameras) camera.join();
  CHECK(negative == 0);
  CHECK(least == 0);
}

#ifdef __linux__
namespace {

/// Scheduling policies and nice values of all threads of this process.
std::multiset<std::pair<int, int>> priorities() {
  std::multiset<std::pair<int, int>> all;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    const auto id = static_cast<pid_t>(std::stoi(task.path().filename().string()));
    const int policy = sched_getscheduler(id);
    if (policy < 0) continue;  // it has ended
    all.insert({policy & ~SCHED_RESET_ON_FORK, getpriority(PRIO_PROCESS, static_cast<id_t>(id))});
  }
  return all;
}

}  // namespace

TEST_CASE(
    "no thread but the tracking one has another priority than before, nor those that detector and callback start") {
  const std::pair normal(SCHED_OTHER, getpriority(PRIO_PROCESS, 0));
  if (sched_getscheduler(0) != SCHED_OTHER) {
    MESSAGE("skipped: this program has a priority of its own");
    return;
  }
  // Whether a thread that is started here, as those of OpenCV's pool may be, inherits another priority. The threads of
  // one with real-time priority have a nice value of 0 at least.
  const auto inherits_other = [&] {
    const auto started = std::async(std::launch::async, [] {
                           return std::pair(sched_getscheduler(0), getpriority(PRIO_PROCESS, 0));
                         }).get();
    return started != normal && started != std::pair(SCHED_OTHER, 0);
  };
  for (const auto priority : {live::TrackingPriority::automatic, live::TrackingPriority::normal}) {
    std::atomic<int> frames = 0, other = 0;
    Settings settings{.overload = OverloadPolicy::block, .priority = priority};
    settings.on_trigger = [&](const TriggerEvent&) { other += inherits_other(); };
    live::Pipeline pipeline(simulated::camera,
                            TrueDetector{motion(),
                                         [&] {
                                           other += inherits_other();
                                           ++frames;
                                         }},
                            kNoPoses, settings);
    pipeline.push(events());
    pipeline.push(TriggerEvent{0, true, events().back().t});
    pipeline.flush();
    for (int i = 0; i < 10000 && frames == 0; ++i) std::this_thread::sleep_for(1ms);
    REQUIRE(frames > 0);
    CHECK(other == 0);
    const bool real_time = pipeline.status().real_time;
    if (priority == live::TrackingPriority::normal) CHECK_FALSE(real_time);
    auto during = priorities();
    if (real_time) {
      const auto tracking = std::ranges::find(during, SCHED_RR, &std::pair<int, int>::first);
      REQUIRE(tracking != during.end());
      during.erase(tracking);
    }
    CHECK(during.count(normal) == during.size());
    pipeline.stop();
    CHECK(priorities().count(normal) == priorities().size());
  }
}

TEST_CASE("real-time priority is asked for where it is of use, and tracking goes on without it") {
  const auto track = [&](const Settings& settings) {
    live::Pipeline pipeline(simulated::camera, TrueDetector{motion()}, kNoPoses, settings);
    const bool real_time = pipeline.status().real_time;  // known from the start
    pipeline.push(events());
    pipeline.flush();
    const live::Status status = pipeline.status();
    CHECK(status.processed + status.filtered + status.off_sensor + status.hot == events().size());
    CHECK(status.real_time == real_time);
    pipeline.stop();
    CHECK(pipeline.status().real_time == real_time);
    return real_time;
  };
  const Settings automatic{.overload = OverloadPolicy::block};
  bool permitted = false;
  std::thread([&] {
    permitted = live::request_real_time_priority();
    live::drop_real_time_priority();
    CHECK((sched_getscheduler(0) & ~SCHED_RESET_ON_FORK) == SCHED_OTHER);
  }).join();
  MESSAGE("permitted here: " << permitted);
  CHECK(track(automatic) == permitted);
  CHECK_FALSE(track({.overload = OverloadPolicy::block, .priority = live::TrackingPriority::normal}));
  CHECK_FALSE(track({.overload = OverloadPolicy::block, .wait_for_detector = true}));  // for files, which can wait

  // A thread without root's rights, which those that it starts inherit; the C library's function would be for all.
  rlimit before{};
  getrlimit(RLIMIT_RTPRIO, &before);
  const rlimit none{0, before.rlim_max};
  setrlimit(RLIMIT_RTPRIO, &none);
  std::thread([&] {
    constexpr int kNobody = 65534;
    syscall(SYS_setresuid, kNobody, kNobody, kNobody);
    CHECK_FALSE(track(automatic));
  }).join();
  setrlimit(RLIMIT_RTPRIO, &before);
}
#endif
