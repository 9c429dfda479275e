#pragma once
// Markers that were detected but not announced yet: they catch up with the events since, and wait to be seen again.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// A marker that is tracked from the frame on in which it was detected, but not announced before more frames have shown
/// its code where it is tracked.
template <PoseUpdateRule Rule>
class TentativeMarker {
 public:
  /// @param position of the detection's frame in the history; the events from there on are replayed
  TentativeMarker(PlanarHypotheses<Rule> marker, std::uint64_t position, const EventHistory& history)
      : marker_(std::move(marker)), next_(position), detected_at_(history.pushed()) {}

  /// Replays at most `events` events of the history. A few for every new event, so that a slow detector's result does
  /// not hold up the markers that are being tracked.
  void catch_up(const EventHistory& history, int events, TrackerStatistics& statistics) {
    if (!history.reaches(next_)) {
      ++statistics.replays_cut;
      next_ = history.pushed() - history.size();
    }
    for (; events > 0 && !caught_up(history); --events) {
      statistics.replayed += next_ < detected_at_;
      const Event event = history.at(next_++);
      marker_.push(std::span(&event, 1), [](const PoseEstimate&) {});
    }
  }
  bool caught_up(const EventHistory& history) const noexcept { return next_ == history.pushed(); }

  /// Begins a sighting, if the tracker is where the present frame should show the marker. False otherwise.
  bool request_sighting(const EventHistory& history) noexcept { return requested_ = caught_up(history); }
  bool sighting_requested() const noexcept { return requested_; }
  void add(Sighting sighting) noexcept {
    ++frames_;
    sightings_ += sighting == Sighting::there;
    elsewhere_ = sighting == Sighting::elsewhere;
  }
  int sightings() const noexcept { return sightings_; }
  bool hopeless() const noexcept { return marker_.lost() || elsewhere_ || frames_ > kPatience; }

  PlanarHypotheses<Rule>& marker() noexcept { return marker_; }
  const PlanarHypotheses<Rule>& marker() const noexcept { return marker_; }

 private:
  static constexpr int kPatience = 10;  // [frames]

  PlanarHypotheses<Rule> marker_;
  std::uint64_t next_;         // position of the next event to replay
  std::uint64_t detected_at_;  // position of the first event after the detector's result
  bool requested_ = false, elsewhere_ = false;
  int sightings_ = 1;
  int frames_ = 1;
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

  bool caught_up(const EventHistory& history) const noexcept {
    return std::ranges::all_of(markers_, [&](const auto& tentative) { return tentative.caught_up(history); });
  }
  /// See TentativeMarker::catch_up; `events` for each marker.
  void catch_up(const EventHistory& history, int events, TrackerStatistics& statistics) {
    for (TentativeMarker<Rule>& tentative : markers_) tentative.catch_up(history, events, statistics);
  }
  /// See MarkerTracker::skip. Markers that have not caught up are dropped.
  void skip(std::chrono::microseconds missing, const EventHistory& history) {
    std::erase_if(markers_, [&](TentativeMarker<Rule>& tentative) {
      tentative.marker().skip(missing);
      return !tentative.caught_up(history);
    });
  }

  /// Adds the markers that have caught up to a request.
  void request_sightings(DetectionRequest& request, const EventHistory& history) {
    for (TentativeMarker<Rule>& tentative : markers_)
      if (tentative.request_sighting(history))
        request.unconfirmed.push_back({tentative.marker().id(), tentative.marker().tracker().T_camera_marker()});
  }
  /// Adds the sightings of the last request; no marker was added or removed in between.
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

  /// Removes the markers that have had `sightings` and have caught up: `use(marker)` may move them away.
  template <std::invocable<PlanarHypotheses<Rule>&> Use>
  void release_confirmed(int sightings, const EventHistory& history, const Use& use) {
    std::erase_if(markers_, [&](TentativeMarker<Rule>& tentative) {
      if (tentative.marker().lost() || tentative.sightings() < sightings || !tentative.caught_up(history)) return false;
      use(tentative.marker());
      return true;
    });
  }

 private:
  std::vector<TentativeMarker<Rule>> markers_;
};

}  // namespace evmarker
