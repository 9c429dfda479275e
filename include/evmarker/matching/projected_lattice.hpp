#pragma once
// A code marker's lattice of cells as a camera sees it: which of its lines are nearest to an event.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "evmarker/simd/lanes.hpp"
#include "evmarker/simd/pack.hpp"

namespace evmarker {

/// The lattice of `CellLattice` at one pose, by its homography. The image is that of lines of sight (m; 1), distances
/// in it are tangents. What is computed for every event is computed for the vertical (element 0) and the horizontal
/// line next to it at once: two numbers fit into a register, and which line will count cannot be foreseen.
class ProjectedLattice {
 public:
  static constexpr int kMaxFringe = 2;  ///< cells around the marker over which `rate()` holds

  ProjectedLattice() = default;
  ProjectedLattice(int cells, double cell_length_m) : cells_(cells), centre_(cells / 2.0), cell_(cell_length_m) {}

  /// Takes a pose. False while the marker is not wholly in front of the camera, seen from behind, or not finite.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    const auto& R = T_camera_marker.linear();
    const Eigen::Vector3d h_x = cell_ * R.col(0), h_y = -cell_ * R.col(1);
    steps_ << h_x, h_y;
    h0_ = T_camera_marker.translation() - centre_ * (h_x + h_y);
    const Eigen::Vector3d row_x = h_y.cross(h0_), row_y = h0_.cross(h_x);
    row_w_ = h_x.cross(h_y);
    determinant_ = row_w_.dot(h0_);
    if (!(determinant_ > 0)) return false;  // seen from behind
    rows_ << row_x.transpose(), row_y.transpose();
    const double z_near = h0_.z() + std::min(cells_ * h_x.z(), 0.0) + std::min(cells_ * h_y.z(), 0.0);
    return z_near > 1e-6 && std::isfinite(determinant_ + R.col(2).sum());
  }

  /// Where the lattice's four corners are seen, (X/Z, Y/Z).
  struct Corners {
    Eigen::Array4d x{0, 0, 0, 0}, y{0, 0, 0, 0};
  };
  Corners corners() const noexcept {
    const Eigen::Array4d z = of_corners(2);
    return {of_corners(0) / z, of_corners(1) / z};
  }
  /// Whether they are seen less than so far from there, in either coordinate [tangent].
  [[gnu::always_inline]] bool near(const Corners& there, double distance) const noexcept {
    const Eigen::Array4d z = of_corners(2);
    const Eigen::Array4d off = (of_corners(0) - there.x * z).abs().max((of_corners(1) - there.y * z).abs());
    return (distance * z - off).minCoeff() > 0;
  }

  /// Lattice coordinates change by at most so many cells in a unit of the tangent at the pose of the last call; not
  /// positive where there is no such bound. Changes rarely while the marker moves.
  /// @param reach how far from the lattice's lines this is to hold [tangent]
  double bound_rate(double reach) noexcept {
    const double z_far = h0_.z() + std::max(cells_ * steps_(2, 0), 0.0) + std::max(cells_ * steps_(2, 1), 0.0);
    // w = determinant / z on the marker; its least value, times z_far, where an event may still be near an edge.
    const double w = determinant_ - reach * z_far * row_w_.head<2>().lpNorm<1>();
    // Lattice coordinates change by at most |row - k row_w| / w by the tangent, most on one of the outermost lines.
    const auto steepest = [&](double k) {
      return ((rows_.col(0) - k * row_w_.x()).square() + (rows_.col(1) - k * row_w_.y()).square()).maxCoeff();
    };
    const double squared = z_far * z_far * std::max(steepest(-kMaxFringe), steepest(cells_ + kMaxFringe));
    // The bound leaves room for small motions, so that it need not be computed, with a root and a division, every time.
    const double squared_bound = rate_ * rate_ * w * w;
    if (!(w > 0 && squared <= squared_bound && squared_bound <= 1.3 * squared)) rate_ = 1.05 * std::sqrt(squared) / w;
    return rate_;
  }
  double rate() const noexcept { return rate_; }
  double cells() const noexcept { return cells_; }

