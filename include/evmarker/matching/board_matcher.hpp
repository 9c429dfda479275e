#pragma once
// Nearest model edge of an event on a board: that of the code marker that it lies on.
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/matching/part_tiles.hpp"

namespace evmarker {

/// Matches like SegmentMatcher on a board of code markers: each marker by a GridMatcher of its own, and then the
/// results are compared. An event that is ambiguous on one marker stays so, although SegmentMatcher may match it to a
/// nearer edge of another.
class BoardMatcher {
 public:
  struct Marker {
    GridMatcher matcher;
    Eigen::Isometry3d T_board_marker;
    double half_length;    ///< [m]
    int first_segment;     ///< number of its first segment among the board's
    std::size_t number;    ///< among the board's markers
    bool visible = false;  ///< at the present pose, it shows its front
  };

  /// Nothing if the edges of the model are not those of its `codes`.
  /// @throws std::invalid_argument like SegmentMatcher
  static std::optional<BoardMatcher> of(const MarkerModel& model, double focal_length,
                                        const SegmentMatcherSettings& settings) {
    BoardMatcher board;
    board.margin_ = kMargin_px / focal_length;
    board.settings_ = settings;
    int segments = 0;
    for (const PlacedCode& code : model.codes) {
      MarkerModel marker = make_code_marker(code.length, code.bits);
      for (const MarkerSegment& edge : marker.segments)
        if (!same_place(marker, edge, code, model, static_cast<std::size_t>(segments++))) return std::nullopt;
      const int first = segments - static_cast<int>(marker.segments.size());
      board.markers_.push_back({{std::move(marker), focal_length, settings},
                                code.T_model_code,
                                code.length / 2,
                                first,
                                board.markers_.size()});
    }
    if (segments == 0 || static_cast<std::size_t>(segments) != model.segments.size()) return std::nullopt;
    board.areas_.resize(board.markers_.size());
    return board;
  }

  const Marker& marker(std::size_t number) const noexcept { return markers_[number]; }
  /// See GridMatcher::set_max_distance_px.
  void set_max_distance_px(double distance_px) noexcept {
    settings_.max_distance_px = distance_px;
    for (Marker& marker : markers_) marker.matcher.set_max_distance_px(distance_px);
  }
  /// See GridMatcher::cell_px; of the markers that are visible.
  double cell_px() const noexcept {
    double least = std::numeric_limits<double>::infinity();
    for (const Marker& marker : markers_)
      if (marker.visible) least = std::min(least, marker.matcher.cell_px());
    return std::isfinite(least) ? least : 0;
  }

  /// Sets the pose; see SegmentMatcher::project.
  bool project(const Eigen::Isometry3d& T_camera_board) noexcept {
    ++times_edges_chosen_;
    return place(T_camera_board, [](GridMatcher& matcher, const Eigen::Isometry3d& T) { return matcher.project(T); });
  }
  /// Sets the pose, but keeps which edges events match while that hardly changes, see GridMatcher::move.
  bool move(const Eigen::Isometry3d& T_camera_board, double max_shift_px) noexcept {
    return place(T_camera_board,
                 [&](GridMatcher& matcher, const Eigen::Isometry3d& T) { return matcher.move(T, max_shift_px); });
  }
  /// A counter that changes whenever edges are chosen at a new pose, or no longer can be.
  unsigned times_edges_chosen() const noexcept { return times_edges_chosen_; }

  /// Sure: the only marker with edges that may be near an event, and it is `on_grid()`; or null, as there is none. Not
  /// sure: `match` must decide.
  struct MarkerAt {
    bool sure;
    const Marker* marker;
  };
  [[gnu::always_inline]] MarkerAt marker_at(Vec2 m) const noexcept {
    MarkerAt found{true, nullptr};
    const bool only_one = tiles_.at_most_one_at(m);
    tiles_.for_each_at(m, [&](std::size_t i) {
      const Marker& marker = markers_[i];
      const bool on_grid = marker.matcher.on_grid();
      if (!only_one && (!marker.visible || (on_grid && !marker.matcher.reaches(m)))) return;
      found.sure = found.marker == nullptr && on_grid;
      found.marker = &marker;
    });
    return found;
  }

