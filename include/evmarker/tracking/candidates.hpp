#pragma once
// Markers that were found some events ago: they catch up with them, and wait to be seen again.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "evmarker/detection/look.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/tracking/found_marker.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// Tracked from the look on in which it was found, but not announced before more looks have shown its code where the
/// tracker has it.
template <PoseUpdateRule Rule>
class Candidate {
 public:
  /// @param position in the history of the look; the events from there until now are replayed
  Candidate(FoundMarker<Rule> marker, std::uint64_t position, const EventHistory& history)
      : marker_(std::move(marker)), next_(position), found_at_(history.pushed()) {}

  /// Takes at most so many events that it has not seen yet. A few for every event that comes, so that the answer of a
  /// slow detector does not hold up the markers that are being tracked.
  void catch_up(const EventHistory& history, int events, TrackerStatistics& statistics) {
    if (!history.reaches(next_)) {
      ++statistics.replays_cut;
      next_ = history.pushed() - history.size();
    }
    for (; events > 0 && !caught_up(history); --events) {
      statistics.replayed += next_ < found_at_;
      marker_.push(history.at(next_++));
    }
  }
  bool caught_up(const EventHistory& history) const noexcept { return next_ == history.pushed(); }

  /// Whether a look at the frame as it is now can be asked for the code. It is remembered until the next one.
  bool ask(const EventHistory& history) noexcept { return asked_ = caught_up(history); }
  bool asked() const noexcept { return asked_; }
  void answer(Sighting sighting) noexcept {
    ++looks_;
    sightings_ += sighting == Sighting::there;
    elsewhere_ = sighting == Sighting::elsewhere;
  }
  int sightings() const noexcept { return sightings_; }
  bool hopeless() const noexcept { return marker_.lost() || elsewhere_ || looks_ > kPatience; }

  FoundMarker<Rule>& marker() noexcept { return marker_; }
  const FoundMarker<Rule>& marker() const noexcept { return marker_; }

 private:
  static constexpr int kPatience = 10;  // [looks]

  FoundMarker<Rule> marker_;
  std::uint64_t next_;      // position of the next event to take
  std::uint64_t found_at_;  // position of the first event that came after the answer
  bool asked_ = false, elsewhere_ = false;
  int sightings_ = 1;
  int looks_ = 1;
};

/// All of them.
template <PoseUpdateRule Rule>
class Candidates {
 public:
  explicit Candidates(std::size_t max_markers) { candidates_.reserve(max_markers); }

  bool empty() const noexcept { return candidates_.empty(); }
  std::size_t size() const noexcept { return candidates_.size(); }
  void add(Candidate<Rule> candidate) { candidates_.push_back(std::move(candidate)); }
  void erase(MarkerId id) {
    std::erase_if(candidates_, [id](const auto& candidate) { return candidate.marker().id() == id; });
  }
  const FoundMarker<Rule>* find(MarkerId id) const noexcept {
    const auto found = std::ranges::find(candidates_, id, [](const auto& c) { return c.marker().id(); });
    return found != candidates_.end() ? &found->marker() : nullptr;
  }

  bool caught_up(const EventHistory& history) const noexcept {
    return std::ranges::all_of(candidates_, [&](const auto& candidate) { return candidate.caught_up(history); });
  }
  /// See Candidate::catch_up: so many events each.
  void catch_up(const EventHistory& history, int events, TrackerStatistics& statistics) {
    for (Candidate<Rule>& candidate : candidates_) candidate.catch_up(history, events, statistics);
  }
  /// See MarkerTracker::skip. Those that have events from before to catch up with are given up.
  void skip(std::chrono::microseconds missing, const EventHistory& history) {
    std::erase_if(candidates_, [&](Candidate<Rule>& candidate) {
      candidate.marker().skip(missing);
      return !candidate.caught_up(history);
    });
  }

  /// Has a look ask for their codes.
  void ask(Look& look, const EventHistory& history) {
    for (Candidate<Rule>& candidate : candidates_)
      if (candidate.ask(history))
        look.unconfirmed.push_back({candidate.marker().id(), candidate.marker().tracker().T_camera_marker()});
  }
  /// What the look says of those that it was asked about. None of them has been taken since.
  void answer(const Findings& findings) {
    std::size_t place = 0;
    for (Candidate<Rule>& candidate : candidates_)
      if (candidate.asked()) {
        candidate.answer(place < findings.sightings.size() ? findings.sightings[place] : Sighting::none);
        ++place;
      }
  }
  void remove_hopeless() {
    std::erase_if(candidates_, [](const auto& candidate) { return candidate.hopeless(); });
  }

  /// Removes those that were seen so often and have seen all events: `use(marker)` may move them away.
  template <std::invocable<FoundMarker<Rule>&> Use>
  void take_confirmed(int sightings, const EventHistory& history, const Use& use) {
    std::erase_if(candidates_, [&](Candidate<Rule>& candidate) {
      if (candidate.marker().lost() || candidate.sightings() < sightings || !candidate.caught_up(history)) return false;
      use(candidate.marker());
      return true;
    });
  }

 private:
  std::vector<Candidate<Rule>> candidates_;
};

}  // namespace evmarker
