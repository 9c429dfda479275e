#pragma once
// Floor 3. Nearest model edge of an event in constant time: code markers through the lattice of their cells.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "evmarker/cell_lattice.hpp"
#include "evmarker/segment_matcher.hpp"

namespace evmarker {

/// Matches like SegmentMatcher, event by event with the same result. On a code marker it does not ask every segment:
/// the inverse homography takes the event into the marker's lattice, where the nearest vertical and horizontal line are
/// a rounding and a table knows their edges. Other wireframes, and poses at which more lines than these two may be
/// within reach (cells smaller than about 4.5 px, markers seen edge-on), are left to the SegmentMatcher.
class LatticeMatcher {
 public:
  /// @throws std::invalid_argument like SegmentMatcher
  LatticeMatcher(MarkerModel model, double focal_length, SegmentMatcherSettings settings = {})
      : segments_(std::move(model), focal_length, settings),
        lattice_(CellLattice::of(segments_.model())),
        focal_length_(focal_length),
        max_distance_(settings.max_distance_px / focal_length),
        end_margin_(settings.end_margin_px / focal_length),
        ambiguity_(settings.ambiguity_px / focal_length),
        match_reach_(std::hypot(max_distance_ + ambiguity_, end_margin_)),
        near_reach_(std::hypot(3 * max_distance_, end_margin_)) {
    if (!(settings.ambiguity_px > 1e-6))
      lattice_.reset();  // ties, which rounding decides there, would have to be decided alike
    if (!lattice_) return;
    cells_ = lattice_->cells();
    centre_ = cells_ / 2.0;
    stretches_of_line_ = lattice_->stretches_of_line();
    first_stretch_ = {2, 2 + (lattice_->cells() + 1) * stretches_of_line_};
    limit2_ = max_distance_ * max_distance_;
    // (sqrt(b) + ambiguity)^2 is at most this times b and this more, closest half way to the maximal distance.
    rival_factor_ = 1 + 2 * ambiguity_ / max_distance_;
    rival_offset_ = ambiguity_ * (max_distance_ / 2 + ambiguity_);
  }

  /// Takes a pose. False, and no event matches, while the model is not wholly in front of the camera or not finite.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    on_lattice_ = lattice_ && project_lattice(T_camera_marker);
    return on_lattice_ || segments_.project(T_camera_marker);
  }

  /// Finds the segment of an event with line of sight (m; 1): see SegmentMatcher::match.
  [[gnu::always_inline]] MatchResult match(const Eigen::Vector2d& m, Correspondence& correspondence) const noexcept {
    if (!on_lattice_) [[unlikely]]
      return search(m, correspondence);
    const Eigen::Array2d a = rows_.col(0) * m.x() + rows_.col(1) * m.y() + rows_.col(2);
    const double w = row_w_.x() * m.x() + row_w_.y() * m.y() + row_w_.z();
    // How far the event is from the marker's centre, the farther of both coordinates. Without a division: this is the
    // one decision that cannot be foreseen, and what follows waits for it.
    if (!((a - centre_ * w).abs().maxCoeff() < (centre_ + fringe_) * w)) return MatchResult::far;

    // The nearest vertical and horizontal line, (row - k row_w) (m; 1) = 0 in the image, both at once.
    const Eigen::Array2d k_rounded = (a / w).max(0.0).min(cells_) + kRounding;
    Lines lines;
    lines.k = k_rounded - kRounding;
    lines.e = a - lines.k * w;
    lines.normal_x = rows_.col(0) - lines.k * row_w_x_;
    lines.normal_y = rows_.col(1) - lines.k * row_w_y_;
    lines.norm2 = lines.normal_x.square() + lines.normal_y.square();
    lines.squared = lines.e.square() / lines.norm2;
    // Homogeneous coordinates along the lines of the event's feet on them, m - e / norm2 normal.
    const Eigen::Array2d foot_a =
        lines.norm2 * a.reverse() - lines.e * (along_x_ * lines.normal_x + along_y_ * lines.normal_y);
    const Eigen::Array2d foot_w = lines.norm2 * w - lines.e * (row_w_x_ * lines.normal_x + row_w_y_ * lines.normal_y);

    Choice choice;
    if (!(foot_w.minCoeff() > 0 && choose(lines, k_rounded, foot_a / foot_w, choice))) [[unlikely]] {
      choice = choose_carefully({a, w}, lines);
      if (choice.result != MatchResult::matched) return choice.result;
    }
    return correspond(lines, choice, m, correspondence);
  }

