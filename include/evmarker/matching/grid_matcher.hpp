#pragma once
// Nearest model edge of an event in constant time: code markers through the grid of their cells.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "evmarker/matching/grid_correspondence.hpp"
#include "evmarker/matching/grid_edges.hpp"
#include "evmarker/matching/nearest_lines.hpp"
#include "evmarker/matching/projected_grid.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/simd/wide_vectors.hpp"

namespace evmarker {

/// Matches like SegmentMatcher: after `project` with the same result for every event, after `move` nearly so. On a code
/// marker it need not go through all segments: the inverse homography takes the event into the marker's grid, where
/// rounding gives the nearest vertical and horizontal line, and a table has their edges. Other wireframes, and poses at
/// which more lines than these two may be within reach (cells smaller than about 4.5 px, markers seen edge-on), are
/// left to the SegmentMatcher.
class GridMatcher {
 public:
  using Stretch = GridEdges::Stretch;  ///< a piece of a grid line with the edge on it, if any

  /// @throws std::invalid_argument like SegmentMatcher
  GridMatcher(MarkerModel model, double focal_length, SegmentMatcherSettings settings = {})
      : segments_(std::move(model), focal_length, settings),
        grid_(GridEdges::of(segments_.model())),
        focal_length_(focal_length),
        end_margin_(settings.end_margin_px / focal_length),
        ambiguity_(settings.ambiguity_px / focal_length) {
    set_max_distance_px(settings.max_distance_px);
    if (!(settings.ambiguity_px > 1e-6))
      grid_.reset();  // then rounding decides ties in SegmentMatcher, which the grid cannot reproduce
    if (!grid_) return;
    projected_ = ProjectedGrid(grid_->cells(), grid_->cell_length_m());
    stretches_of_line_ = grid_->stretches_of_line();
    first_stretch_ = {2, 2 + (grid_->cells() + 1) * stretches_of_line_};
  }

  /// Sets another maximal distance: at once for what matches, from the next `project` on for what is near. Until then
  /// it must not be longer than 0.3 cells, see `cell_px`: an edge on a third line could match.
  void set_max_distance_px(double distance_px) noexcept {
    segments_.set_max_distance_px(distance_px);
    max_distance_ = distance_px / focal_length_;
    match_reach_ = std::hypot(max_distance_ + ambiguity_, end_margin_);
    near_reach_ = std::hypot(3 * max_distance_, end_margin_);
    limit2_ = max_distance_ * max_distance_;
    // rival_factor_ d^2 + rival_offset_ >= (d + ambiguity)^2 for every d, equal at half the maximal distance:
    // compares with the runner-up without a square root.
    rival_factor_ = 1 + 2 * ambiguity_ / max_distance_;
    rival_offset_ = ambiguity_ * (max_distance_ / 2 + ambiguity_);
    rate_ = 0;  // the bounds that follow from it are updated with the next `project`
  }

  /// Sets the pose. False, and no event matches, while the model is not wholly in front of the camera, shows no edge,
  /// or is not finite.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    on_grid_ = grid_ && projected_.project(T_camera_marker) && update_bounds();
    if (on_grid_) {
      edge_choice_grid_ = projected_;
      edge_choice_corners_ = edge_choice_grid_.corners();
    }
    ++times_edges_chosen_;
    return on_grid_ || segments_.project(T_camera_marker);
  }

  /// Sets the pose. While no corner has moved by `max_shift_px` since the last `project`, it is still decided at that
  /// pose which edge an event matches, if any, and only the distance to it is taken at the new one; otherwise the same
  /// as `project`.
  bool move(const Eigen::Isometry3d& T_camera_marker, double max_shift_px) noexcept {
    if (on_grid_ && projected_.project(T_camera_marker) &&
        projected_.near(edge_choice_corners_, max_shift_px / focal_length_)) [[likely]]
      return true;
    return project(T_camera_marker);
  }
  /// A counter that changes whenever edges are chosen at a new pose, by `project`, or by `move` beyond its limit.
  unsigned times_edges_chosen() const noexcept { return times_edges_chosen_; }

