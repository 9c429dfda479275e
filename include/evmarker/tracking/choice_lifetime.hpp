#pragma once
// For how many updates events may be matched to the edges that they had at an earlier pose.
#include <algorithm>

namespace evmarker {

/// Counts the updates for which events are matched to the edges chosen at an earlier pose: choosing them anew after
/// every update would make matching in groups impossible. However fast the marker is, while it makes a tenth as many
/// matched events as its edges are long in the image [px], they move by half a pixel at most. The choice holds for so
/// many matched events, at most 32: with those that match no edge, they fill a group.
class ChoiceLifetime {
 public:
  /// Begins anew: edges have just been chosen at a new pose, and nothing has been matched since the last update.
  /// @param edge_length_px of all edges together
  void begin(double edge_length_px, int events_per_update) noexcept {
    const double updates = std::min(kMostEvents, edge_length_px / 10) / events_per_update;
    most_updates_ = updates > 1 ? static_cast<int>(updates) : 1;
    updates_ = 0;
  }

  /// Counts an update. Returns true if edges must be chosen anew at the pose that it leads to.
  bool count_update() noexcept { return ++updates_ >= most_updates_; }

  /// How many more events may be matched until the edges must be chosen anew.
  /// @param matched since the last update
  int events_left(int events_per_update, int matched) const noexcept {
    return (most_updates_ - updates_) * events_per_update - matched;
  }

 private:
  static constexpr double kMostEvents = 32;

  int most_updates_ = 1, updates_ = 0;
};

}  // namespace evmarker
