#pragma once
// After how many matched events the pose is updated.
#include <algorithm>
#include <cmath>

#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// Matched events from one update to the next, the paper's n: a number that is set, or as many as the edges make while
/// they move by a tenth of a pixel, at most the paper's 100.
class UpdateInterval {
 public:
  /// @param setting see EdgeFollowerSettings::events_per_update
  explicit UpdateInterval(int setting) noexcept
      : automatic_(setting == kAutomatic), events_(automatic_ ? kMostEvents : setting) {}

  int events() const noexcept { return events_; }

  /// Adapts an automatic interval. Returns true if it has changed, which it does not for every small change of the
  /// distance.
  /// @param length_px of all edges in sight
  /// @param events_per_passage that a pixel makes while an edge passes over it; 0 if it is not known
  bool adapt(double length_px, double events_per_passage) noexcept {
    constexpr double kMotion_px = 0.1;
    if (!automatic_) return false;
    const double events =
        std::clamp(kMotion_px * std::max(events_per_passage, 1.0) * length_px, 1.0, 1.0 * kMostEvents);
    if (!(std::abs(events - events_) > events_ / 8.0)) return false;
    events_ = static_cast<int>(events);
    return true;
  }

 private:
  static constexpr int kMostEvents = 100;

  bool automatic_;
  int events_;
};

}  // namespace evmarker