  /// Finds the segment of an event with line of sight (m; 1): see SegmentMatcher::match.
  MatchResult match(Vec2 m, Correspondence& correspondence) const noexcept {
    if (!on_grid_) return segments_.match(m, correspondence);
    const Choice choice = choose(m);
    return choice.result == MatchResult::matched ? correspond(*choice.edge, m, correspondence) : choice.result;
  }

  /// The edge that an event matches on the grid.
  struct Choice {
    MatchResult result = MatchResult::matched;
    const Stretch* edge = nullptr;  ///< of a matched event
  };

  /// True if an event may be near an edge; false if it is far from all of them. Requires `on_grid()`.
  [[gnu::always_inline]] bool reaches(Vec2 m) const noexcept {
    return edge_choice_grid_.within(fringe_, edge_choice_grid_.grid_point(m));
  }

  /// Finds only the edge, without the points in space; requires `on_grid()`.
  [[gnu::always_inline]] Choice choose(Vec2 m) const noexcept {
    const GridPoint at = edge_choice_grid_.grid_point(m);
    if (!edge_choice_grid_.within(fringe_, at)) return {MatchResult::far};
    const Lines lines = edge_choice_grid_.nearest_lines(at);
    Choice choice;
    if (try_choose(lines, choice)) [[likely]]
      return choice;
    return choose_exactly(at, lines);
  }

  /// What `choose_many` finds for each event: the number of its `stretch`, or one of the negative codes. Ambiguous
  /// events are kUnsure.
  struct Choices {
    static constexpr int kUnsure = -1, kNear = -2, kFar = -3;  ///< kUnsure: `choose_exactly` decides
    static constexpr std::size_t kMost = NearestLines::kMost;
    alignas(64) std::array<int, kMost> stretch;
  };

  /// Batch version of `choose`, for `count` events from `first` on, at most Choices::kMost; requires `on_grid()`. Up to
  /// the next multiple of simd::kLanes, results are written that mean nothing.
  void choose_many(const EventGroup& events, std::size_t first, std::size_t count, Choices& choices) const noexcept {
    NearestLines lines;
    simd::in_wide_vectors([&]() __attribute__((always_inline)) {
      // Copies: the compiler cannot know that writing the results leaves the originals as they are.
      const GridView view = this->view();
      const StretchTable table = this->table();
      const Limits limits = this->limits();
      nearest_lines(
          [view](std::size_t) __attribute__((always_inline))->const GridView& { return view; }, &events.x[first],
          &events.y[first], count, lines);
      for (std::size_t from = 0; from < count; from += simd::kLanes)
        simd::for_each_lane([&](std::size_t lane) __attribute__((always_inline)) {
          choices.stretch[from + lane] = choose_one(lines, from + lane, table, limits);
        });
    });
  }

  /// What the batch versions of `choose` need: the grid at the pose at which edges are chosen, where its stretches are,
  /// and the limits of distances.
  [[gnu::always_inline]] GridView view() const noexcept {
    return {edge_choice_grid_.row(0),
            edge_choice_grid_.row(1),
            edge_choice_grid_.row_w(),
            edge_choice_grid_.cells(),
            edge_choice_grid_.cells() / 2 + fringe_,
            end_margin_cells_};
  }
  struct StretchTable {
    const Stretch* stretches;
    // Stretches on each line; and for each coordinate the number of the stretch beside cell 0 of line 0. As doubles:
    // the sums are exact, and one conversion is enough.
    double per_line, first_x, first_y;
  };
  [[gnu::always_inline]] StretchTable table() const noexcept {
    return {grid_->stretches(), 1.0 * stretches_of_line_, 1.0 * first_stretch_[0], 1.0 * first_stretch_[1]};
  }
  struct Limits {
    double distance2, rival_factor, rival_offset;
  };
  [[gnu::always_inline]] Limits limits() const noexcept { return {limit2_, rival_factor_, rival_offset_}; }