  /// Homogeneous lattice coordinates (x, y; 1) to camera frame [m]: the steps to the next cell, and the top left
  /// corner.
  const Eigen::Matrix<double, 3, 2>& steps() const noexcept { return steps_; }
  const Eigen::Vector3d& corner() const noexcept { return h0_; }
  /// The inverse, but for a factor: the rows of both coordinates and of the third.
  const Eigen::Array<double, 2, 3>& rows() const noexcept { return rows_; }
  const Eigen::Vector3d& row_w() const noexcept { return row_w_; }

  /// An event in homogeneous lattice coordinates (a; w): those of the line of sight's intersection with the marker.
  struct Sight {
    Pair a;
    double w;
  };

  [[gnu::always_inline]] Sight sight(const Eigen::Vector2d& m) const noexcept {
    return {column(0) * m.x() + column(1) * m.y() + column(2), row_w_.x() * m.x() + row_w_.y() * m.y() + row_w_.z()};
  }

  /// Whether an event is on the marker or so many cells around it. Without a division: whether one is cannot be
  /// foreseen, and what follows has to wait for it.
  [[gnu::always_inline]] bool within(double fringe, const Sight& s) const noexcept {
    const Pair from_centre = s.a - centre_ * s.w;
    return larger(std::abs(from_centre[0]), std::abs(from_centre[1])) < (centre_ + fringe) * s.w;
  }

  /// 1/Z [1/m] of the point of the marker's plane that the event's line of sight meets.
  double nearness(const Sight& s) const noexcept { return s.w / determinant_; }

  /// The sum of a number and this ends in the bits of the nearest integer. SSE2 cannot round, and a conversion to an
  /// integer and back takes longer.
  static constexpr double kRounding = 0x1.8p52;
  static int rounded(double sum) noexcept { return static_cast<int>(std::bit_cast<std::int64_t>(sum)); }

  /// The nearest vertical and horizontal line, (row - k row_w) (m; 1) = 0 in the image, and the event's feet on them.
  struct Lines {
    Pair k, k_sum;            ///< their numbers, and with kRounding added
    Pair e;                   ///< the equation's value at the event
    Pair normal_x, normal_y;  ///< toward larger coordinates, not of unit length
    Pair norm2, squared;      ///< its squared length, and the squared distance
    Pair foot_a, foot_w;      ///< homogeneous coordinate along the line of m - e / norm2 normal
  };

  [[gnu::always_inline]] Lines nearest_lines(const Sight& s) const noexcept {
    Lines lines;
    lines.k_sum = smaller(larger(s.a / s.w, Pair{}), Pair{} + cells_) + kRounding;
    lines.k = lines.k_sum - kRounding;
    lines.e = s.a - lines.k * s.w;
    lines.normal_x = column(0) - lines.k * row_w_.x();
    lines.normal_y = column(1) - lines.k * row_w_.y();
    lines.norm2 = lines.normal_x * lines.normal_x + lines.normal_y * lines.normal_y;
    lines.squared = lines.e * lines.e / lines.norm2;
    lines.foot_a = lines.norm2 * swapped(s.a) -
                   lines.e * (swapped(column(0)) * lines.normal_x + swapped(column(1)) * lines.normal_y);
    lines.foot_w = lines.norm2 * s.w - lines.e * (row_w_.x() * lines.normal_x + row_w_.y() * lines.normal_y);
    return lines;
  }

  /// One line, and the event's foot on it.
  struct Line {
    Eigen::Index coordinate;
    double k, norm2, squared, foot_a, foot_w;
  };

  static Line line(const Lines& lines, Eigen::Index i) noexcept {
    return {i, lines.k[i], lines.norm2[i], lines.squared[i], lines.foot_a[i], lines.foot_w[i]};
  }