  MatchResult search(const Eigen::Vector2d& m, Correspondence& correspondence) const noexcept {
    Correspondence found;  // not the caller's: that one need not be in memory
    const MatchResult result = segments_.match(m, found);
    if (result == MatchResult::matched) correspondence = found;
    return result;
  }

  /// Events with lines of sight (X/Z, Y/Z) outside of this are far from every segment.
  Eigen::AlignedBox2d reach() const noexcept {
    if (!on_lattice_) return segments_.reach();
    Eigen::AlignedBox2d box;
    for (const double x : {-fringe_, lattice_->cells() + fringe_})
      for (const double y : {-fringe_, lattice_->cells() + fringe_}) {
        const Eigen::Vector3d P = x * steps_.col(0) + y * steps_.col(1) + h0_;
        if (!(P.z() > 0)) return everywhere();
        box.extend(Eigen::Vector2d(P.head<2>() / P.z()));
      }
    return box;
  }
  static Eigen::AlignedBox2d everywhere() noexcept {
    const Eigen::Vector2d far = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
    return {-far, far};
  }

  const MarkerModel& model() const noexcept { return segments_.model(); }
  double focal_length() const noexcept { return focal_length_; }
  /// Whether the present pose is matched through the lattice.
  bool on_lattice() const noexcept { return on_lattice_; }

 private:
  static constexpr int kFringe = 2;  // cells around the marker over which the scale of the lattice is bounded

  // An event and its homogeneous lattice coordinates: (a, w) = H^-1 (m; 1).
  struct Sight {
    Eigen::Array2d a;
    double w;
  };

  // The two lattice lines that are nearest to an event: element 0 of all is about the vertical one.
  struct Lines {
    Eigen::Array2d k, e;                // which, and its equation's value at the event
    Eigen::Array2d normal_x, normal_y;  // toward larger coordinates, not of unit length
    Eigen::Array2d norm2, squared;      // squared length of it, and distance as a tangent
  };

  // One of them.
  struct Line {
    Eigen::Index coordinate;
    double k;
    double e;
    Eigen::Vector2d normal;
    double norm2;
  };

  // What becomes of an event, and the edge that it matches.
  struct Choice {
    MatchResult result = MatchResult::matched;
    Eigen::Index coordinate = 0;
    const CellLattice::Stretch* edge = nullptr;
  };

  // The sum of a number and this ends in the bits of the nearest integer: SSE2 has no instruction for rounding, and
  // the way through a conversion is longer.
  static constexpr double kRounding = 0x1.8p52;
  static int rounded(double sum) noexcept { return static_cast<int>(std::bit_cast<std::int64_t>(sum)); }

  // The common case, four in five events of a marker, without a branch before the last: beside exactly one edge and
  // far enough from others. False for anything else.
  [[gnu::always_inline]] bool choose(const Lines& lines, const Eigen::Array2d& k_rounded, const Eigen::Array2d& foot,
                                     Choice& choice) const noexcept {
    const Eigen::Array2d clamped = foot.max(-0.5).min(cells_ + 0.5);
    // In a cell, both of these are its number; around a lattice point, they differ by one.
    const Eigen::Array2d number = (clamped - before_) + kRounding, other_number = (clamped - behind_) + kRounding;
    const auto stretch = [&](Eigen::Index i) {
      return lattice_->stretches() +
             (first_stretch_[static_cast<std::size_t>(i)] + stretches_of_line_ * rounded(k_rounded(i)) +
              rounded(number(i)) + rounded(other_number(i)));
    };
    const CellLattice::Stretch* const found[2] = {stretch(0), stretch(1)};
    const double at_most[2] = {std::max(lines.squared(0), found[0]->at_most),
                               std::max(lines.squared(1), found[1]->at_most)};
    const double best = std::min(at_most[0], at_most[1]);
    const double other =
        std::max(std::max(lines.squared(0), found[0]->at_least), std::max(lines.squared(1), found[1]->at_least));
    choice.coordinate = at_most[1] < at_most[0];
    choice.edge = found[choice.coordinate];
    return best <= limit2_ && other > rival_factor_ * best + rival_offset_;
  }

