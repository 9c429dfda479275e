#pragma once
// Nearest model edge of an event by the fastest way that the model allows.
#include <cstddef>
#include <optional>
#include <utility>

#include "evmarker/matching/board_matcher.hpp"
#include "evmarker/matching/grid_matcher.hpp"

namespace evmarker {

/// Matches like SegmentMatcher: a code marker by its grid, a board marker by marker, any other wireframe by the search
/// over all segments.
class ModelMatcher {
 public:
  /// @throws std::invalid_argument like SegmentMatcher
  ModelMatcher(MarkerModel model, double focal_length, const SegmentMatcherSettings& settings = {})
      : grid_(std::move(model), focal_length, settings),
        board_(BoardMatcher::of(grid_.model(), focal_length, settings)) {}

  /// See GridMatcher::set_max_distance_px.
  void set_max_distance_px(double distance_px) noexcept {
    grid_.set_max_distance_px(distance_px);
    if (board_) board_->set_max_distance_px(distance_px);
  }
  /// See SegmentMatcher::project.
  bool project(const Eigen::Isometry3d& T_camera_model) noexcept {
    return board_ ? board_->project(T_camera_model) : grid_.project(T_camera_model);
  }
  /// See GridMatcher::move.
  bool move(const Eigen::Isometry3d& T_camera_model, double max_shift_px) noexcept {
    return board_ ? board_->move(T_camera_model, max_shift_px) : grid_.move(T_camera_model, max_shift_px);
  }
  /// See GridMatcher::times_edges_chosen.
  unsigned times_edges_chosen() const noexcept {
    return board_ ? board_->times_edges_chosen() : grid_.times_edges_chosen();
  }
  /// See SegmentMatcher::match.
  MatchResult match(Vec2 m, Correspondence& correspondence) const noexcept {
    return board_ ? board_->match(m, correspondence) : grid_.match(m, correspondence);
  }
  /// See GridMatcher::reach.
  Box reach(double border_cells = 0) const noexcept {
    return board_ ? board_->reach(border_cells) : grid_.reach(border_cells);
  }

  /// The matcher of a model that is no board; that of a board is never `on_grid()`.
  const GridMatcher& grid() const noexcept { return grid_; }
  /// The grid of a code marker, number 0, or of a marker of a board.
  const ProjectedGrid& projected(std::size_t number) const noexcept {
    return board_ ? board_->marker(number).matcher.projected() : grid_.projected();
  }
  /// Null if the model is no board.
  const BoardMatcher* board() const noexcept { return board_ ? &*board_ : nullptr; }
  const MarkerModel& model() const noexcept { return grid_.model(); }
  double focal_length() const noexcept { return grid_.focal_length(); }
  double max_distance_px() const noexcept { return grid_.max_distance_px(); }
  /// See GridMatcher::cell_px.
  double cell_px() const noexcept { return board_ ? board_->cell_px() : grid_.cell_px(); }

 private:
  GridMatcher grid_;  // has the model, also that of a board
  std::optional<BoardMatcher> board_;
};

}  // namespace evmarker
