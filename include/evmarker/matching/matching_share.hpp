#pragma once
// Which share of a uniform background would match a wireframe's edges by chance.
#include <cmath>
#include <optional>

#include "evmarker/matching/model_matcher.hpp"

namespace evmarker {

/// Measures, with quasi-random points, which share of the area near the edges is matched: the share of the background
/// events near a wireframe that match its edges by chance; ambiguous ones count as not matched. Nothing where no point
/// is near.
inline std::optional<double> matching_share(const ModelMatcher& matcher) noexcept {
  constexpr int kPoints = 512;
  constexpr double kStep_x = 0.7548776662466927, kStep_y = 0.5698402909980532;  // of the R2 sequence
  const Box box = matcher.reach();
  int matching = 0, not_far = 0;
  Correspondence correspondence;
  for (int i = 1; i <= kPoints; ++i) {
    const double x = i * kStep_x - std::floor(i * kStep_x), y = i * kStep_y - std::floor(i * kStep_y);
    const MatchResult match =
        matcher.match({box.low.x + x * box.width(), box.low.y + y * box.height()}, correspondence);
    matching += match == MatchResult::matched;
    not_far += match != MatchResult::far;
  }
  if (not_far == 0) return std::nullopt;
  return static_cast<double>(matching) / not_far;
}

}  // namespace evmarker