  // What lies where the event's foot is on a line.
  struct Place {
    const CellLattice::Stretch* edge = nullptr;  // none: the event is not beside an edge
    bool tie = false;                            // two edges, dark on different sides, meet there
  };

  Place place_on(const Line& line, const Sight& sight) const noexcept {
    const Eigen::Index along = 1 - line.coordinate;
    // Homogeneous: of m - e / norm2 normal.
    const double a =
        line.norm2 * sight.a(along) - line.e * (rows_(along, 0) * line.normal.x() + rows_(along, 1) * line.normal.y());
    const double w = line.norm2 * sight.w - line.e * (row_w_.x() * line.normal.x() + row_w_.y() * line.normal.y());
    if (!(w > 0)) return {};  // beyond the horizon
    const double foot = std::min(std::max(-0.5, a / w), lattice_->cells() + 0.5);
    const int cell = static_cast<int>(foot + 1) - 1;
    const CellLattice::Stretch& edge = lattice_->stretch(line.coordinate, static_cast<int>(line.k), cell);
    const double past_point = foot - cell;
    if (past_point < end_margin_cells_ || past_point > 1 - end_margin_cells_)
      return place_at_end(line, a, w, cell + (past_point > 0.5));
    return {edge.dark != 0 ? &edge : nullptr, false};
  }

  // Near a lattice point, where an edge may end: it reaches beyond its end by the margin.
  Place place_at_end(const Line& line, double a, double w, int point) const noexcept {
    const CellLattice::Stretch* before = &lattice_->stretch(line.coordinate, static_cast<int>(line.k), point - 1);
    const CellLattice::Stretch* behind = &lattice_->stretch(line.coordinate, static_cast<int>(line.k), point);
    const auto on = [](const CellLattice::Stretch* edge) { return edge->dark != 0 ? edge : nullptr; };
    if (before->segment == behind->segment) return {on(behind), false};
    const double z = steps_(2, line.coordinate) * line.k + steps_(2, 1 - line.coordinate) * point + h0_.z();
    const double beyond = a - point * w, margin = end_margin_ * determinant_ * z;
    if (!(beyond * beyond <= margin * margin * line.norm2)) return {on(beyond < 0 ? before : behind), false};
    return {on(before) ? before : on(behind), on(before) && on(behind)};
  }

  // Of an event that is not matched: `near` if any edge is within three times the maximal distance.
  [[gnu::noinline]] MatchResult near_or_far(const Sight& sight) const noexcept {
    const double reach2 = 9 * max_distance_ * max_distance_;
    for (Eigen::Index coordinate = 0; coordinate < 2; ++coordinate) {
      const double from = std::max(0.0, std::ceil(sight.a(coordinate) / sight.w - fringe_));
      const double to = std::min<double>(lattice_->cells(), sight.a(coordinate) / sight.w + fringe_);
      for (double k = from; k <= to; ++k) {
        const Eigen::Vector2d normal(rows_(coordinate, 0) - k * row_w_.x(), rows_(coordinate, 1) - k * row_w_.y());
        const Line line = {coordinate, k, sight.a(coordinate) - k * sight.w, normal, normal.squaredNorm()};
        if (line.e * line.e < reach2 * line.norm2 && place_on(line, sight).edge) return MatchResult::near;
      }
    }
    return MatchResult::far;
  }

  // All other events: near two edges, an end of one, or none.
  [[gnu::noinline]] Choice choose_carefully(const Sight& sight, const Lines& lines) const noexcept {
    const double limit2 = max_distance_ * max_distance_;
    const Eigen::Index first = lines.squared.y() < lines.squared.x(), second = 1 - first;
    const auto line = [&](Eigen::Index i) -> Line {
      return {i, lines.k(i), lines.e(i), {lines.normal_x(i), lines.normal_y(i)}, lines.norm2(i)};
    };
    if (!(lines.squared(first) <= limit2)) return {near_or_far(sight)};
    const Place place = place_on(line(first), sight);
    if (!place.edge) {
      if (!(lines.squared(second) <= limit2)) return {near_or_far(sight)};
      const Place other = place_on(line(second), sight);
      if (!other.edge) return {near_or_far(sight)};
      return {other.tie ? MatchResult::ambiguous : MatchResult::matched, second, other.edge};
    }
    const double rival = std::sqrt(lines.squared(first)) + ambiguity_;
    if (place.tie || (lines.squared(second) < rival * rival && place_on(line(second), sight).edge))
      return {MatchResult::ambiguous};
    return {MatchResult::matched, first, place.edge};
  }

