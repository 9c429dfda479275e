#pragma once
// The markers that are announced, and which of them an event may belong to.
#include <algorithm>
#include <array>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/matching/event_group.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/tracking/occlusion.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/tile_map.hpp"

namespace evmarker {

/// The announced markers. Gives each event to every marker whose edges may have made it, except those that another
/// marker covers at that pixel. `push` does so at once; `enqueue` and `flush` give each marker its events in groups.
template <PoseUpdateRule Rule>
class ConfirmedMarkers {
 public:
  ConfirmedMarkers(const UndistortionTable& lines_of_sight, std::size_t max_markers)
      : lines_of_sight_(lines_of_sight), tiles_(lines_of_sight, max_markers), inboxes_(max_markers) {
    markers_.reserve(max_markers);
  }

  /// There must be fewer than `max_markers`. Here and for `erase` and `remove_lost`, no events may be queued.
  void add(PlanarHypotheses<Rule> marker) {
    markers_.push_back(std::move(marker));
    update_all_tiles();
  }
  void erase(MarkerId id) {
    std::erase_if(markers_, [id](const auto& marker) { return marker.id() == id; });
    update_all_tiles();
  }

  /// Gives the event to its markers and calls `use(pose)` with each pose that it leads to.
  template <std::invocable<const PoseEstimate&> Use>
  void push(const Event& event, const Use& use) {
    const auto push_to = [&](std::size_t i) {
      const PoseEstimate* const pose = markers_[i].push(event);
      if (pose == nullptr) return;
      use(*pose);
      update_tiles(i);
    };
    if (tiles_.shared(event, lines_of_sight_)) [[unlikely]]
      for_each_visible_at(event, push_to);
    else
      tiles_.for_each_at(event, push_to);
  }

  /// Queues the event; its markers get it at the next `flush` at the latest. Where markers overlap, their poses decide
  /// which one hides which, so that queued events that may change one of these poses are flushed first.
  /// @param number of the event in its batch, below 65536, as 16 bits are kept; `use(pose, number)` is called with that
  /// of the event that led to the pose
  template <std::invocable<const PoseEstimate&, std::size_t> Use>
  void enqueue(const Event& event, std::size_t number, const Use& use) {
    if (tiles_.shared(event, lines_of_sight_)) [[unlikely]]
      return enqueue_where_shared(event, number, use);
    tiles_.for_each_at(event, [&](std::size_t i) { enqueue_for(i, event, number, use); });
  }

  /// Gives the markers their queued events, one marker after the other.
  template <std::invocable<const PoseEstimate&, std::size_t> Use>
  void flush(const Use& use) {
    for (std::size_t i = 0; i < markers_.size(); ++i) flush(i, use);
  }

  /// See MarkerTracker::skip.
  template <std::invocable<const PoseEstimate&> Use>
  void skip(std::chrono::microseconds missing, const Use& use) {
    for (PlanarHypotheses<Rule>& marker : markers_)
      if (const PoseEstimate* const lost = marker.skip(missing)) use(*lost);
    update_all_tiles();
  }

  /// See PlanarHypotheses::free_memory.
  void free_memory() noexcept {
    for (PlanarHypotheses<Rule>& marker : markers_) marker.free_memory();
  }

  /// Removes the markers that were lost: `use(marker)` may move them away.
  template <std::invocable<PlanarHypotheses<Rule>&> Use>
  void remove_lost(const Use& use) {
    const std::size_t before = markers_.size();
    for (auto marker = markers_.begin(); marker != markers_.end();) {
      if (marker->lost()) {
        use(*marker);
        marker = markers_.erase(marker);
      } else {
        ++marker;
      }
    }
    if (markers_.size() < before) update_all_tiles();
  }

  PlanarHypotheses<Rule>* find(MarkerId id) noexcept {
    const auto found = std::ranges::find(markers_, id, &PlanarHypotheses<Rule>::id);
    return found != markers_.end() ? &*found : nullptr;
  }

  const std::vector<PlanarHypotheses<Rule>>& all() const noexcept { return markers_; }
  std::size_t size() const noexcept { return markers_.size(); }
  bool empty() const noexcept { return markers_.empty(); }

 private:
  // The queued events of one marker. Small, so that those of many markers fit the first level cache.
  class Inbox {
   public:
    void push(const Event& event, std::size_t number) noexcept {
      numbers_[count_] = static_cast<std::uint16_t>(number);
      events_[count_++] = event;
    }
    void clear() noexcept { count_ = 0; }
    bool full() const noexcept { return count_ == events_.size(); }
    std::span<const Event> events() const noexcept { return std::span(events_).first(count_); }
    // Of one of `events()` itself, not of a copy: it is found by its address.
    std::size_t number(const Event& event) const noexcept {
      return numbers_[static_cast<std::size_t>(&event - events_.data())];
    }

   private:
    std::array<Event, EventGroup::kMost> events_{};
    std::array<std::uint16_t, EventGroup::kMost> numbers_{};
    std::size_t count_ = 0;
  };

  template <typename Use>
  [[gnu::noinline]] void flush(std::size_t i, const Use& use) {
    bool moved = false;
    markers_[i].push(inboxes_[i].events(), [&](const PoseEstimate& pose, const Event& event) {
      moved = true;
      use(pose, inboxes_[i].number(event));
    });
    if (moved) update_tiles(i);
    inboxes_[i].clear();
  }

  template <typename Use>
  [[gnu::always_inline]] void enqueue_for(std::size_t i, const Event& event, std::size_t number, const Use& use) {
    inboxes_[i].push(event, number);
    if (inboxes_[i].full()) [[unlikely]]
      flush(i, use);
  }
  template <typename Use>
  [[gnu::noinline]] void enqueue_where_shared(const Event& event, std::size_t number, const Use& use) {
    tiles_.for_each_at(event, [&](std::size_t i) { flush_if_pose_may_change(i, use); });
    for_each_visible_at(event, [&](std::size_t i) { enqueue_for(i, event, number, use); });
  }

  template <typename Use>
  void flush_if_pose_may_change(std::size_t i, const Use& use) {
    if (!markers_[i].unchanged_by_next(inboxes_[i].events().size())) flush(i, use);
  }

  // The tiles hold indices into markers_: after any change of it they are set up again.
  void update_all_tiles() {
    tiles_.resize(markers_.size());
    for (std::size_t i = 0; i < markers_.size(); ++i) update_tiles(i);
  }

  // Enters a marker into all tiles where it may have events or, if there are other markers, where its sheet may hide
  // theirs.
  void update_tiles(std::size_t i) noexcept { tiles_.move(i, markers_[i].reach(markers_.size() > 1 ? kQuietZone : 0)); }

  // Not inlined: most events belong to one marker only.
  template <typename Use>
  [[gnu::noinline]] void for_each_visible_at(const Event& event, const Use& use) {
    const Eigen::Vector2d m = lines_of_sight_(event);
    double nearest_inverse_depth = 0;
    tiles_.for_each_at(event, [&](std::size_t i) {
      nearest_inverse_depth = std::max(nearest_inverse_depth, sheet_inverse_depth(markers_[i].tracker(), m));
    });
    tiles_.for_each_at(event, [&](std::size_t i) {
      if (!hidden_by(nearest_inverse_depth, markers_[i].tracker(), m)) use(i);
    });
  }

  UndistortionTable lines_of_sight_;
  TileMap tiles_;
  std::vector<PlanarHypotheses<Rule>> markers_;
  std::vector<Inbox> inboxes_;  // by index into markers_, empty whenever that changes
};

}  // namespace evmarker
