#pragma once
// Markers that were lost a short time ago: the detector searches for them where their motion must have taken them.
#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/tracking/confirmed_markers.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"

namespace evmarker {

/// Lost markers with their last trackers, in the order of their losses.
template <PoseUpdateRule Rule>
class MissingMarkers {
 public:
  explicit MissingMarkers(std::size_t max_markers) : max_markers_(max_markers) {
    // Most between two requests of a detection: those missing before, those lost before its result, and those that the
    // result adds and that are lost again.
    markers_.reserve(3 * max_markers);
  }

  bool empty() const noexcept { return markers_.empty(); }

  /// Moves the lost ones of the confirmed markers here, in the order of their losses, however many a batch has lost.
  /// True if there were any.
  bool add_lost_of(ConfirmedMarkers<Rule>& confirmed) {
    const auto lost_at = [](const PlanarHypotheses<Rule>& marker) {
      return std::pair(marker.tracker().estimate().t, marker.id());
    };
    const std::size_t before = markers_.size();
    confirmed.remove_lost([&](PlanarHypotheses<Rule>& marker) {
      markers_.insert(std::ranges::upper_bound(markers_, lost_at(marker), {}, lost_at), std::move(marker));
    });
    return markers_.size() > before;
  }

  /// Removes the markers whose motion can no longer be predicted, and the oldest if there are more than `max_markers`.
  void remove_unpredictable(Timestamp t) {
    constexpr std::uint64_t kPredictable_us = 100000;
    std::erase_if(markers_,
                  [&](const auto& marker) { return elapsed_us(marker.tracker().estimate().t, t) > kPredictable_us; });
    if (markers_.size() > max_markers_)
      markers_.erase(markers_.begin(), markers_.end() - static_cast<std::ptrdiff_t>(max_markers_));
  }

  /// Removes the markers that were detected. One that only the detector's `search` found stays: it may be wrong, so it
  /// is searched again until `detect` finds it.
  void remove_detected(const DetectionResult& result) {
    std::erase_if(markers_, [&](const PlanarHypotheses<Rule>& marker) {
      return std::ranges::any_of(result.detected_markers(),
                                 [&](const auto& detected) { return detected.detection.id == marker.id(); });
    });
  }

  /// Adds the markers to a request, at the poses that are predicted for its time.
  void request_searches(DetectionRequest& request) const {
    for (const PlanarHypotheses<Rule>& marker : markers_)
      request.missing.push_back({marker.id(), marker.tracker().pose_at(request.t).T_camera_marker});
  }

 private:
  std::size_t max_markers_;
  std::vector<PlanarHypotheses<Rule>> markers_;
};

}  // namespace evmarker
