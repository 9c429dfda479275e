#pragma once
// The markers that are announced, and which of them an event may belong to.
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
#include "evmarker/tracking/occlusion.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/tile_map.hpp"

namespace evmarker {

/// Gives every event to the markers that it may belong to and that no other marker hides there: at once, or in groups.
template <PoseUpdateRule Rule>
class ConfirmedMarkers {
 public:
  ConfirmedMarkers(const UndistortionTable& lines, std::size_t max_markers)
      : lines_(lines), tiles_(lines), inboxes_(max_markers) {
    markers_.reserve(max_markers);
  }

  void add(PlanarHypotheses<Rule> marker) {
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
    const auto push_to = [&](std::size_t i) { push_to_marker(i, std::span(&event, 1), use); };
    if (tiles_.shared(event, lines_)) [[unlikely]]
      for_each_visible_at(event, push_to);
    else
      tiles_.for_each_at(event, push_to);
  }

  /// The same in groups, at the next `push_waiting` at the latest. Where markers meet, whose event it is depends on
  /// their present poses: a marker that its waiting events may move takes these first.
  template <std::invocable<const PoseEstimate&> Use>
  void push_soon(const Event& event, const Use& use) {
    if (tiles_.shared(event, lines_)) [[unlikely]]
      return keep_where_markers_meet(event, use);
    tiles_.for_each_at(event, [&](std::size_t i) { keep(i, event, use); });
  }

  /// Gives the markers their waiting events, one marker after the other.
  template <std::invocable<const PoseEstimate&> Use>
  void push_waiting(const Use& use) {
    for (std::size_t i = 0; i < markers_.size(); ++i) push_waiting(i, use);
  }

  /// The same for those markers only that these events may move, or lose.
  template <std::invocable<const PoseEstimate&> Use>
  void push_decisive(const Use& use) {
    for (std::size_t i = 0; i < markers_.size(); ++i) push_decisive(i, use);
  }

  /// See MarkerTracker::skip.
  template <std::invocable<const PoseEstimate&> Use>
  void skip(std::chrono::microseconds missing, const Use& use) {
    for (PlanarHypotheses<Rule>& marker : markers_)
      if (const PoseEstimate* const lost = marker.skip(missing)) use(*lost);
    place_all();
  }

  /// Removes the markers that were lost: `use(marker)` may move them away.
  template <std::invocable<PlanarHypotheses<Rule>&> Use>
  void remove_lost(const Use& use) {
    for (PlanarHypotheses<Rule>& marker : markers_)
      if (marker.lost()) use(marker);
    if (std::erase_if(markers_, [](const auto& marker) { return marker.lost(); }) > 0) place_all();
  }

  PlanarHypotheses<Rule>* find(MarkerId id) noexcept {
    const auto found = std::ranges::find(markers_, id, &PlanarHypotheses<Rule>::id);
    return found != markers_.end() ? &*found : nullptr;
  }

  const std::vector<PlanarHypotheses<Rule>>& all() const noexcept { return markers_; }
  std::size_t size() const noexcept { return markers_.size(); }
  bool empty() const noexcept { return markers_.empty(); }
  bool any_lost() const noexcept { return std::ranges::any_of(markers_, &PlanarHypotheses<Rule>::lost); }

 private:
  // The waiting events of one marker. Small, so that those of many markers fit the first level cache.
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
  void push_to_marker(std::size_t i, std::span<const Event> events, const Use& use) {
    bool moved = false;
    markers_[i].push(events, [&](const PoseEstimate& pose) {
      moved = true;
      use(pose);
    });
    if (moved) place(i);
  }

  template <typename Use>
  [[gnu::noinline]] void push_waiting(std::size_t i, const Use& use) {
    push_to_marker(i, inboxes_[i].events(), use);
    inboxes_[i].clear();
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

  // After any change of the list: the tiles hold places in it.
  void place_all() {
    tiles_.resize(markers_.size());
    for (std::size_t i = 0; i < markers_.size(); ++i) place(i);
  }

  // Enters where it may have events, and where its sheet may hide other markers.
  void place(std::size_t i) noexcept { tiles_.move(i, markers_[i].reach(markers_.size() > 1 ? kSheetRim : 0)); }

  // Not inlined: most events belong to one marker only.
  template <typename Use>
  [[gnu::noinline]] void for_each_visible_at(const Event& event, const Use& use) {
    const Eigen::Vector2d m = lines_(event);
    double nearest = 0;
    tiles_.for_each_at(
        event, [&](std::size_t i) { nearest = std::max(nearest, sheet_inverse_depth(markers_[i].tracker(), m)); });
    tiles_.for_each_at(event, [&](std::size_t i) {
      if (!hidden_by(nearest, markers_[i].tracker(), m)) use(i);
    });
  }

  UndistortionTable lines_;
  TileMap tiles_;
  std::vector<PlanarHypotheses<Rule>> markers_;
  std::vector<Inbox> inboxes_;
};

}  // namespace evmarker
