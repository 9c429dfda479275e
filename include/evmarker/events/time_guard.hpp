#pragma once
// Finds single events whose time is wrong, by a fault of transmission, before they do harm.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Finds the events whose time neither the event before nor the one after confirms.
///
/// An event that is far in time from the one before, later or earlier, is held back until the next one comes. If that
/// one is nearer in time to the held event than to the event before it, as after a rest or a restart of the camera, the
/// held event is released; else it is discarded. No event waits for more than one other. The very first event always
/// passes.
class TimeGuard {
 public:
  /// Times at most this far apart confirm each other [us]. Drivers deliver events less out of order than this, and an
  /// edge at 2000 px/s moves by one pixel in it.
  static constexpr std::uint64_t kNear_us = 500;

  enum class Verdict {
    pass,    ///< to be taken now
    hold,    ///< kept here until the next event comes
    release  ///< `held()` is to be taken now; then this event is to be judged again
  };

  /// Judges the next event of the stream; see Verdict for what the caller has to do with it.
  Verdict judge(const Event& event) noexcept {
    if (!passes(event.t)) [[unlikely]]
      return judge_carefully(event);
    last_t_ = event.t;
    return Verdict::pass;
  }

  /// True if an event at this time passes without `judge`: none is held back, and the one before is near in time.
  bool passes(Timestamp t) const noexcept { return elapsed_us(last_t_, t) + kNear_us < end_us_; }
  /// How many events of a batch pass without `judge` before the first one that does not. To be followed by `passed` for
  /// those that are taken.
  std::size_t passing(std::span<const Event> events) const noexcept {
    if (events.empty() || !passes(events.front().t)) return 0;
    std::size_t count = 1;
    while (count < events.size() && near(events[count - 1].t, events[count].t)) ++count;
    return count;
  }
  /// To be called when events have been taken without `judge`, as `passes` or `passing` allow; the last at this time.
  void passed(Timestamp last) noexcept { last_t_ = last; }

  /// Takes events from the front of a span, and returns those that are to be used next: as many as confirm each other,
  /// the held one, or none. To be called again while any are left.
  std::span<const Event> next(std::span<const Event>& events) noexcept {
    constexpr std::size_t kTogether = 1024;  // so few that they stay cached
    const std::size_t count = passing(events.first(std::min(events.size(), kTogether)));
    if (count == 0) [[unlikely]]
      return next_by_judging(events);
    passed(events[count - 1].t);
    return take(events, count);
  }

  /// The event that is held back, or that was held back last.
  const Event& held() const noexcept { return held_; }
  /// True if an event is held back and one at this time would release it.
  bool releases(Timestamp t) const noexcept { return holding_ && distance_us(held_.t, t) < distance_us(last_t_, t); }

  /// Time of the event that is taken first when an event at time t comes: of the held one if it is released, else t;
  /// null if the new event would be held back.
  std::optional<Timestamp> next_t(Timestamp t) const noexcept {
    if (releases(t)) return held_.t;
    return !started_ || near(last_t_, t) ? std::optional(t) : std::nullopt;
  }

  /// Continues at another time after a gap in the events. A held event is discarded.
  void restart(Timestamp t) noexcept {
    faults_ += holding_;
    follow(t);
  }

  /// How many events were discarded.
  std::uint64_t faults() const noexcept { return faults_; }

 private:
  // True if |t - last| <= kNear_us, by one comparison: for an earlier t, the difference wraps around and the addition
  // wraps it back.
  static bool near(Timestamp last, Timestamp t) noexcept { return elapsed_us(last, t) + kNear_us < 2 * kNear_us + 1; }
  static std::uint64_t distance_us(Timestamp a, Timestamp b) noexcept {
    return a < b ? elapsed_us(a, b) : elapsed_us(b, a);
  }

  static std::span<const Event> take(std::span<const Event>& events, std::size_t count) noexcept {
    return std::exchange(events, events.subspan(count)).first(count);
  }

  [[gnu::noinline]] std::span<const Event> next_by_judging(std::span<const Event>& events) noexcept {
    if (events.empty()) return {};
    switch (judge(events.front())) {
      case Verdict::pass: return take(events, 1);
      case Verdict::release: return {&held_, 1};
      case Verdict::hold: break;
    }
    take(events, 1);
    return {};
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

  // Sets the time that the next events are compared with; no event is held any more.
  void follow(Timestamp t) noexcept {
    last_t_ = t;
    started_ = true;
    holding_ = false;
    end_us_ = 2 * kNear_us + 1;
  }

  Timestamp last_t_ = 0;
  // Bound in `passes`: that of `near`, or 0, so that no time passes, at first and while an event is held back.
  std::uint64_t end_us_ = 0;
  bool started_ = false, holding_ = false;
  Event held_;
  std::uint64_t faults_ = 0;
};

}  // namespace evmarker
