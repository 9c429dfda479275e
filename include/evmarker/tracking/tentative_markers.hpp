#pragma once
// Markers that were detected but not announced yet: they catch up with the events since, and wait to be seen again.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// A detected marker that is already tracked, from the frame of its detection on, but whose poses are withheld until
/// later frames show its code at the tracked pose.
template <PoseUpdateRule Rule>
class TentativeMarker {
 public:
  /// @param first_after_frame number in the history of the first event after the detection's frame
  TentativeMarker(PlanarHypotheses<Rule> marker, std::uint64_t first_after_frame, const EventHistory& history)
      : marker_(std::move(marker)), next_(first_after_frame), result_at_(history.pushed()) {}

  /// Gives the tracker the next events of the history, at most `events`. All events of a tentative marker come from
  /// there, so that it gets only those that have passed the noise filter. To be called with few for each new event, so
  /// that replaying does not hold up the markers that are being tracked.
  void catch_up(const EventHistory& history, int events, TrackerStatistics& statistics) {
    if (!history.reaches(next_)) {
      ++statistics.replays_cut;
      next_ = history.pushed() - history.size();
    }
    for (; events > 0 && !caught_up(history); --events) {
      statistics.replayed += next_ < result_at_;
      marker_.push(history.at(next_++));
    }
  }
  bool caught_up(const EventHistory& history) const noexcept { return next_ == history.pushed(); }

  /// True if the next frame should be checked for its code: if it has caught up, so that its pose is that of the frame.
  bool request_sighting(const EventHistory& history) noexcept {
    requested_ = caught_up(history);
    return requested_;
  }
  bool sighting_requested() const noexcept { return requested_; }
  void add(Sighting sighting) noexcept {
    ++frames_;
    sightings_ += sighting == Sighting::there;
    wrong_tilt_ = sighting == Sighting::wrong_tilt;
  }
  int sightings() const noexcept { return sightings_; }
  bool hopeless() const noexcept { return marker_.lost() || wrong_tilt_ || frames_ > kMostFrames; }

  PlanarHypotheses<Rule>& marker() noexcept { return marker_; }
  const PlanarHypotheses<Rule>& marker() const noexcept { return marker_; }

 private:
  static constexpr int kMostFrames = 10;  // without enough sightings

  PlanarHypotheses<Rule> marker_;
  std::uint64_t next_;       // number of the next event to replay
  std::uint64_t result_at_;  // of the first event after the detector's result: those before it count as replayed
  bool requested_ = false, wrong_tilt_ = false;
  int sightings_ = 1, frames_ = 1;  // the first is the detection
};

template <PoseUpdateRule Rule>
class TentativeMarkers {
 public:
  explicit TentativeMarkers(std::size_t max_markers) { markers_.reserve(max_markers); }

  bool empty() const noexcept { return markers_.empty(); }
  std::size_t size() const noexcept { return markers_.size(); }
  void add(TentativeMarker<Rule> marker) { markers_.push_back(std::move(marker)); }
  void erase(MarkerId id) {
    std::erase_if(markers_, [id](const auto& tentative) { return tentative.marker().id() == id; });
  }
  const PlanarHypotheses<Rule>* find(MarkerId id) const noexcept {
    const auto found = std::ranges::find(markers_, id, [](const auto& tentative) { return tentative.marker().id(); });
    return found != markers_.end() ? &found->marker() : nullptr;
  }

  template <std::invocable<const PlanarHypotheses<Rule>&> Use>
  void for_each(const Use& use) const {
    for (const TentativeMarker<Rule>& tentative : markers_) use(tentative.marker());
  }

  bool caught_up(const EventHistory& history) const noexcept {
    return std::ranges::all_of(markers_, [&](const auto& tentative) { return tentative.caught_up(history); });
  }
  /// See TentativeMarker::catch_up; `events` for each marker.
  void catch_up(const EventHistory& history, int events, TrackerStatistics& statistics) {
    for (TentativeMarker<Rule>& tentative : markers_) tentative.catch_up(history, events, statistics);
  }
  /// See MarkerTracker::skip. Markers that have not caught up are dropped.
  void skip(std::chrono::microseconds missing, const EventHistory& history) {
    for (TentativeMarker<Rule>& tentative : markers_) tentative.marker().skip(missing);
    std::erase_if(markers_, [&](const auto& tentative) { return !tentative.caught_up(history); });
  }

  /// Adds the markers that have caught up to a request.
  void request_sightings(DetectionRequest& request, const EventHistory& history) {
    for (TentativeMarker<Rule>& tentative : markers_)
      if (tentative.request_sighting(history))
        request.unconfirmed.push_back({tentative.marker().id(), tentative.marker().tracker().T_camera_marker()});
  }
  /// Adds the sightings of the last request, in its order: since then, none of its markers may have been removed.
  void add(const std::vector<Sighting>& sightings) {
    std::size_t i = 0;
    for (TentativeMarker<Rule>& tentative : markers_)
      if (tentative.sighting_requested()) {
        tentative.add(i < sightings.size() ? sightings[i] : Sighting::none);
        ++i;
      }
  }
  void remove_hopeless() {
    std::erase_if(markers_, [](const auto& tentative) { return tentative.hopeless(); });
  }

  /// Removes the markers with at least `sightings` sightings that have caught up and are not lost. `use(marker)` is
  /// called with each before, and may move from it.
  template <std::invocable<PlanarHypotheses<Rule>&> Use>
  void release_confirmed(int sightings, const EventHistory& history, const Use& use) {
    for (auto tentative = markers_.begin(); tentative != markers_.end();) {
      PlanarHypotheses<Rule>& marker = tentative->marker();
      if (marker.lost() || tentative->sightings() < sightings || !tentative->caught_up(history)) {
        ++tentative;
      } else {
        use(marker);
        tentative = markers_.erase(tentative);
      }
    }
  }

 private:
  std::vector<TentativeMarker<Rule>> markers_;
};

}  // namespace evmarker
