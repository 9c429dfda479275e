// The parts of the program soak.
#include <doctest/doctest.h>
#include <sys/mman.h>

#include <cmath>
#include <cstddef>
#include <cstring>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "../../bench/encoding_loop.hpp"
#include "../../bench/periodic_recording.hpp"
#include "../../bench/resident_memory.hpp"
#include "../../bench/soak_record.hpp"

using namespace evmarker;
using bench::Encoding;
using bench::SoakCounts;
using bench::SoakMinute;

namespace {

// Three minutes that are alike.
std::vector<SoakMinute> steady() {
  SoakMinute minute{60, 100, {}};
  bench::JudgedPose pose{.error = {.translation_mm = 0.3, .rotation_deg = 0.2}, .nees = 0.5};
  for (int i = 0; i < 10; ++i) minute.counts.add(pose);
  return {3, minute};
}

bool found(const std::vector<SoakMinute>& minutes, const std::string& what) {
  return bench::find_fault(minutes).find(what) != std::string::npos;
}

}  // namespace

TEST_CASE("a soak that stays the same passes, also within the limits of memory and errors") {
  auto minutes = steady();
  CHECK(bench::find_fault(minutes).empty());
  minutes[1].resident_mb += 0.9;
  minutes[2].counts.nees *= 0.985;
  minutes[2].counts.translation_mm2 *= 1.03;  // squared
  CHECK(bench::find_fault(minutes).empty());
}

TEST_CASE("a soak finds memory that grows, errors that drift, and what is lost or dropped") {
  CHECK(found({steady().front()}, "fewer than two minutes"));
  for (const std::size_t minute : {1u, 2u}) {
    auto minutes = steady();
    minutes[minute].resident_mb += 1.1;
    CHECK(found(minutes, "memory has grown by 1.1 MB"));
  }
  for (const auto& [sum, what] : {std::pair(&SoakCounts::translation_mm2, "translation error has changed from 0.3"),
                                  {&SoakCounts::rotation_deg2, "rotation error has changed from 0.2"},
                                  {&SoakCounts::nees, "NEES has changed from 0.5"}})
    for (const double factor : {0.9, 1.1}) {
      auto minutes = steady();
      minutes.back().counts.*sum *= factor;
      CHECK(found(minutes, what));
    }
  for (const auto& [count, what] : {std::pair(&SoakCounts::dropped, "events dropped"),
                                    {&SoakCounts::time_faults, "time faults"},
                                    {&SoakCounts::time_steps_back, "steps back"},
                                    {&SoakCounts::exceptions, "exceptions"},
                                    {&SoakCounts::lost, "losses"}}) {
    auto minutes = steady();
    minutes[1].counts.*count = 3;
    CHECK(found(minutes, std::string("3 ") + what));
  }
  auto minutes = steady();
  minutes.back().counts = {};  // no pose at all
  CHECK(found(minutes, "error has changed"));
}

TEST_CASE("the counts of a minute are those since the last one, of poses that are called tracking") {
  SoakCounts before;
  before.add(bench::JudgedPose{.error = {3, 1}, .nees = 1});
  live::Status status;
  status.events = 10;
  status.poses = 1;
  before.add(status);
  SoakCounts now = before;
  now.add(bench::JudgedPose{.error = {0.5, 0.25}, .nees = 2});
  now.add(bench::JudgedPose{.state = TrackingState::converging, .error = {50, 25}, .nees = 200});
  status.events = 5;
  status.poses = status.dropped = status.detector_errors = 2;
  status.lost = status.callback_errors = 1;
  now.add(status);
  const SoakCounts minute = now.since(before);
  CHECK(minute.events == 5);
  CHECK(minute.poses == 2);
  CHECK(minute.dropped == 2);
  CHECK(minute.lost == 1);
  CHECK(minute.exceptions == 3);
  CHECK(minute.rms_mm() == doctest::Approx(0.5));
  CHECK(minute.rms_deg() == doctest::Approx(0.25));
  CHECK(minute.mean_nees() == doctest::Approx(2));
}

TEST_CASE("events come out of every encoding as they went in, piece by piece, across the wraps of its clock") {
  constexpr Timestamp kEvt3Wrap = Timestamp{1} << 24, kEvt2Wrap = Timestamp{1} << 34;
  for (const auto& [encoding, wrap] : {std::pair(Encoding::evt2, kEvt2Wrap),
                                       {Encoding::evt21, kEvt2Wrap},
                                       {Encoding::evt3, kEvt3Wrap},
                                       {Encoding::evt3, 5 * kEvt3Wrap},
                                       {Encoding::none, Timestamp{1} << 53}}) {
    bench::EncodingLoop loop(encoding, {640, 480});
    std::vector<Event> events, decoded;
    for (int i = 0; i < 20000; ++i)
      events.push_back({static_cast<std::uint16_t>(7 * i % 640), static_cast<std::uint16_t>(i % 480),
                        static_cast<std::int16_t>(i % 2), wrap - 100000 + 10 * i});
    for (std::size_t at = 0; at < events.size(); at += 1000) {
      const auto piece = loop.pass(std::span(events).subspan(at, 1000));
      decoded.insert(decoded.end(), piece.begin(), piece.end());
    }
    CHECK(decoded == events);
  }
}

TEST_CASE("a periodic recording repeats its events with their times moved on, and its truth") {
  constexpr Timestamp kPeriod = 100000;
  const Trajectory motion = [](double s) {
    return facing_pose({0.02 * std::sin(2 * std::numbers::pi * 10 * s), 0, 0.6});
  };
  Random random(1);
  const bench::PeriodicRecording recording(bench::detail::one_marker(random, motion, 0), kPeriod);
  REQUIRE(recording.events().size() > 10000);
  CHECK(recording.events().front().t >= 0);
  CHECK(recording.events().front().t < 1000);
  CHECK(recording.events().back().t < kPeriod);
  constexpr Timestamp kBegin = (Timestamp{1} << 53) - 50000;
  std::vector<Event> moved;
  recording.move_to(kBegin, moved);
  REQUIRE(moved.size() == recording.events().size());
  CHECK(moved.back().t == recording.events().back().t + kBegin);
  CHECK(recording.truth(7 * kPeriod + 30000).isApprox(motion(0.03)));
}

TEST_CASE("memory that is used is resident") {
#ifdef __linux__
  const double before = bench::resident_mb();
  // Mapped anew: what a container is given may have been freed before and be resident already.
  constexpr std::size_t kBytes = std::size_t{20} << 20;
  void* const block = ::mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  REQUIRE(block != MAP_FAILED);
  std::memset(block, 1, kBytes);
  CHECK(bench::resident_mb() - before > 15);
  ::munmap(block, kBytes);
#endif
}