  /// What `choose_many` finds for each event: the marker to which it belongs, and the number as in
  /// GridMatcher::Choices. Without a marker: kFar, or, where only `match` can decide, kUnsure.
  struct Choices {
    static constexpr std::size_t kMost = GridMatcher::Choices::kMost;
    std::array<const Marker*, kMost> marker;
    std::array<int, kMost> stretch;
  };

  /// Finds the edges of `count` events from `first` on, at most Choices::kMost.
  void choose_many(const EventGroup& events, std::size_t first, std::size_t count, Choices& choices) const noexcept {
    Views views;
    std::array<std::size_t, Choices::kMost> numbers;  // of the events that belong to a marker
    std::size_t members = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Vec2 m{events.x[first + i], events.y[first + i]};
      const auto [sure, marker] = marker_at(m);
      choices.marker[i] = sure ? marker : nullptr;
      choices.stretch[i] = sure ? GridMatcher::Choices::kFar : GridMatcher::Choices::kUnsure;
      if (choices.marker[i] == nullptr) continue;
      views.set(members, m, marker->matcher.view());
      numbers[members++] = i;
    }
    if (members == 0) return;
    for (std::size_t k = members; k % simd::kLanes != 0; ++k) views.set(k, {}, views.view(0));
    const GridMatcher::Limits limits = markers_.front().matcher.limits();
    NearestLines lines;
    simd::in_wide_vectors([&]() __attribute__((always_inline)) {
      nearest_lines(
          [&](std::size_t i) __attribute__((always_inline)) { return views.view(i); }, views.x.data(), views.y.data(),
          members, lines);
      for (std::size_t k = 0; k < members; ++k) {
        const std::size_t i = numbers[k];
        choices.stretch[i] = GridMatcher::choose_one(lines, k, choices.marker[i]->matcher.table(), limits);
      }
    });
  }

  /// Finds the segment of an event with line of sight (m; 1): see SegmentMatcher::match.
  MatchResult match(Vec2 m, Correspondence& correspondence) const noexcept {
    MatchResult result = MatchResult::far;
    tiles_.for_each_at(m, [&](std::size_t i) {
      if (!markers_[i].visible) return;
      if (result == MatchResult::far) {
        result = match(markers_[i], m, correspondence);
      } else {
        Correspondence other;
        result = nearer(result, correspondence, match(markers_[i], m, other), other);
      }
    });
    return result;
  }

  /// Events with lines of sight (X/Z, Y/Z) outside of this are far from every segment.
  /// @param border_cells the box contains at least this wide a border around each marker [its cells]
  Box reach(double border_cells = 0) const noexcept {
    Box box = area_;
    if (border_cells > 0)
      for (const Marker& marker : markers_)
        if (marker.visible) box.extend(marker.matcher.reach(border_cells));
    return box;
  }

 private:
  // Events and their grids, one array for each component.
  struct Views {
    template <typename T>
    using Numbers = std::array<T, Choices::kMost>;
    alignas(64) Numbers<double> x, y;
    alignas(64) Numbers<double> xx, xy, xz, yx, yy, yz, wx, wy, wz, cells, reach, margin;

    void set(std::size_t i, Vec2 m, const GridView& view) noexcept {
      x[i] = m.x, y[i] = m.y;
      xx[i] = view.row_x.x, xy[i] = view.row_x.y, xz[i] = view.row_x.z;
      yx[i] = view.row_y.x, yy[i] = view.row_y.y, yz[i] = view.row_y.z;
      wx[i] = view.row_w.x, wy[i] = view.row_w.y, wz[i] = view.row_w.z;
      cells[i] = view.cells, reach[i] = view.reach, margin[i] = view.margin;
    }
    [[gnu::always_inline]] GridView view(std::size_t i) const noexcept {
      return {{xx[i], xy[i], xz[i]}, {yx[i], yy[i], yz[i]}, {wx[i], wy[i], wz[i]}, cells[i], reach[i], margin[i]};
    }
  };

  static constexpr double kMargin_px = 4;  // around the area of a marker, so that its tiles change rarely

  BoardMatcher() = default;

