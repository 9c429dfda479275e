#pragma once
// Floor 5. How badly edges explain events: tells which of two poses that look alike is the right one.
#include <cmath>
#include <limits>

#include "evmarker/edge_follower.hpp"

namespace evmarker {

/// Root mean square distance of the events of some updates to their edges, unmatched ones at the limit.
class Misfit {
 public:
  void add(const UpdateStatistics& update, double limit_px) noexcept {
    sum_px2_ += update.matched * update.residual_px * update.residual_px +
                (update.offered - update.matched) * limit_px * limit_px;
    events_ += update.offered;
  }

  int events() const noexcept { return events_; }

  /// [px], infinite without events.
  double px() const noexcept {
    return events_ > 0 ? std::sqrt(sum_px2_ / events_) : std::numeric_limits<double>::infinity();
  }

 private:
  double sum_px2_ = 0;
  int events_ = 0;
};

}  // namespace evmarker
