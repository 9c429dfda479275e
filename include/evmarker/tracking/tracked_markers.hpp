#pragma once
// The markers that are being tracked, and which of them an event may belong to.
#include <algorithm>
#include <array>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/matching/event_group.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/tracking/found_marker.hpp"
#include "evmarker/tracking/paper.hpp"
#include "evmarker/tracking/tile_map.hpp"

namespace evmarker {

/// Gives every event to the markers that it may belong to and that no other one hides there, at once, or together with
/// others that come for them.
template <PoseUpdateRule Rule>
class TrackedMarkers {
 public:
  TrackedMarkers(const UndistortionTable& lines, std::size_t max_markers)
      : lines_(lines), tiles_(lines), inboxes_(max_markers) {
    markers_.reserve(max_markers);
  }

  void add(FoundMarker<Rule> marker) {
    markers_.push_back(std::move(marker));
    place_all();
  }
  void erase(MarkerId id) {
    std::erase_if(markers_, [id](const auto& marker) { return marker.id() == id; });
    place_all();
  }

  /// Calls `use(pose)` with each pose that the event leads to.
  template <std::invocable<const PoseEstimate&> Use>
  void push(const Event& event, const Use& use) {
    const auto push_to = [&](std::size_t i) {
      const PoseEstimate* const pose = markers_[i].push(event);
      if (pose == nullptr) return;
      use(*pose);
      place(i);
    };
    if (tiles_.shared(event, lines_)) [[unlikely]]
      for_each_visible_at(event, push_to);
    else
      tiles_.for_each_at(event, push_to);
  }

  /// The same later, at `push_waiting` at the latest. Where markers meet, whose an event is depends on where they are
  /// by now: those that may move with the events that wait take these first.
  template <std::invocable<const PoseEstimate&> Use>
  void push_soon(const Event& event, const Use& use) {
    if (tiles_.shared(event, lines_)) [[unlikely]]
      return keep_where_markers_meet(event, use);
    tiles_.for_each_at(event, [&](std::size_t i) { keep(i, event, use); });
  }

  /// Gives the markers the events that wait, one marker after the other.
  template <std::invocable<const PoseEstimate&> Use>
  void push_waiting(const Use& use) {
    for (std::size_t i = 0; i < markers_.size(); ++i) push_waiting(i, use);
  }

  /// Only to those whom the events that wait may move, or lose.
  template <std::invocable<const PoseEstimate&> Use>
  void push_decisive(const Use& use) {
    for (std::size_t i = 0; i < markers_.size(); ++i) push_decisive(i, use);
  }

  /// See MarkerTracker::skip.
  template <std::invocable<const PoseEstimate&> Use>
  void skip(std::chrono::microseconds missing, const Use& use) {
    for (FoundMarker<Rule>& marker : markers_)
      if (const PoseEstimate* const lost = marker.skip(missing)) use(*lost);
    place_all();
  }

  /// Removes the markers that were lost: `use(marker)` may move them away.
  template <std::invocable<FoundMarker<Rule>&> Use>
  void remove_lost(const Use& use) {
    for (FoundMarker<Rule>& marker : markers_)
      if (marker.lost()) use(marker);
    if (std::erase_if(markers_, [](const auto& marker) { return marker.lost(); }) > 0) place_all();
  }

  FoundMarker<Rule>* find(MarkerId id) noexcept {
    const auto found = std::ranges::find(markers_, id, &FoundMarker<Rule>::id);
    return found != markers_.end() ? &*found : nullptr;
  }

  const std::vector<FoundMarker<Rule>>& all() const noexcept { return markers_; }
  std::size_t size() const noexcept { return markers_.size(); }
  bool empty() const noexcept { return markers_.empty(); }
  bool any_lost() const noexcept { return std::ranges::any_of(markers_, &FoundMarker<Rule>::lost); }

 private:
  // Events of one marker: a group. Small, so that those of many markers fit the first level cache.
  class Inbox {
   public:
    void push(const Event& event) noexcept { events_[count_++] = event; }
    void clear() noexcept { count_ = 0; }
    bool full() const noexcept { return count_ == events_.size(); }
    std::span<const Event> events() const noexcept { return std::span(events_).first(count_); }

   private:
    std::array<Event, EventGroup::kMost> events_{};
    std::size_t count_ = 0;
  };

  template <typename Use>
  [[gnu::noinline]] void push_waiting(std::size_t i, const Use& use) {
    bool moved = false;
    markers_[i].push(inboxes_[i].events(), [&](const PoseEstimate& pose) {
      moved = true;
      use(pose);
    });
    inboxes_[i].clear();
    if (moved) place(i);
  }

  template <typename Use>
  [[gnu::always_inline]] void keep(std::size_t i, const Event& event, const Use& use) {
    inboxes_[i].push(event);
    if (inboxes_[i].full()) [[unlikely]]
      push_waiting(i, use);
  }
  template <typename Use>
  [[gnu::noinline]] void keep_where_markers_meet(const Event& event, const Use& use) {
    tiles_.for_each_at(event, [&](std::size_t i) { push_decisive(i, use); });
    for_each_visible_at(event, [&](std::size_t i) { keep(i, event, use); });
  }

  template <typename Use>
  void push_decisive(std::size_t i, const Use& use) {
    if (!markers_[i].stays(inboxes_[i].events().size())) push_waiting(i, use);
  }

  // Enters all markers into the tiles anew: their places in the list have changed.
  void place_all() {
    tiles_.resize(markers_.size());
    for (std::size_t i = 0; i < markers_.size(); ++i) place(i);
  }

  // Where it may have events, and where its paper may hide other markers.
  void place(std::size_t i) noexcept { tiles_.move(i, markers_[i].reach(markers_.size() > 1 ? kPaperRim : 0)); }

  // Not inline, for the sake of the events that only one marker may have.
  template <typename Use>
  [[gnu::noinline]] void for_each_visible_at(const Event& event, const Use& use) {
    const Eigen::Vector2d m = lines_(event);
    double nearest = 0;
    tiles_.for_each_at(event,
                       [&](std::size_t i) { nearest = std::max(nearest, paper_nearness(markers_[i].tracker(), m)); });
    tiles_.for_each_at(event, [&](std::size_t i) {
      if (!hidden_by(nearest, markers_[i].tracker(), m)) use(i);
    });
  }

  UndistortionTable lines_;
  TileMap tiles_;
  std::vector<FoundMarker<Rule>> markers_;
  std::vector<Inbox> inboxes_;
};

}  // namespace evmarker
