#pragma once
// Estimates how many of the events that match edges are background, by the events beside the edges and by polarities.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/update/matched_background.hpp"

namespace evmarker {

/// Estimates how surely the events that match a wireframe's edges come from moving edges, not background. At rest all
/// events near the wireframe are background: they lie on its edges by chance, and beside them just as densely. While it
/// moves, few events lie beside the edges of a large marker. A small one's own events also lie beside its edges, and
/// match wrong ones by chance as background does, but are no noise. The more polarities fit the motion, the less noise
/// there can be, and its rate is at most the lowest that matched events had lately. For a moment, many events also lie
/// beside the edges when the marker moves faster than the pose follows.
class BackgroundShare {
 public:
  /// Sets how background is distributed.
  /// @param share the share of a uniform background near the wireframe that matches its edges
  void expect_matching(double share) noexcept { matching_to_others_ = share / std::max(1 - share, kLeast); }

  /// Adds the numbers of events near the wireframe since the last call. The first call only tells when they begin.
  /// @param others events that matched no edge
  /// @param t time of the last event [us]
  void add(int matched, int others, Timestamp t) noexcept {
    if (!std::exchange(begun_, true)) {  // when these events began is not known
      t_us_ = static_cast<double>(t);
      return;
    }
    matched_ += matched;
    others_ += others;
  }

  /// True once there are enough events to `measure` the background.
  bool due() const noexcept { return matched_ >= kTogether; }

  /// The background among the events since the last call, whose last one was at t [us].
  /// @param moving share of those matched that come from moving edges, by their polarities
  MatchedBackground measure(Timestamp t, MovingShare moving) noexcept {
    const double now_us = static_cast<double>(t), dt_us = std::max(1.0, now_us - t_us_);
    t_us_ = now_us;
    // Of the events beside the edges, the most that can be noise: by the lowest rate of matched events, and where
    // polarities show a motion, by these.
    const double by_polarities = (1 - moving.likely) * matched_ / matching_to_others_,
                 by_fewest = least_rate_.most_noise(matched_, dt_us) / matching_to_others_,
                 others_noise = std::min({1.0 * others_, by_fewest, moving.least > 0 ? by_polarities : by_fewest});
    const double matched_by_chance = matching_to_others_ * usual_others_.limited(others_, dt_us),
                 matched_noise = matching_to_others_ * usual_noise_.limited(others_noise, dt_us);
    usual_others_.add(others_, dt_us);
    usual_noise_.add(others_noise, dt_us);
    const Excess now{1.0 * matched_, matched_ - matched_noise, matched_noise * (1 + matching_to_others_)};
    // Slow motion is not significant in so few events, but in the sum over all since the last fast motion.
    lately_ = now.signal() < 0.5 ? lately_.faded_plus(now) : Excess();
    matched_ = others_ = 0;
    return {.signal_weight = std::max({now.signal(), lately_.signal(), std::min(1.0, 2 * moving.least)}),
            .by_chance_per_s = 1e6 * (matched_by_chance / dt_us),
            .noise_per_s = 1e6 * (matched_noise / dt_us),
            .noise_share = std::min(1.0, matched_noise / now.matched)};
  }

 private:
  // A running mean of the rate of events.
  class UsualRate {
   public:
    // `events` in dt_us, but at most twice as many as usual, 0 at first: what is beyond has another cause.
    double limited(double events, double dt_us) const noexcept { return std::min(events, 2 * per_us_ * dt_us); }
    void add(double events, double dt_us) noexcept {
      per_us_ += dt_us / (dt_us + known_us_) * (events / dt_us - per_us_);
      known_us_ = std::min(known_us_ + dt_us, kMemory_us);
    }

   private:
    static constexpr double kMemory_us = 500000;
    double per_us_ = 0;
    double known_us_ = 0;  // for how long it has been measured, limited to kMemory_us
  };

  // The least rate of events lately. Noise comes all the time, so that its rate is no more: where there suddenly are
  // many events, beside the edges as well as on them, the marker moves and the pose does not follow.
  class LeastRate {
   public:
    // The most of the `events` in dt_us that can be noise.
    double most_noise(double events, double dt_us) noexcept {
      const double most_per_us = (events + kSurelyOfMany * std::sqrt(events)) / dt_us;
      per_us_ = std::min(per_us_ * (1 + dt_us / kMemory_us), most_per_us);
      return per_us_ * dt_us;
    }

   private:
    static constexpr double kMemory_us = 2000000;  // in this time, noise may grow by a factor of e
    static constexpr double kSurelyOfMany = 5;     // standard deviations: it is the least of hundreds of numbers
    double per_us_ = std::numeric_limits<double>::infinity();
  };

  // Matched events, their excess over the background expected on the edges, and the variance of that excess, for B
  // events of background B + r B: their own, and that of the estimate r times others, r = matching_to_others_.
  struct Excess {
    double matched = 0, excess = 0, variance = 0;
    // Weight of the events, from 1 if at least half of them are surely from moving edges to 0 if none surely is.
    double signal() const noexcept {
      return matched > 0 ? std::clamp(2 * (excess - kSurely * std::sqrt(variance)) / matched, 0.0, 1.0) : 0;
    }
    Excess faded_plus(const Excess& now) const noexcept {
      return {kKept * matched + now.matched, kKept * excess + now.excess, kKept * variance + now.variance};
    }
  };

  static constexpr int kTogether = 64;        // matched events for which the background is measured anew
  static constexpr double kKept = 15.0 / 16;  // of the sums, at each time
  static constexpr double kLeast = 0.05;      // least share of the background that is taken to match no edge
  static constexpr double kSurely = 3;        // standard deviations

  double matching_to_others_ = 0.5;  // of the background: events that match edges per event that does not
  int matched_ = 0, others_ = 0;     // events since the last `measure`
  bool begun_ = false;
  double t_us_ = 0;  // of the last `measure`
  UsualRate usual_others_, usual_noise_;
  LeastRate least_rate_;
  Excess lately_;  // fading sums since the last fast motion
};

}  // namespace evmarker
