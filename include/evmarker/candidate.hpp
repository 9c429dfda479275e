#pragma once
// Floor 8. A marker that was found some events ago: catches up with them, and waits to be seen again.
#include <cstdint>
#include <utility>

#include "evmarker/event_history.hpp"
#include "evmarker/found_marker.hpp"
#include "evmarker/tracker_settings.hpp"

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
  void answer(bool shown) noexcept {
    ++looks_;
    sightings_ += shown;
  }
  int sightings() const noexcept { return sightings_; }
  bool hopeless() const noexcept { return marker_.lost() || looks_ > kPatience; }

  FoundMarker<Rule>& marker() noexcept { return marker_; }
  const FoundMarker<Rule>& marker() const noexcept { return marker_; }

 private:
  static constexpr int kPatience = 10;  // [looks]

  FoundMarker<Rule> marker_;
  std::uint64_t next_;      // position of the next event to take
  std::uint64_t found_at_;  // position of the first event that came after the answer
  bool asked_ = false;
  int sightings_ = 1;
  int looks_ = 1;
};

}  // namespace evmarker