  /// The number of the stretch that event i matches, or a code, see Choices.
  [[gnu::always_inline]] static int choose_one(const NearestLines& lines, std::size_t i, StretchTable table,
                                               Limits limits) noexcept {
    const Stretch* const stretches = table.stretches;
    const int x = static_cast<int>(table.first_x + table.per_line * lines.k[0][i] + lines.place[0][i]);
    const int y = static_cast<int>(table.first_y + table.per_line * lines.k[1][i] + lines.place[1][i]);
    // Bounds of the squared distances to the edges on both lines. Matched: one edge is surely within reach, and the
    // other is surely no rival. No match: both are surely out of reach; near if one is surely within three times the
    // reach, else unsure, as an edge on a third line may be near.
    const double x_upper = simd::larger(lines.squared[0][i], stretches[x].at_most);
    const double y_upper = simd::larger(lines.squared[1][i], stretches[y].at_most);
    const double x_lower = simd::larger(lines.squared[0][i], stretches[x].at_least);
    const double y_lower = simd::larger(lines.squared[1][i], stretches[y].at_least);
    const double nearest = simd::smaller(y_upper, x_upper);
    int choice = y_upper < x_upper ? y : x;
    choice = nearest <= limits.distance2 ? choice : Choices::kUnsure;
    choice = simd::larger(x_lower, y_lower) > limits.rival_factor * nearest + limits.rival_offset ? choice
                                                                                                  : Choices::kUnsure;
    const int no_match = nearest <= 9 * limits.distance2 ? Choices::kNear : Choices::kUnsure;
    choice = simd::smaller(x_lower, y_lower) > limits.distance2 ? no_match : choice;
    choice = lines.exists[i] > 0.5 ? choice : Choices::kUnsure;
    return lines.within[i] > 0.5 ? choice : Choices::kFar;
  }

  /// The choice that `choose_many` has found for an event with line of sight (m; 1).
  [[gnu::always_inline]] Choice choice(int stretch, Vec2 m) const noexcept {
    if (stretch >= 0) [[likely]]
      return {MatchResult::matched, &this->stretch(stretch)};
    if (stretch != Choices::kUnsure) return {stretch == Choices::kNear ? MatchResult::near : MatchResult::far};
    return choose_exactly(m);
  }

  /// Decides about an event for which `choose_many` has found kUnsure.
  Choice choose_exactly(Vec2 m) const noexcept {
    const GridPoint at = edge_choice_grid_.grid_point(m);
    return choose_exactly(at, edge_choice_grid_.nearest_lines(at));
  }

  /// Eqs. (1) to (5) for an event and the edge that it matches, at the present pose. `near` only if the edge points at
  /// the camera, which does not happen while `on_grid()`.
  [[gnu::always_inline]] MatchResult correspond(const Stretch& edge, Vec2 m,
                                                Correspondence& correspondence) const noexcept {
    return evmarker::correspond(projected_, edge, m, focal_length_, correspondence) ? MatchResult::matched
                                                                                    : MatchResult::near;
  }

  const Stretch& stretch(int number) const noexcept { return grid_->stretches()[number]; }
  const ProjectedGrid& projected() const noexcept { return projected_; }

  /// Events with lines of sight (X/Z, Y/Z) outside of this are far from every segment.
  /// @param border_cells of a marker that is matched through the grid, the box contains this wide a border [cells]
  Box reach(double border_cells = 0) const noexcept {
    if (!on_grid_) return segments_.reach();
    const double fringe = std::max(fringe_, border_cells);
    Box box;
    for (const double x : {-fringe, edge_choice_grid_.cells() + fringe})
      for (const double y : {-fringe, edge_choice_grid_.cells() + fringe}) {
        const Vec3 P = edge_choice_grid_.point(x, y);
        if (!(P.z > 0)) return Box::everywhere();
        box.extend(on_plane(P));
      }
    return box;
  }

  const MarkerModel& model() const noexcept { return segments_.model(); }
  double focal_length() const noexcept { return focal_length_; }
  double max_distance_px() const noexcept { return focal_length_ * max_distance_; }
  /// A lower bound of the side of a cell in the image [px]; 0 if the pose is not matched through the grid.
  double cell_px() const noexcept { return on_grid_ ? focal_length_ / projected_.rate() : 0; }
  /// True if the present pose is matched through the grid.
  bool on_grid() const noexcept { return on_grid_; }

