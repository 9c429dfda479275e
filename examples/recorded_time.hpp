#pragma once
// How long a recording is, whatever a few wrong times in it say.
#include <algorithm>
#include <cstdint>
#include <evmarker/events/event.hpp>
#include <optional>

/// Adds up the time from the first event to the last. Where the clock jumps, as by garbled bytes, and soon comes back
/// to where it was, the times between are stray and count for nothing. So do those of a few events behind a last jump,
/// or of one before a first, that is far longer than all other gaps. After any other jump, as by a rest or a clock that
/// was set back, time goes on from there.
/// @tparam Gaps `add(from, to)` takes the times from event to event, without what is stray
template <typename Gaps>
class RecordedTimeWith {
 public:
  void add(evmarker::Timestamp t) {
    const std::uint64_t before = events_++;
    if (before == 0) {
      now_ = {t, t, t};
    } else if (distance_us(now_.last, t) <= kJump_us) {
      const std::uint64_t passed_us = now_.passed_us;
      now_.move_to(t);
      steady_us_ += now_.passed_us - passed_us;
      if (steady_us_ > kJump_us) before_jump_.reset();  // the jump lasts
    } else if (before == 1) {
      first_ = now_.last;  // the others show whether it belongs to them
      now_ = {t, t, t};
    } else {
      jump_to(t, before);
    }
  }

  /// Earliest and latest time that is not stray.
  evmarker::Timestamp begin() const { return first_belongs() ? *first_ : counted().begin; }
  evmarker::Timestamp end() const { return counted().end; }
  double seconds() const {
    const std::uint64_t us = counted().passed_us + (first_belongs() ? distance_us(*first_, counted().begin) : 0);
    return 1e-6 * static_cast<double>(us);
  }

  /// Of the events whose times are not stray.
  Gaps gaps() const {
    Gaps gaps = counted().gaps;
    if (first_belongs()) gaps.add(*first_, counted().begin);
    return gaps;
  }

  /// Number of events whose times are stray.
  std::uint64_t stray() const {
    return stray_ + (first_ && !first_belongs()) + (ends_astray() ? events_ - events_before_jump_ : 0);
  }

 private:
  static constexpr std::uint64_t kJump_us = 100000;                  // more than drivers deliver out of order
  static constexpr std::uint64_t kFewEvents = 100, kFarLonger = 10;  // at the end

  struct State {
    evmarker::Timestamp begin = 0, end = 0, last = 0;
    std::uint64_t passed_us = 0, longest_us = 0;  // from event to event
    Gaps gaps = {};

    void move_to(evmarker::Timestamp t) {
      begin = std::min(begin, t);
      end = std::max(end, t);
      if (t > last) {
        const std::uint64_t gap_us = evmarker::elapsed_us(last, t);
        passed_us += gap_us;
        longest_us = std::max(longest_us, gap_us);
        gaps.add(last, t);
      }
      if (t > last || distance_us(last, t) > kJump_us) last = t;
    }
    bool is_far_shorter_than(std::uint64_t gap_us) const { return longest_us > 0 && gap_us / kFarLonger > longest_us; }
  };

  static std::uint64_t distance_us(evmarker::Timestamp a, evmarker::Timestamp b) {
    return a < b ? evmarker::elapsed_us(a, b) : evmarker::elapsed_us(b, a);
  }

  void jump_to(evmarker::Timestamp t, std::uint64_t events_before) {
    if (before_jump_ && distance_us(before_jump_->last, t) <= kJump_us) {
      stray_ += events_before - events_before_jump_;
      now_ = *before_jump_;
      before_jump_.reset();
    } else if (!before_jump_) {  // else it strays on
      before_jump_ = now_;
      events_before_jump_ = events_before;
      jump_us_ = distance_us(now_.last, t);
    }
    now_.move_to(t);
    steady_us_ = 0;
  }

  bool first_belongs() const {
    return first_ && *first_ < counted().begin && !counted().is_far_shorter_than(distance_us(*first_, counted().begin));
  }
  bool ends_astray() const {
    return before_jump_ && events_ - events_before_jump_ <= kFewEvents && before_jump_->is_far_shorter_than(jump_us_);
  }
  const State& counted() const { return ends_astray() ? *before_jump_ : now_; }

  State now_;
  std::uint64_t events_ = 0, stray_ = 0;
  std::optional<evmarker::Timestamp> first_;  // the first event's, where the second is far from it
  std::optional<State> before_jump_;          // until the clock comes back or goes on for a while
  std::uint64_t events_before_jump_ = 0, jump_us_ = 0, steady_us_ = 0;
};

struct NoGaps {
  void add(evmarker::Timestamp, evmarker::Timestamp) {}
};

using RecordedTime = RecordedTimeWith<NoGaps>;