  // Eq. (5) on the line B + a2 D of the marker: D along the line, a cell long, B on its zero.
  [[gnu::always_inline]] MatchResult correspond(const Lines& lines, const Choice& choice, const Eigen::Vector2d& m,
                                                Correspondence& c) const noexcept {
    const Eigen::Index i = choice.coordinate;
    const CellLattice::Stretch& edge = *choice.edge;
    // Of both lines, so that little of this waits for the choice of one.
    const Eigen::Array2d MD = D_x_ * m.x() + D_y_ * m.y() + D_z_;
    const double MM = m.x() * m.x() + m.y() * m.y() + 1, by_MM = 1 / MM;
    const Eigen::Array2d MB = (h0_.x() * m.x() + h0_.y() * m.y() + h0_.z()) + lines.k * MD.reverse();
    const Eigen::Array2d DB = D_h0_ + lines.k * steps_dot_, determinant = MM * DD_ - MD.square();
    const Eigen::Array2d foot = (MD * MB - MM * DB) / determinant;
    if (!(determinant(i) > 1e-6 * MM * DD_(i)))
      return MatchResult::near;  // the edge points at the camera: no constraint
    const double a2 = std::min(std::max(foot(i), edge.begin), edge.end);
    c.segment = edge.segment;
    const Eigen::Array2d by_norm = lines.norm2.sqrt().inverse();
    const double toward_dark = edge.dark * by_norm(i);
    c.distance_px = focal_length_ * toward_dark * lines.e(i);  // Eq. (1)
    c.squared_px = focal_length_ * focal_length_ * lines.squared(i);
    c.normal = {toward_dark * lines.normal_x(i), toward_dark * lines.normal_y(i)};
    c.dark_side_known = true;
    c.M = {m.x(), m.y(), 1};
    const double k = lines.k(i);
    const double *across = &steps_(0, i), *along = &steps_(0, 1 - i);
    c.E = {h0_.x() + k * across[0] + a2 * along[0], h0_.y() + k * across[1] + a2 * along[1],
           h0_.z() + k * across[2] + a2 * along[2]};
    const double a1 = (MB(i) + a2 * MD(i)) * by_MM;
    c.F = {a1 * m.x(), a1 * m.y(), a1};
    const Eigen::Vector2d& n = c.normal;
    const double inverse_z = 1 / c.E.z(), scale = focal_length_ * inverse_z;
    c.gradient = {scale * n.x(), scale * n.y(), -scale * inverse_z * (n.x() * c.E.x() + n.y() * c.E.y())};
    return MatchResult::matched;
  }