  /// Line `k` of a coordinate, wherever it is.
  Line line(Eigen::Index coordinate, double k, const Sight& s) const noexcept {
    const Eigen::Index along = 1 - coordinate;
    const Eigen::Vector2d normal(rows_(coordinate, 0) - k * row_w_.x(), rows_(coordinate, 1) - k * row_w_.y());
    const double e = s.a[coordinate] - k * s.w, norm2 = normal.squaredNorm();
    return {coordinate,
            k,
            norm2,
            e * e / norm2,
            norm2 * s.a[along] - e * (rows_(along, 0) * normal.x() + rows_(along, 1) * normal.y()),
            norm2 * s.w - e * (row_w_.x() * normal.x() + row_w_.y() * normal.y())};
  }

  /// By how much `foot_a - point foot_w` changes over so long a way in the image at a lattice point of the line.
  double at_point(const Line& line, int point, double way) const noexcept {
    const double z = steps_(2, line.coordinate) * line.k + steps_(2, 1 - line.coordinate) * point + h0_.z();
    return way * determinant_ * z * std::sqrt(line.norm2);
  }

  /// The points E on line `k` of a coordinate and F on the line of sight that are nearest to each other: Eqs. (3) to
  /// (5).
  struct Nearest {
    Eigen::Vector3d E, F;
    bool exists;  ///< false if the line points at the camera
  };

  /// @param begin,end of the edge on the line, which E does not leave
  [[gnu::always_inline]] Nearest nearest_points(Eigen::Index coordinate, double k, double begin, double end,
                                                const Eigen::Vector2d& m) const noexcept {
    // On B + a2 D: D along the line, a cell long, B on its zero.
    const double *const D = &steps_(0, 1 - coordinate), *const across = &steps_(0, coordinate);
    const double B_x = h0_.x() + k * across[0], B_y = h0_.y() + k * across[1], B_z = h0_.z() + k * across[2];
    const double MM = m.x() * m.x() + m.y() * m.y() + 1, MD = D[0] * m.x() + D[1] * m.y() + D[2];
    const double MB = B_x * m.x() + B_y * m.y() + B_z;
    const double DD = D[0] * D[0] + D[1] * D[1] + D[2] * D[2], DB = D[0] * B_x + D[1] * B_y + D[2] * B_z;
    const double determinant = MM * DD - MD * MD;
    const double a2 = std::min(std::max((MD * MB - MM * DB) / determinant, begin), end);
    const double a1 = (MB + a2 * MD) / MM;  // E on the line of sight
    return {{B_x + a2 * D[0], B_y + a2 * D[1], B_z + a2 * D[2]},
            {a1 * m.x(), a1 * m.y(), a1},
            determinant > 1e-6 * MM * DD};
  }

  /// A lattice point in the camera frame [m].
  Eigen::Vector3d point(double x, double y) const noexcept { return x * steps_.col(0) + y * steps_.col(1) + h0_; }

 private:
  [[gnu::always_inline]] Pair column(Eigen::Index i) const noexcept { return pair_at(&rows_(0, i)); }

  [[gnu::always_inline]] Eigen::Array4d of_corners(Eigen::Index axis) const noexcept {
    const double origin = h0_(axis), x = cells_ * steps_(axis, 0), y = cells_ * steps_(axis, 1);
    return {origin, origin + x, origin + y, origin + x + y};
  }

  double cells_ = 0, centre_ = 0, cell_ = 0;
  // Columns of H, homogeneous lattice coordinates to camera frame [m]: the steps to the next cell and the top left
  // corner.
  Eigen::Matrix<double, 3, 2> steps_ = Eigen::Matrix<double, 3, 2>::Zero();
  Eigen::Vector3d h0_{0, 0, 0};
  // Rows of H^-1, times the determinant of H.
  Eigen::Array<double, 2, 3> rows_ = Eigen::Array<double, 2, 3>::Zero();
  Eigen::Vector3d row_w_{0, 0, 0};
  double determinant_ = 0;
  double rate_ = 0;
};

}  // namespace evmarker
