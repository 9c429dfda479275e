#pragma once
// Which share of a uniform background would match a wireframe's edges by chance.
#include <cmath>
#include <optional>

#include "evmarker/matching/model_matcher.hpp"

namespace evmarker {

/// Measures, with quasi-random points, which share of the area near the edges is matched: the share of the background
/// events near a wireframe that match its edges by chance; ambiguous ones count as not matched. The points are counted
/// a few at a time, so that no event has to wait for all of them.
class MatchingShare {
 public:
  /// Begins anew, with enough points for a first estimate, whose standard deviation is about 0.02.
  void restart(const ModelMatcher& matcher) noexcept {
    matching_ = not_far_ = points_ = 0;
    add(matcher, kFirst);
  }

  /// Counts some more points, at the matcher's present pose.
  void refine(const ModelMatcher& matcher) noexcept { add(matcher, kMore); }
  /// True once there are so many that the standard deviation is about 0.005.
  bool is_refined() const noexcept { return points_ >= kMost; }

  /// The share; nothing if no point was near.
  std::optional<double> share() const noexcept {
    if (not_far_ == 0) return std::nullopt;
    return static_cast<double>(matching_) / not_far_;
  }

 private:
  static constexpr int kFirst = 512, kMore = 32, kMost = 8192;

  void add(const ModelMatcher& matcher, int points) noexcept {
    constexpr double kStep_x = 0.7548776662466927, kStep_y = 0.5698402909980532;  // of the R2 sequence
    const Box box = matcher.reach();
    Correspondence correspondence;
    for (const int end = points_ + points; points_ < end;) {
      ++points_;
      const double x = points_ * kStep_x - std::floor(points_ * kStep_x),
                   y = points_ * kStep_y - std::floor(points_ * kStep_y);
      const MatchResult match =
          matcher.match({box.low.x + x * box.width(), box.low.y + y * box.height()}, correspondence);
      matching_ += match == MatchResult::matched;
      not_far_ += match != MatchResult::far;
    }
  }

  int matching_ = 0, not_far_ = 0, points_ = 0;
};

}  // namespace evmarker