 private:
  using GridPoint = ProjectedGrid::GridPoint;
  using Lines = ProjectedGrid::Lines;
  using Line = ProjectedGrid::Line;

  // The common case, 19 of 20 events on the marker: beside one edge, far from others and from ends. Both branches are
  // predictable. False: undecided.
  [[gnu::always_inline]] bool try_choose(const Lines& lines, Choice& choice) const noexcept {
    if (!(simd::smaller(lines.foot_w[0], lines.foot_w[1]) > 0)) [[unlikely]]
      return false;  // beyond the horizon
    const simd::Pair foot = simd::smaller(simd::larger(lines.foot_a / lines.foot_w, simd::Pair{} - 0.5),
                                          simd::Pair{} + (edge_choice_grid_.cells() + 0.5));
    // Beside cell c, both of these are c; around the point after it, they are c and c + 1. Their sum is the number of
    // the stretch on its line, counted from that of cell 0, see GridEdges::stretches.
    const simd::Pair number = (foot - (0.5 - end_margin_cells_)) + ProjectedGrid::kRounding;
    const simd::Pair other_number = (foot - (0.5 + end_margin_cells_)) + ProjectedGrid::kRounding;
    const auto stretch = [&](int i) {
      const int line = ProjectedGrid::rounded(lines.k_sum[i]),
                cell_or_point = ProjectedGrid::rounded(number[i]) + ProjectedGrid::rounded(other_number[i]);
      return grid_->stretches() +
             (first_stretch_[static_cast<std::size_t>(i)] + stretches_of_line_ * line + cell_or_point);
    };
    const Stretch* const found[2] = {stretch(0), stretch(1)};
    const double at_most[2] = {std::max(lines.squared[0], found[0]->at_most),
                               std::max(lines.squared[1], found[1]->at_most)};
    const double best = std::min(at_most[0], at_most[1]);
    const double other =
        std::max(std::max(lines.squared[0], found[0]->at_least), std::max(lines.squared[1], found[1]->at_least));
    choice.edge = found[at_most[1] < at_most[0]];
    return best <= limit2_ && other > rival_factor_ * best + rival_offset_;
  }

  // All other events: near two edges, an end of one, or none.
  [[gnu::noinline]] Choice choose_exactly(const GridPoint& at, const Lines& lines) const noexcept {
    const std::size_t first = lines.squared[1] < lines.squared[0], second = 1 - first;
    if (!(lines.squared[first] <= limit2_)) return {near_or_far(at, lines)};
    const EdgeAtFoot place = edge_at_foot(ProjectedGrid::line(lines, first));
    if (!place.edge) {
      if (!(lines.squared[second] <= limit2_)) return {near_or_far(at, lines)};
      const EdgeAtFoot other = edge_at_foot(ProjectedGrid::line(lines, second));
      if (!other.edge) return {near_or_far(at, lines)};
      return {other.tie ? MatchResult::ambiguous : MatchResult::matched, other.edge};
    }
    const double rival = std::sqrt(lines.squared[first]) + ambiguity_;
    if (place.tie || (lines.squared[second] < rival * rival && edge_at_foot(ProjectedGrid::line(lines, second)).edge))
      return {MatchResult::ambiguous};
    return {MatchResult::matched, place.edge};
  }

  // The edge at the foot of the perpendicular from an event to a grid line.
  struct EdgeAtFoot {
    const Stretch* edge = nullptr;  // none: the event is not beside an edge
    bool tie = false;               // two edges, dark on different sides, meet there
  };

  EdgeAtFoot edge_at_foot(const Line& line) const noexcept {
    if (!(line.foot_w > 0)) return {};  // beyond the horizon
    const double foot = std::min(std::max(-0.5, line.foot_a / line.foot_w), edge_choice_grid_.cells() + 0.5);
    const int cell = static_cast<int>(foot + 1) - 1;
    const double past_point = foot - cell;
    if (past_point < end_margin_cells_ || past_point > 1 - end_margin_cells_)
      return edge_at_end(line, cell + (past_point > 0.5));
    return {edge_or_null(grid_->stretch(line.coordinate, static_cast<int>(line.k), cell)), false};
  }

