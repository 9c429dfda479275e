#pragma once
// Floor 1. A code marker's lattice of cells as a camera sees it: which of its lines are nearest to an event.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

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
  /// @param reach how far from the lattice's lines `rate()` is to hold [tangent]
  bool project(const Eigen::Isometry3d& T_camera_marker, double reach) noexcept {
    const auto& R = T_camera_marker.linear();
    const Eigen::Vector3d h_x = cell_ * R.col(0), h_y = -cell_ * R.col(1);
    steps_ << h_x, h_y;
    h0_ = T_camera_marker.translation() - centre_ * (h_x + h_y);
    const Eigen::Vector3d row_x = h_y.cross(h0_), row_y = h0_.cross(h_x);
    row_w_ = h_x.cross(h_y);
    determinant_ = row_w_.dot(h0_);
    if (!(determinant_ > 0)) return false;  // seen from behind
    rows_ << row_x.transpose(), row_y.transpose();
    row_w_x_.setConstant(row_w_.x());
    row_w_y_.setConstant(row_w_.y());
    along_x_ = {row_y.x(), row_x.x()};
    along_y_ = {row_y.y(), row_x.y()};
    D_x_ = {h_y.x(), h_x.x()};
    D_y_ = {h_y.y(), h_x.y()};
    D_z_ = {h_y.z(), h_x.z()};
    DD_ = {h_y.squaredNorm(), h_x.squaredNorm()};
    D_h0_ = {h_y.dot(h0_), h_x.dot(h0_)};
    h_x_h_y_.setConstant(h_x.dot(h_y));

    const double x = cells_ * h_x.z(), y = cells_ * h_y.z();
    const double z_near = h0_.z() + std::min(x, 0.0) + std::min(y, 0.0);
    const double z_far = h0_.z() + std::max(x, 0.0) + std::max(y, 0.0);
    if (!(z_near > 1e-6 && std::isfinite(determinant_ + R.col(2).sum()))) return false;
    bound_rate(z_far, reach);
    return true;
  }

  /// Lattice coordinates change by at most so many cells in a unit of the tangent; not positive where there is no such
  /// bound. Changes rarely while the marker moves.
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
    Eigen::Array2d a;
    double w;
  };

  [[gnu::always_inline]] Sight sight(const Eigen::Vector2d& m) const noexcept {
    return {rows_.col(0) * m.x() + rows_.col(1) * m.y() + rows_.col(2),
            row_w_.x() * m.x() + row_w_.y() * m.y() + row_w_.z()};
  }

  /// Whether an event is on the marker or so many cells around it. Without a division: whether one is cannot be
  /// foreseen, and what follows has to wait for it.
  [[gnu::always_inline]] bool within(double fringe, const Sight& s) const noexcept {
    return (s.a - centre_ * s.w).abs().maxCoeff() < (centre_ + fringe) * s.w;
  }

  /// 1/Z [1/m] of the point of the marker's plane that the event's line of sight meets.
  double nearness(const Sight& s) const noexcept { return s.w / determinant_; }

  /// The sum of a number and this ends in the bits of the nearest integer. SSE2 cannot round, and a conversion to an
  /// integer and back takes longer.
  static constexpr double kRounding = 0x1.8p52;
  static int rounded(double sum) noexcept { return static_cast<int>(std::bit_cast<std::int64_t>(sum)); }

  /// The nearest vertical and horizontal line, (row - k row_w) (m; 1) = 0 in the image, and the event's feet on them.
  struct Lines {
    Eigen::Array2d k, k_sum;            ///< their numbers, and with kRounding added
    Eigen::Array2d e;                   ///< the equation's value at the event
    Eigen::Array2d normal_x, normal_y;  ///< toward larger coordinates, not of unit length
    Eigen::Array2d norm2, squared;      ///< its squared length, and the squared distance
    Eigen::Array2d foot_a, foot_w;      ///< homogeneous coordinate along the line of m - e / norm2 normal
  };

  [[gnu::always_inline]] Lines nearest_lines(const Sight& s) const noexcept {
    Lines lines;
    lines.k_sum = (s.a / s.w).max(0.0).min(cells_) + kRounding;
    lines.k = lines.k_sum - kRounding;
    lines.e = s.a - lines.k * s.w;
    lines.normal_x = rows_.col(0) - lines.k * row_w_x_;
    lines.normal_y = rows_.col(1) - lines.k * row_w_y_;
    lines.norm2 = lines.normal_x.square() + lines.normal_y.square();
    lines.squared = lines.e.square() / lines.norm2;
    lines.foot_a = lines.norm2 * s.a.reverse() - lines.e * (along_x_ * lines.normal_x + along_y_ * lines.normal_y);
    lines.foot_w = lines.norm2 * s.w - lines.e * (row_w_x_ * lines.normal_x + row_w_y_ * lines.normal_y);
    return lines;
  }

  /// One line, and the event's foot on it.
  struct Line {
    Eigen::Index coordinate;
    double k, norm2, squared, foot_a, foot_w;
  };

  static Line line(const Lines& lines, Eigen::Index i) noexcept {
    return {i, lines.k(i), lines.norm2(i), lines.squared(i), lines.foot_a(i), lines.foot_w(i)};
  }

  /// Line `k` of a coordinate, wherever it is.
  Line line(Eigen::Index coordinate, double k, const Sight& s) const noexcept {
    const Eigen::Index along = 1 - coordinate;
    const Eigen::Vector2d normal(rows_(coordinate, 0) - k * row_w_.x(), rows_(coordinate, 1) - k * row_w_.y());
    const double e = s.a(coordinate) - k * s.w, norm2 = normal.squaredNorm();
    return {coordinate,
            k,
            norm2,
            e * e / norm2,
            norm2 * s.a(along) - e * (rows_(along, 0) * normal.x() + rows_(along, 1) * normal.y()),
            norm2 * s.w - e * (row_w_.x() * normal.x() + row_w_.y() * normal.y())};
  }

  /// By how much `foot_a - point foot_w` changes over so long a way in the image at a lattice point of the line.
  double at_point(const Line& line, int point, double way) const noexcept {
    const double z = steps_(2, line.coordinate) * line.k + steps_(2, 1 - line.coordinate) * point + h0_.z();
    return way * determinant_ * z * std::sqrt(line.norm2);
  }

  /// The points E on the line and F on the line of sight that are nearest to each other: Eqs. (3) to (5).
  struct Nearest {
    Eigen::Vector3d E, F;
    bool exists;  ///< false if the line points at the camera
  };

  /// @param begin,end of the edge on the line, which E does not leave
  [[gnu::always_inline]] Nearest nearest_points(const Lines& lines, Eigen::Index i, double begin, double end,
                                                const Eigen::Vector2d& m) const noexcept {
    // On B + a2 D: D along the line, a cell long, B on its zero. Of both lines, so that little waits for the choice.
    const Eigen::Array2d MD = D_x_ * m.x() + D_y_ * m.y() + D_z_;
    const Eigen::Array2d MB = (h0_.x() * m.x() + h0_.y() * m.y() + h0_.z()) + lines.k * MD.reverse();
    const Eigen::Array2d DB = D_h0_ + lines.k * h_x_h_y_;
    const double MM = m.x() * m.x() + m.y() * m.y() + 1, by_MM = 1 / MM;
    const Eigen::Array2d determinant = MM * DD_ - MD.square(), foot = (MD * MB - MM * DB) / determinant;
    const double k = lines.k(i), a2 = std::min(std::max(foot(i), begin), end);
    const double a1 = (MB(i) + a2 * MD(i)) * by_MM;  // E on the line of sight
    const double *const across = &steps_(0, i), *const along = &steps_(0, 1 - i);
    return {{h0_.x() + k * across[0] + a2 * along[0], h0_.y() + k * across[1] + a2 * along[1],
             h0_.z() + k * across[2] + a2 * along[2]},
            {a1 * m.x(), a1 * m.y(), a1},
            determinant(i) > 1e-6 * MM * DD_(i)};
  }

  /// A lattice point in the camera frame [m].
  Eigen::Vector3d point(double x, double y) const noexcept { return x * steps_.col(0) + y * steps_.col(1) + h0_; }

 private:
  void bound_rate(double z_far, double reach) noexcept {
    // w = determinant / z on the marker; its least value, times z_far, where an event may still be near an edge.
    const double w = determinant_ - reach * z_far * row_w_.head<2>().lpNorm<1>();
    // Lattice coordinates change by at most |row - k row_w| / w by the tangent, most on one of the outermost lines.
    const auto steepest = [&](double k) {
      return ((rows_.col(0) - k * row_w_x_).square() + (rows_.col(1) - k * row_w_y_).square()).maxCoeff();
    };
    const double squared = z_far * z_far * std::max(steepest(-kMaxFringe), steepest(cells_ + kMaxFringe));
    // The bound leaves room for small motions, so that it need not be computed, with a root and a division, every time.
    const double squared_bound = rate_ * rate_ * w * w;
    if (!(w > 0 && squared <= squared_bound && squared_bound <= 1.3 * squared)) rate_ = 1.05 * std::sqrt(squared) / w;
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
  // The same once more as both lines need it: the rows that count along them, row_w_ twice, and the coordinates and
  // products of their directions D.
  Eigen::Array2d along_x_{0, 0}, along_y_{0, 0}, row_w_x_{0, 0}, row_w_y_{0, 0};
  Eigen::Array2d D_x_{0, 0}, D_y_{0, 0}, D_z_{0, 0}, DD_{0, 0}, D_h0_{0, 0}, h_x_h_y_{0, 0};
  double rate_ = 0;
};

}  // namespace evmarker
