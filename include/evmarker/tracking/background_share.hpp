#pragma once
// How many of the events that match edges are background, by how many there are beside the edges.
#include <algorithm>
#include <cmath>
#include <utility>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// At rest all events near a wireframe are background: they lie on its edges by chance, and beside them just as
/// densely. While it moves there are few beside them; and many only for a moment, when it moves faster than the pose
/// follows.
class BackgroundShare {
 public:
  /// @param share of a uniform background near the wireframe that matches its edges
  void expect_matching(double share) noexcept { matching_to_others_ = share / std::max(1 - share, kLeast); }

  /// Takes the events near the wireframe since the last call, and the time of the last one [us]. True, once there are
  /// enough of them, if `signal()` is new.
  bool add(int matched, int others, Timestamp t) noexcept {
    if (!std::exchange(begun_, true)) t_us_ = static_cast<double>(t);
    matched_ += matched;
    others_ += others;
    if (matched_ < kTogether) return false;
    const double now_us = static_cast<double>(t), dt_us = std::max(1.0, now_us - t_us_);
    t_us_ = now_us;
    // Many more than usual, by time, are not background.
    const double background = matching_to_others_ * std::min(1.0 * others_, 2 * others_per_us_ * dt_us);
    others_per_us_ += dt_us / (dt_us + known_us_) * (others_ / dt_us - others_per_us_);
    known_us_ = std::min(known_us_ + dt_us, kMemory_us);
    const Excess now{1.0 * matched_, matched_ - background, background * (1 + matching_to_others_)};
    // A slow motion does not show in these few events, but adds up over those since the last fast one.
    lately_ = now.signal() < 0.5 ? lately_.faded_by(now) : Excess();
    signal_ = std::max(now.signal(), lately_.signal());
    matched_ = others_ = 0;
    return true;
  }

  /// 1 where at least half of the matched events are surely of moving edges, 0 where none is.
  double signal() const noexcept { return signal_; }

 private:
  // By how many the events on the edges are more than the background would make there.
  struct Excess {
    double matched = 0, events = 0, variance = 0;
    double signal() const noexcept {
      return matched > 0 ? std::clamp(2 * (events - kSurely * std::sqrt(variance)) / matched, 0.0, 1.0) : 0;
    }
    Excess faded_by(const Excess& now) const noexcept {
      return {kKept * matched + now.matched, kKept * events + now.events, kKept * variance + now.variance};
    }
  };

  static constexpr int kTogether = 64;
  static constexpr double kKept = 15.0 / 16;
  static constexpr double kMemory_us = 500000, kLeast = 0.05, kSurely = 2.5;

  double matching_to_others_ = 0.5;
  int matched_ = 0, others_ = 0;
  bool begun_ = false;
  double t_us_ = 0, known_us_ = 0;  // time of the last judgement; since when the rate is known
  double others_per_us_ = 0, signal_ = 1;
  Excess lately_;
};

}  // namespace evmarker