  // The homography and its inverse (times its determinant). False where two lines may not be enough for an event.
  bool project_lattice(const Eigen::Isometry3d& T_camera_marker) noexcept {
    const auto& R = T_camera_marker.linear();
    const double cell = lattice_->cell_length_m();
    const int cells = lattice_->cells();
    steps_ << cell * R.col(0), -cell * R.col(1);
    const Eigen::Vector3d h_x = steps_.col(0), h_y = steps_.col(1);
    h0_ = T_camera_marker.translation() - 0.5 * cells * (h_x + h_y);
    const Eigen::Vector3d row_x = h_y.cross(h0_);
    const Eigen::Vector3d row_y = h0_.cross(h_x);
    row_w_ = h_x.cross(h_y);
    determinant_ = row_w_.dot(h0_);
    if (!(determinant_ > 0)) return false;  // seen from behind
    rows_ << row_x.transpose(), row_y.transpose();
    row_w_x_.setConstant(row_w_.x());
    row_w_y_.setConstant(row_w_.y());
    D_x_ = {h_y.x(), h_x.x()};
    D_y_ = {h_y.y(), h_x.y()};
    D_z_ = {h_y.z(), h_x.z()};
    along_x_ = {row_y.x(), row_x.x()};
    along_y_ = {row_y.y(), row_x.y()};
    DD_ = {h_y.squaredNorm(), h_x.squaredNorm()};
    D_h0_ = {h_y.dot(h0_), h_x.dot(h0_)};
    steps_dot_.setConstant(h_x.dot(h_y));
    const double x = cells * h_x.z(), y = cells * h_y.z();
    const double z_near = h0_.z() + std::min(x, 0.0) + std::min(y, 0.0);
    const double z_far = h0_.z() + std::max(x, 0.0) + std::max(y, 0.0);
    if (!(z_near > 1e-6 && std::isfinite(determinant_ + R.col(2).sum()))) return false;

    // w = determinant / z on the marker; its least value, times z_far, where an event may still be near an edge.
    const double w = determinant_ - near_reach_ * z_far * row_w_.head<2>().lpNorm<1>();
    // Lattice coordinates change by at most |row - k row_w| / w by the tangent, most on one of the outermost lines.
    const auto steepest = [&](double k) {
      return ((rows_.col(0) - k * row_w_.x()).square() + (rows_.col(1) - k * row_w_.y()).square()).maxCoeff();
    };
    const double squared = z_far * z_far * std::max(steepest(-kFringe), steepest(cells + kFringe));
    // The bound leaves room for small motions, so that it need not be computed, with a root and a division, every time.
    const double squared_bound = rate_ * rate_ * w * w;
    if (!(w > 0 && squared <= squared_bound && squared_bound <= 1.3 * squared))
      bound_rate(1.05 * std::sqrt(squared) / w);
    return fits_;
  }

  void bound_rate(double rate) noexcept {
    rate_ = rate;
    fringe_ = rate * near_reach_;
    end_margin_cells_ = rate * end_margin_ + 1e-9;
    before_.setConstant(0.5 - end_margin_cells_);
    behind_.setConstant(0.5 + end_margin_cells_);
    fits_ = rate > 0 && fringe_ < kFringe && rate * match_reach_ < 0.5;
  }

  SegmentMatcher segments_;
  std::optional<CellLattice> lattice_;
  double focal_length_;
  double max_distance_, end_margin_, ambiguity_;  // settings as tangents, pixels by the focal length
  double match_reach_, near_reach_;               // how far from an edge an event can be matched, or near
  bool on_lattice_ = false;
  // Columns of H, homogeneous lattice coordinates to camera frame [m]: the steps to the next cell and the top left
  // corner.
  Eigen::Matrix<double, 3, 2> steps_ = Eigen::Matrix<double, 3, 2>::Zero();
  Eigen::Vector3d h0_{0, 0, 0};
  // Rows of H^-1, times the determinant of H.
  Eigen::Array<double, 2, 3> rows_ = Eigen::Array<double, 2, 3>::Zero();
  Eigen::Vector3d row_w_{0, 0, 0};
  double determinant_ = 0;
  // What the two lines of an event are computed from, element 0 for the vertical one: the rows that count along them,
  // row_w_ twice, and the coordinates and products of their directions D.
  Eigen::Array2d along_x_{0, 0}, along_y_{0, 0}, row_w_x_{0, 0}, row_w_y_{0, 0};
  Eigen::Array2d D_x_{0, 0}, D_y_{0, 0}, D_z_{0, 0}, DD_{0, 0}, D_h0_{0, 0}, steps_dot_{0, 0};
  double cells_ = 0, centre_ = 0;
  int stretches_of_line_ = 0;
  std::array<int, 2> first_stretch_{};  // of cell 0 on line 0 of both coordinates
  double limit2_ = 0;                   // max_distance_ squared
  double rival_factor_ = 0, rival_offset_ = 0;
  Eigen::Array2d before_{0, 0}, behind_{0, 0};  // half a cell less, and more, the margin at its ends
  double rate_ = 0;                             // at most so many cells in a unit of the tangent
  bool fits_ = false;                           // so that two lines are enough for an event
  double end_margin_cells_ = 0;                 // at most
  double fringe_ = 0;                           // how far outside of the marker an event may be near an edge [cells]
};

}  // namespace evmarker
