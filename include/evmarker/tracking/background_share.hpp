#pragma once
// Estimates which share of the events that match edges is background, from the events beside the edges.
#include <algorithm>
#include <cmath>
#include <utility>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Estimates how surely the events that match a wireframe's edges come from moving edges, not background. At rest all
/// events near the wireframe are background: they lie on its edges by chance, and beside them just as densely. While it
/// moves, few events lie beside the edges; many do so only for a moment, when it moves faster than the pose follows.
class BackgroundShare {
 public:
  /// Sets how background is distributed.
  /// @param share the share of a uniform background near the wireframe that matches its edges
  void expect_matching(double share) noexcept { matching_to_others_ = share / std::max(1 - share, kLeast); }

  /// Adds the numbers of events near the wireframe since the last call, and the time of the last one [us].
  /// @param others events that matched no edge
  /// @return true if there were enough events to compute `signal()` anew
  bool add(int matched, int others, Timestamp t) noexcept {
    if (!std::exchange(begun_, true)) {  // since when these events came is not known
      t_us_ = static_cast<double>(t);
      return false;
    }
    matched_ += matched;
    others_ += others;
    if (matched_ < kTogether) return false;
    const double now_us = static_cast<double>(t), dt_us = std::max(1.0, now_us - t_us_);
    t_us_ = now_us;
    // Background is limited to twice its usual rate: more events beside the edges have another cause.
    const double background = matching_to_others_ * std::min(1.0 * others_, 2 * others_per_us_ * dt_us);
    // By the events of this interval. The usual rate is too high for a slow marker that was fast before: then it made
    // many events beside its edges itself.
    matching_per_us_ = background / dt_us;
    others_per_us_ += dt_us / (dt_us + known_us_) * (others_ / dt_us - others_per_us_);
    known_us_ = std::min(known_us_ + dt_us, kMemory_us);
    const Excess now{1.0 * matched_, matched_ - background, background * (1 + matching_to_others_)};
    // Slow motion is not significant in so few events, but in the sum over all since the last fast motion.
    lately_ = now.signal() < 0.5 ? lately_.faded_plus(now) : Excess();
    signal_ = std::max(now.signal(), lately_.signal());
    matched_ = others_ = 0;
    return true;
  }

  /// Weight of the matched events, from 1 if at least half of them are surely from moving edges to 0 if none surely is.
  double signal() const noexcept { return signal_; }

  /// Background events that match edges, when `signal()` was last computed [1/s].
  double matching_per_s() const noexcept { return 1e6 * matching_per_us_; }

 private:
  // Matched events, their excess over the background expected on the edges, and the variance of that excess: of a
  // background of B events B itself, and r B as it is estimated by B / r others, r = matching_to_others_.
  struct Excess {
    double matched = 0, excess = 0, variance = 0;
    double signal() const noexcept {
      return matched > 0 ? std::clamp(2 * (excess - kSurely * std::sqrt(variance)) / matched, 0.0, 1.0) : 0;
    }
    Excess faded_plus(const Excess& now) const noexcept {
      return {kKept * matched + now.matched, kKept * excess + now.excess, kKept * variance + now.variance};
    }
  };

  static constexpr int kTogether = 64;          // matched events for which `signal()` is computed anew
  static constexpr double kKept = 15.0 / 16;    // of the sums, at each time
  static constexpr double kMemory_us = 500000;  // of the usual rate
  static constexpr double kLeast = 0.05;        // least share of the background that is taken to match no edge
  static constexpr double kSurely = 2.5;        // standard deviations

  double matching_to_others_ = 0.5;  // of the background: events that match edges per event that does not
  int matched_ = 0, others_ = 0;
  bool begun_ = false;
  double t_us_ = 0;             // when `signal()` was last computed
  double others_per_us_ = 0;    // usual rate of the events beside the edges
  double known_us_ = 0;         // for how long that rate has been measured, limited to kMemory_us
  double matching_per_us_ = 0;  // background that matches edges, as of the last judgement
  double signal_ = 1;
  Excess lately_;  // fading sums since the last fast motion
};

}  // namespace evmarker