  // The same within the margin of a grid point: edges that end there are extended by the margin, so that two may meet.
  EdgeAtFoot edge_at_end(const Line& line, int point) const noexcept {
    const Stretch& before = grid_->stretch(line.coordinate, static_cast<int>(line.k), point - 1);
    const Stretch& after = grid_->stretch(line.coordinate, static_cast<int>(line.k), point);
    if (before.segment == after.segment) return {edge_or_null(after), false};
    // How far the foot is past the point, times foot_w; scaled_way() scales the margin in the same way.
    const double beyond = line.foot_a - point * line.foot_w;
    if (!(std::abs(beyond) <= edge_choice_grid_.scaled_way(line, point, end_margin_)))
      return {edge_or_null(beyond < 0 ? before : after), false};
    return {edge_or_null(before) ? edge_or_null(before) : edge_or_null(after),
            edge_or_null(before) && edge_or_null(after)};
  }

  static const Stretch* edge_or_null(const Stretch& stretch) noexcept { return stretch.dark != 0 ? &stretch : nullptr; }

  // Of an event that is not matched: `near` if any edge is within three times the maximal distance.
  [[gnu::noinline]] MatchResult near_or_far(const GridPoint& at, const Lines& lines) const noexcept {
    const auto beside = [&](const Line& line) { return line.squared < 9 * limit2_ && edge_at_foot(line).edge; };
    if (beside(ProjectedGrid::line(lines, 0)) || beside(ProjectedGrid::line(lines, 1))) return MatchResult::near;
    for (std::size_t coordinate = 0; coordinate < 2; ++coordinate) {
      const double from = std::max(0.0, std::ceil(at.a[coordinate] / at.w - fringe_));
      const double to = std::min(edge_choice_grid_.cells(), at.a[coordinate] / at.w + fringe_);
      for (double k = from; k <= to; ++k)
        if (beside(edge_choice_grid_.line(coordinate, k, at))) return MatchResult::near;
    }
    return MatchResult::far;
  }

  // Updates fringe_ and end_margin_cells_ for the projected pose. False if an event could be within reach of more than
  // its two nearest lines.
  bool update_bounds() noexcept {
    const double rate = projected_.bound_rate(near_reach_);
    if (rate == rate_) return grid_suffices_;
    rate_ = rate;
    fringe_ = rate_ * near_reach_;
    end_margin_cells_ = rate_ * end_margin_ + 1e-9;  // so that rounding cannot miss an end
    grid_suffices_ =
        rate_ > 0 && fringe_ < ProjectedGrid::kMaxFringe && rate_ * match_reach_ < 0.5 && end_margin_cells_ < 0.5;
    return grid_suffices_;
  }

  SegmentMatcher segments_;
  std::optional<GridEdges> grid_;
  ProjectedGrid projected_;         // at the present pose: where edges are
  ProjectedGrid edge_choice_grid_;  // at that of the last `project`: which edge an event belongs to
  double focal_length_;
  double end_margin_, ambiguity_;       // settings as tangents: pixels divided by the focal length
  double max_distance_;                 // the same
  double match_reach_, near_reach_;     // how far from an edge an event can be matched, or near; the same
  double limit2_;                       // max_distance_ squared
  double rival_factor_, rival_offset_;  // squared distance that a runner-up must exceed: factor d^2 + offset
  int stretches_of_line_ = 0;
  std::array<int, 2> first_stretch_{};  // of cell 0 on line 0 of both coordinates
  bool on_grid_ = false;
  ProjectedGrid::Corners edge_choice_corners_;
  unsigned times_edges_chosen_ = 0;
  double rate_ = 0;              // of the grid, that the following were computed for [cells per unit of X/Z]
  bool grid_suffices_ = false;   // see update_bounds()
  double fringe_ = 0;            // how far outside of the marker an event may be near an edge [cells]
  double end_margin_cells_ = 0;  // upper bound of end_margin_ at this pose [cells]
};

}  // namespace evmarker
