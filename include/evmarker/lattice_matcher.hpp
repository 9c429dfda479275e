#pragma once
// Floor 3. Nearest model edge of an event in constant time: code markers through the lattice of their cells.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
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
  }

  /// Takes a pose. False, and no event matches, while the model is not wholly in front of the camera or not finite.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    on_lattice_ = lattice_ && project_lattice(T_camera_marker);
    return on_lattice_ || segments_.project(T_camera_marker);
  }

  /// Finds the segment of an event with line of sight (m; 1): see SegmentMatcher::match.
  MatchResult match(const Eigen::Vector2d& m, Correspondence& correspondence) const noexcept {
    if (!on_lattice_) return segments_.match(m, correspondence);
    const int cells = lattice_->cells();
    const Sight event = {m, {value(row_[0], m), value(row_[1], m)}, value(row_w_, m)};
    if (!(std::min(event.a[0], event.a[1]) > -fringe_ * event.w &&
          std::max(event.a[0], event.a[1]) < (cells + fringe_) * event.w))
      return MatchResult::far;

    const double x = event.a[0] / event.w, y = event.a[1] / event.w;
    const double limit = max_distance_ + ambiguity_;
    const Candidate vertical = edge_on<0>(nearest_integer(x), event, limit);
    const Candidate horizontal = edge_on<1>(nearest_integer(y), event, limit);
    const bool is_vertical = vertical.distance < horizontal.distance;
    const auto& [best, other] = is_vertical ? std::pair<const Candidate&, const Candidate&>(vertical, horizontal)
                                            : std::pair<const Candidate&, const Candidate&>(horizontal, vertical);
    if (!(best.distance <= max_distance_)) return is_near(x, y, event) ? MatchResult::near : MatchResult::far;
    if (best.tie || other.distance - best.distance < ambiguity_) return MatchResult::ambiguous;
    return is_vertical ? correspond<0>(best, event, correspondence) : correspond<1>(best, event, correspondence);
  }

  const MarkerModel& model() const noexcept { return segments_.model(); }
  double focal_length() const noexcept { return focal_length_; }
  /// Corners of the projected model's bounding box, in undistorted pixels from the principal point.
  Eigen::Vector2d low() const noexcept { return on_lattice_ ? -farthest_corner(-1) : segments_.low(); }
  Eigen::Vector2d high() const noexcept { return on_lattice_ ? farthest_corner(1) : segments_.high(); }
  /// Whether the present pose is matched through the lattice.
  bool on_lattice() const noexcept { return on_lattice_; }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  static constexpr int kFringe = 2;  // cells around the marker over which the scale of the lattice is bounded

  // An event in homogeneous lattice coordinates: (a, w) = H^-1 (m; 1).
  struct Sight {
    Eigen::Vector2d m;
    std::array<double, 2> a;
    double w;
  };

  // The edge on one lattice line that has the foot of an event.
  struct Candidate {
    double distance = kNone;  // tangent
    double e = 0;             // the line's equation at the event
    Eigen::Vector2d normal;   // toward larger coordinates, not of unit length
    double inverse_norm = 0;
    int line = 0;
    const CellLattice::Edge* edge = nullptr;
    bool tie = false;  // two edges of the line, dark on different sides, meet at the foot
  };

  static double value(const Eigen::Vector3d& row, const Eigen::Vector2d& m) noexcept {
    return row.x() * m.x() + row.y() * m.y() + row.z();
  }
  // Of the lattice lines; NaN gives any.
  int nearest_integer(double coordinate) const noexcept {
    return static_cast<int>(std::min(std::max(0.0, coordinate + 0.5), static_cast<double>(lattice_->cells())));
  }

  // The edge of a line that an event lies beside, if it is not farther than the limit. The line with coordinate k has
  // the equation (row - k row_w) (m; 1) = 0 in the image.
  template <std::size_t coordinate>
  Candidate edge_on(int line, const Sight& event, double limit) const noexcept {
    constexpr std::size_t along = 1 - coordinate;
    Candidate c;
    c.line = line;
    c.e = event.a[coordinate] - line * event.w;
    c.normal = row_[coordinate].head<2>() - line * row_w_.head<2>();
    const double norm2 = c.normal.squaredNorm();
    if (!(c.e * c.e <= limit * limit * norm2)) return c;

    // The foot of the event on the line, and the lattice point next to it.
    const double q = c.e / norm2;
    const double a = event.a[along] - q * row_[along].head<2>().dot(c.normal);
    const double w = event.w - q * row_w_.head<2>().dot(c.normal);
    if (!(w > 0)) return c;  // beyond the horizon
    const double foot = a / w;
    const int point = nearest_integer(foot);
    const CellLattice::Edge& before = lattice_->edge(coordinate, line, point - 1);
    const CellLattice::Edge& behind = lattice_->edge(coordinate, line, point);
    c.edge = foot < point ? &before : &behind;
    if (before.segment != behind.segment) {  // near the end of an edge
      const double z = h_[coordinate].z() * line + h_[along].z() * point + h0_.z();
      const double beyond = a - point * w, margin = end_margin_ * determinant_ * z;
      if (beyond * beyond * norm2 <= margin * margin) {
        c.tie = before.dark != 0 && behind.dark != 0;
        c.edge = before.dark != 0 ? &before : &behind;
      }
    }
    if (c.edge->dark == 0) return c;
    c.inverse_norm = 1 / std::sqrt(norm2);
    c.distance = std::abs(c.e) * c.inverse_norm;
    return c;
  }

  // Whether any edge is within three times the maximal distance.
  bool is_near(double x, double y, const Sight& event) const noexcept {
    const double reach = 3 * max_distance_;
    for (int line = nearest_integer(x - fringe_); line <= nearest_integer(x + fringe_); ++line)
      if (edge_on<0>(line, event, reach).distance < reach) return true;
    for (int line = nearest_integer(y - fringe_); line <= nearest_integer(y + fringe_); ++line)
      if (edge_on<1>(line, event, reach).distance < reach) return true;
    return false;
  }

  // Eq. (5) on the line B + a2 D of the marker: D along the line, a cell long, B on its zero.
  template <std::size_t coordinate>
  MatchResult correspond(const Candidate& candidate, const Sight& event, Correspondence& c) const noexcept {
    const Eigen::Vector3d M(event.m.x(), event.m.y(), 1);
    const Eigen::Vector3d &D = h_[1 - coordinate], B = h0_ + candidate.line * h_[coordinate];
    const double MM = M.squaredNorm(), MD = M.dot(D), DD = D.squaredNorm(), MB = M.dot(B), DB = D.dot(B);
    const double determinant = MM * DD - MD * MD;
    if (!(determinant > 1e-6 * MM * DD)) return MatchResult::near;  // the edge points at the camera: no constraint
    const CellLattice::Edge& edge = *candidate.edge;
    const double a2 =
        std::clamp((MD * MB - MM * DB) / determinant, static_cast<double>(edge.begin), static_cast<double>(edge.end));
    c.segment = edge.segment;
    c.distance_px = edge.dark * focal_length_ * candidate.e * candidate.inverse_norm;  // Eq. (1)
    c.normal = edge.dark * candidate.inverse_norm * candidate.normal;
    c.dark_side_known = true;
    c.M = M;
    c.E = B + a2 * D;
    c.F = M.dot(c.E) / MM * M;
    c.gradient << c.normal, -c.normal.dot(c.E.head<2>()) / c.E.z();
    c.gradient *= focal_length_ / c.E.z();
    return MatchResult::matched;
  }

  // In units of `sign` pixels along the image axes.
  Eigen::Vector2d farthest_corner(double sign) const noexcept {
    Eigen::Vector2d farthest = Eigen::Vector2d::Constant(-kNone);
    for (const int x : {0, lattice_->cells()})
      for (const int y : {0, lattice_->cells()}) {
        const Eigen::Vector3d P = x * h_[0] + y * h_[1] + h0_;
        farthest = farthest.cwiseMax(sign * focal_length_ / P.z() * P.head<2>());
      }
    return farthest;
  }

  // The homography and its inverse (times its determinant). False where two lines may not be enough for an event.
  bool project_lattice(const Eigen::Isometry3d& T_camera_marker) noexcept {
    const auto& R = T_camera_marker.linear();
    const double cell = lattice_->cell_length_m();
    const int cells = lattice_->cells();
    h_[0] = cell * R.col(0);
    h_[1] = -cell * R.col(1);
    h0_ = T_camera_marker.translation() - 0.5 * cells * (h_[0] + h_[1]);
    row_[0] = h_[1].cross(h0_);
    row_[1] = h0_.cross(h_[0]);
    row_w_ = h_[0].cross(h_[1]);
    determinant_ = row_w_.dot(h0_);
    if (determinant_ < 0) {  // seen from behind
      determinant_ = -determinant_;
      row_[0] = -row_[0];
      row_[1] = -row_[1];
      row_w_ = -row_w_;
    }
    const double x = cells * h_[0].z(), y = cells * h_[1].z();
    const double z_near = h0_.z() + std::min(x, 0.0) + std::min(y, 0.0);
    const double z_far = h0_.z() + std::max(x, 0.0) + std::max(y, 0.0);
    if (!(z_near > 1e-6 && std::isfinite(determinant_ + R.col(2).sum()))) return false;

    // w = determinant / z on the marker; its least value where an event may still be near an edge.
    const double w = determinant_ / z_far - near_reach_ * row_w_.head<2>().lpNorm<1>();
    // Lattice coordinates change by at most |row - k row_w| / w by the tangent, most on one of the outermost lines.
    const auto steepest = [&](const Eigen::Vector3d& row) {
      return std::max((row + kFringe * row_w_).head<2>().squaredNorm(),
                      (row - (cells + kFringe) * row_w_).head<2>().squaredNorm());
    };
    const double rate = std::sqrt(std::max(steepest(row_[0]), steepest(row_[1]))) / w;
    fringe_ = rate * near_reach_;
    return w > 0 && fringe_ < kFringe && rate * match_reach_ < 0.5;
  }

  SegmentMatcher segments_;
  std::optional<CellLattice> lattice_;
  double focal_length_;
  double max_distance_, end_margin_, ambiguity_;  // settings as tangents, pixels by the focal length
  double match_reach_, near_reach_;               // how far from an edge an event can be matched, or near
  bool on_lattice_ = false;
  // Columns of H, homogeneous lattice coordinates to camera frame [m]: the steps to the next cell and the top left
  // corner.
  std::array<Eigen::Vector3d, 2> h_{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  Eigen::Vector3d h0_ = Eigen::Vector3d::Zero();
  // Rows of H^-1, times the determinant of H.
  std::array<Eigen::Vector3d, 2> row_{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  Eigen::Vector3d row_w_ = Eigen::Vector3d::Zero();
  double determinant_ = 0;
  double fringe_ = 0;  // how far outside of the marker an event may be near an edge [cells]
};

}  // namespace evmarker