  // True if segment i of the model is a marker's edge.
  static bool same_place(const MarkerModel& marker, const MarkerSegment& edge, const PlacedCode& code,
                         const MarkerModel& model, std::size_t i) {
    if (i >= model.segments.size()) return false;
    const auto near = [&](Vec3 a, Vec3 b) { return norm(a - b) < 1e-9; };
    const auto vertex = [](const MarkerModel& of, int number) {
      return Vec3(of.vertices[static_cast<std::size_t>(number)]);
    };
    const MarkerSegment& there = model.segments[i];
    const Eigen::Isometry3d& T = code.T_model_code;
    return near(transform(T, vertex(marker, edge.from)), vertex(model, there.from)) &&
           near(transform(T, vertex(marker, edge.to)), vertex(model, there.to)) &&
           near(rotate(T, edge.dark_side), there.dark_side) && near(rotate(T, edge.face_normal), there.face_normal);
  }

  template <typename Move>
  bool place(const Eigen::Isometry3d& T_camera_board, const Move& move) noexcept {
    bool any = false, outgrown = false;
    for (std::size_t i = 0; i < markers_.size(); ++i) {
      Marker& marker = markers_[i];
      const Eigen::Isometry3d T = product(T_camera_board, marker.T_board_marker);
      if (!in_front(marker, T)) return fail();
      const bool was_visible = std::exchange(marker.visible, dot(axis(T, 2), translation(T)) < 0);
      if (marker.visible != was_visible) {
        ++times_edges_chosen_;
        outgrown = true;
      }
      if (!marker.visible) continue;
      const unsigned times_chosen = marker.matcher.times_edges_chosen();
      if (!move(marker.matcher, T)) return fail();
      any = true;
      if (marker.matcher.times_edges_chosen() == times_chosen) continue;
      ++times_edges_chosen_;
      outgrown |= !areas_[i].contains(marker.matcher.reach());
    }
    if (outgrown) set_tiles();
    return any;
  }

  // Where z is least, on one of the corners, it is more than 1 um.
  static bool in_front(const Marker& marker, const Eigen::Isometry3d& T) noexcept {
    return translation(T).z - marker.half_length * (std::abs(T(2, 0)) + std::abs(T(2, 1))) > 1e-6 && is_finite(T);
  }

  // No event matches.
  bool fail() noexcept {
    ++times_edges_chosen_;
    for (Marker& marker : markers_) marker.visible = false;
    set_tiles();
    return false;
  }

  void set_tiles() noexcept {
    area_ = {};
    for (std::size_t i = 0; i < markers_.size(); ++i) {
      areas_[i] = markers_[i].visible ? markers_[i].matcher.reach().widened(margin_) : Box();
      area_.extend(areas_[i]);
    }
    tiles_.set(areas_);
  }

  static MatchResult match(const Marker& marker, Vec2 m, Correspondence& correspondence) noexcept {
    const MatchResult result = marker.matcher.match(m, correspondence);
    correspondence.segment += marker.first_segment;
    return result;
  }

  // Of two markers' results, neither of which need be matched.
  MatchResult nearer(MatchResult result, Correspondence& c, MatchResult other_result,
                     const Correspondence& other) const noexcept {
    if (other_result == MatchResult::far) return result;
    const double unmatched = settings_.max_distance_px;  // it is at least as far from that marker's edges
    const double px = result == MatchResult::matched ? std::abs(c.distance_px) : unmatched,
                 other_px = other_result == MatchResult::matched ? std::abs(other.distance_px) : unmatched;
    if (result == MatchResult::near && other_result == MatchResult::near) return MatchResult::near;
    const bool ambiguous = result == MatchResult::ambiguous || other_result == MatchResult::ambiguous;
    if (ambiguous || std::abs(px - other_px) < settings_.ambiguity_px) return MatchResult::ambiguous;
    if (other_px < px) c = other;
    return MatchResult::matched;
  }

  std::vector<Marker> markers_;
  std::vector<Box> areas_;  // of each marker: where its events may lie, with a margin
  Box area_;                // of all of them
  PartTiles tiles_;
  SegmentMatcherSettings settings_;
  double margin_ = 0;  // [tangent]
  unsigned times_edges_chosen_ = 0;
};

}  // namespace evmarker
