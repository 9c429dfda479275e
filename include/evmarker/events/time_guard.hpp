#pragma once
// Single events with a wrong time are faults of transmission: found before they do harm.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Finds the events whose time neither the event before nor the one after confirms.
///
/// An event that is far in time from the one before, later or earlier, is held back until the next one comes. It was
/// right if that one is nearer to it in time than to the event before, as after a rest or a restart of the camera; else
/// it is discarded. Nothing waits for more than one event. The very first event of all cannot be judged.
class TimeGuard {
 public:
  /// The disorder of drivers is less, and so is what an edge needs for a pixel at 2000 px/s [us].
  static constexpr std::uint64_t kNear_us = 500;

  enum class Verdict {
    pass,    ///< to be taken now
    hold,    ///< kept here until the next event comes
    release  ///< `held()` is to be taken now, and this event to be judged again after that
  };

  Verdict judge(const Event& event) noexcept {
    if (!passes(event.t)) [[unlikely]]
      return judge_carefully(event);
    last_t_ = event.t;
    return Verdict::pass;
  }

  /// True if an event at this time would pass, and no other before it.
  bool passes(Timestamp t) const noexcept { return elapsed_us(last_t_, t) + kNear_us < end_us_; }
  /// How many of some events pass before the first one that does not.
  std::size_t passing(std::span<const Event> events) const noexcept {
    if (events.empty() || !passes(events.front().t)) return 0;
    std::size_t count = 1;
    while (count < events.size() && near(events[count - 1].t, events[count].t)) ++count;
    return count;
  }
  /// Events that were found `passing` have been taken, the last one at this time.
  void passed(Timestamp last) noexcept { last_t_ = last; }

  /// The event that is held back, or was.
  const Event& held() const noexcept { return held_; }
  /// True if an event is held back that one at this time confirms.
  bool releases(Timestamp t) const noexcept { return holding_ && distance_us(held_.t, t) < distance_us(last_t_, t); }

  /// Time of the event that is taken next if one at this time comes: of that one or of one that was held back; null if
  /// this one is to be held back itself.
  std::optional<Timestamp> next_t(Timestamp t) const noexcept {
    if (releases(t)) return held_.t;
    return !started_ || near(last_t_, t) ? std::optional(t) : std::nullopt;
  }

  /// Goes on at another time, events being missing. One that is held back is discarded.
  void restart(Timestamp t) noexcept {
    faults_ += holding_;
    follow(t);
  }

  /// Events that were discarded.
  std::uint64_t faults() const noexcept { return faults_; }

 private:
  static bool near(Timestamp last, Timestamp t) noexcept { return elapsed_us(last, t) + kNear_us < 2 * kNear_us + 1; }
  static std::uint64_t distance_us(Timestamp a, Timestamp b) noexcept {
    return a < b ? elapsed_us(a, b) : elapsed_us(b, a);
  }

  [[gnu::noinline]] Verdict judge_carefully(const Event& event) noexcept {
    if (releases(event.t)) {
      follow(held_.t);
      return Verdict::release;
    }
    faults_ += holding_;
    if (!started_ || near(last_t_, event.t)) {
      follow(event.t);
      return Verdict::pass;
    }
    held_ = event;
    holding_ = true;
    end_us_ = 0;
    return Verdict::hold;
  }

  void follow(Timestamp t) noexcept {
    last_t_ = t;
    started_ = true;
    holding_ = false;
    end_us_ = 2 * kNear_us + 1;
  }

  Timestamp last_t_ = 0;
  std::uint64_t end_us_ = 0;  // no time passes at first and while an event is held back
  bool started_ = false, holding_ = false;
  Event held_;
  std::uint64_t faults_ = 0;
};

}  // namespace evmarker
