#pragma once
// The image of a code marker's grid of cells: its homography, and its lines nearest to an event.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "evmarker/base/vector.hpp"
#include "evmarker/simd/lanes.hpp"
#include "evmarker/simd/pack.hpp"

namespace evmarker {

/// A line of a grid and the foot of an event's perpendicular on it, in the image of lines of sight (m; 1). `Number` is
/// one number, or a pair of numbers for two lines.
template <typename Number>
struct GridLine {
  Number e;                   ///< equation of line k, (row - k row_w) (m; 1) with the rows of H^-1, at the event
  Number normal_x, normal_y;  ///< normal toward larger coordinates, not of unit length
  Number norm2;               ///< squared length of the normal; the squared distance is e^2 / norm2
  Number foot_a, foot_w;      ///< the foot's homogeneous coordinate along the line; its image is m - e / norm2 normal
};

/// Computes a grid line and an event's foot on it.
/// @param k number of the line among those of its coordinate
/// @param row_x,row_y first two elements of the inverse homography's row for that coordinate
/// @param along_x,along_y the same of the other coordinate's row, w_x,w_y of the third row
/// @param a,a_along,w the event in homogeneous grid coordinates: that coordinate, the other one, and the third
template <typename Number>
[[gnu::always_inline]] inline GridLine<Number> grid_line(Number k, Number row_x, Number row_y, Number along_x,
                                                         Number along_y, double w_x, double w_y, Number a,
                                                         Number a_along, double w) noexcept {
  GridLine<Number> line;
  line.e = a - k * w;
  line.normal_x = row_x - k * w_x;
  line.normal_y = row_y - k * w_y;
  line.norm2 = line.normal_x * line.normal_x + line.normal_y * line.normal_y;
  // `along` and w at the foot m - e / norm2 normal, both times norm2 in place of a division.
  line.foot_a = line.norm2 * a_along - line.e * (along_x * line.normal_x + along_y * line.normal_y);
  line.foot_w = line.norm2 * w - line.e * (w_x * line.normal_x + w_y * line.normal_y);
  return line;
}

/// The grid of `GridEdges` at one pose, as a homography. The image is that of lines of sight (m; 1), so that distances
/// in it are tangents. For every event, the nearest vertical (element 0) and the nearest horizontal line (element 1)
/// are computed at once: two numbers fit into a register, and which line is the nearer one cannot be predicted.
class ProjectedGrid {
 public:
  static constexpr int kMaxFringe = 2;  ///< cells around the marker over which `rate()` holds

  ProjectedGrid() = default;
  /// @param cells along a side
  ProjectedGrid(int cells, double cell_length_m) : cells_(cells), centre_(cells / 2.0), cell_(cell_length_m) {}

  /// Computes the homography H = [step_x, step_y, corner] and its inverse at a pose. Returns false, and the grid must
  /// not be used, if the marker is not wholly in front of the camera, is seen from behind, or the pose is not finite.
  bool project(const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Vec3 h_x = cell_ * axis(T_camera_marker, 0), h_y = -cell_ * axis(T_camera_marker, 1);
    steps_ = {h_x, h_y};
    corner_ = translation(T_camera_marker) - centre_ * (h_x + h_y);
    const Vec3 row_x = cross(h_y, corner_), row_y = cross(corner_, h_x);
    row_w_ = cross(h_x, h_y);
    determinant_ = dot(row_w_, corner_);
    if (!(determinant_ > 0)) return false;  // seen from behind
    rows_ = {{{row_x.x, row_y.x}, {row_x.y, row_y.y}, {row_x.z, row_y.z}}};
    const double z_near = corner_.z + std::min(cells_ * h_x.z, 0.0) + std::min(cells_ * h_y.z, 0.0);
    const Vec3 out = axis(T_camera_marker, 2);
    return z_near > 1e-6 && std::isfinite(determinant_ + (out.x + out.y + out.z));
  }

  /// Images (X/Z, Y/Z) of the grid's four corners.
  struct Corners {
    std::array<double, 4> x{}, y{};
  };
  Corners corners() const noexcept {
    Corners corners;
    const std::array<double, 4> X = of_corners(&Vec3::x), Y = of_corners(&Vec3::y), Z = of_corners(&Vec3::z);
    for (std::size_t i = 0; i < 4; ++i) {
      corners.x[i] = X[i] / Z[i];
      corners.y[i] = Y[i] / Z[i];
    }
    return corners;
  }
  /// True if each corner is less than `distance` [tangent] away from that in `there`, in both coordinates.
  [[gnu::always_inline]] bool near(const Corners& there, double distance) const noexcept {
    const std::array<double, 4> X = of_corners(&Vec3::x), Y = of_corners(&Vec3::y), Z = of_corners(&Vec3::z);
    double least[4];
    for (std::size_t i = 0; i < 4; ++i)
      least[i] = distance * Z[i] - simd::larger(std::abs(X[i] - there.x[i] * Z[i]), std::abs(Y[i] - there.y[i] * Z[i]));
    return simd::smaller(simd::smaller(least[0], least[1]), simd::smaller(least[2], least[3])) > 0;
  }

  /// Computes a bound on how fast grid coordinates change in the image [cells per tangent], up to `reach` [tangent]
  /// from the grid's lines, and returns it; not positive if there is none. An earlier bound that still holds is kept,
  /// so that it changes rarely while the marker moves.
  double bound_rate(double reach) noexcept {
    const double z_far = corner_.z + std::max(cells_ * steps_[0].z, 0.0) + std::max(cells_ * steps_[1].z, 0.0);
    // w is determinant / z on the marker; its least value, times z_far, where an event may still be near an edge.
    const double w_times_z = determinant_ - reach * z_far * (std::abs(row_w_.x) + std::abs(row_w_.y));
    // Grid coordinates change by at most |row - k row_w| / w per tangent; the largest is that of an outermost line.
    double steepest = 0;
    for (const double k : {-1.0 * kMaxFringe, cells_ + kMaxFringe})
      for (std::size_t i = 0; i < 2; ++i)
        steepest = std::max(steepest, squared_norm(Vec2(rows_[0][i] - k * row_w_.x, rows_[1][i] - k * row_w_.y)));
    const double needed2 = z_far * z_far * steepest, kept2 = rate_ * rate_ * w_times_z * w_times_z;  // of rate w z
    // The bound leaves room for small motions, so that it need not be computed, with a root and a division, every time.
    const bool holds = w_times_z > 0 && rate_ > 0 && needed2 <= kept2 && kept2 <= 1.3 * needed2;
    if (!holds) rate_ = 1.05 * std::sqrt(needed2) / w_times_z;
    return rate_;
  }
  /// The bound that `bound_rate` computed last.
  double rate() const noexcept { return rate_; }
  double cells() const noexcept { return cells_; }

  /// The columns of the homography, from homogeneous grid coordinates (x, y; 1) to the camera frame [m]: the step along
  /// a coordinate to the next cell, and the top left corner.
  const Vec3& step(std::size_t coordinate) const noexcept { return steps_[coordinate]; }
  const Vec3& corner() const noexcept { return corner_; }
  /// The rows of the inverse homography, up to a common factor: the row of a coordinate, and the third row.
  Vec3 row(std::size_t coordinate) const noexcept {
    return {rows_[0][coordinate], rows_[1][coordinate], rows_[2][coordinate]};
  }
  const Vec3& row_w() const noexcept { return row_w_; }

  /// The point where an event's line of sight meets the marker's plane, in homogeneous grid coordinates (a; w).
  struct GridPoint {
    simd::Pair a;
    double w;
  };

  /// @param m line of sight (m; 1)
  [[gnu::always_inline]] GridPoint grid_point(Vec2 m) const noexcept {
    return {column(0) * m.x + column(1) * m.y + column(2), row_w_.x * m.x + row_w_.y * m.y + row_w_.z};
  }

  /// True if an event is on the marker or less than `fringe` cells beside it.
  // Without a division, which would delay the branch that depends on the result and that is often mispredicted.
  [[gnu::always_inline]] bool within(double fringe, const GridPoint& s) const noexcept {
    const simd::Pair from_centre = s.a - centre_ * s.w;
    return simd::larger(std::abs(from_centre[0]), std::abs(from_centre[1])) < (centre_ + fringe) * s.w;
  }

  /// 1/Z [1/m] of the point where an event's line of sight meets the marker's plane.
  double inverse_depth(const GridPoint& s) const noexcept { return s.w / determinant_; }

  /// Adding this to a number and subtracting it again rounds the number to an integer.
  // SSE2 has no instruction for rounding, and a conversion to an integer and back takes longer.
  static constexpr double kRounding = 0x1.8p52;
  /// The integer from the last bits of the sum of a number and kRounding.
  static int rounded(double sum) noexcept { return static_cast<int>(std::bit_cast<std::int64_t>(sum)); }

  /// The vertical and the horizontal line nearest to an event in grid coordinates, which within half a cell are the
  /// nearest in the image, too, and the event's feet on them.
  struct Lines : GridLine<simd::Pair> {
    simd::Pair k, k_sum;  ///< numbers of the lines, and these with kRounding added
    simd::Pair squared;   ///< squared distances [tangent^2]
  };

  [[gnu::always_inline]] Lines nearest_lines(const GridPoint& s) const noexcept {
    Lines lines;
    lines.k_sum = simd::smaller(simd::larger(s.a / s.w, simd::Pair{}), simd::Pair{} + cells_) + kRounding;
    lines.k = lines.k_sum - kRounding;
    static_cast<GridLine<simd::Pair>&>(lines) =
        grid_line(lines.k, column(0), column(1), simd::swapped(column(0)), simd::swapped(column(1)), row_w_.x, row_w_.y,
                  s.a, simd::swapped(s.a), s.w);
    lines.squared = lines.e * lines.e / lines.norm2;
    return lines;
  }

  /// One line of a coordinate, and the event's foot on it.
  struct Line {
    std::size_t coordinate;
    double k, norm2, squared, foot_a, foot_w;
  };

  /// One of the two nearest lines: 0 the vertical, 1 the horizontal one.
  static Line line(const Lines& lines, std::size_t i) noexcept {
    return {i, lines.k[i], lines.norm2[i], lines.squared[i], lines.foot_a[i], lines.foot_w[i]};
  }

  /// Line `k` of a coordinate, be it near the event or not.
  Line line(std::size_t coordinate, double k, const GridPoint& s) const noexcept {
    const std::size_t along = 1 - coordinate;
    const GridLine<double> line = grid_line(k, rows_[0][coordinate], rows_[1][coordinate], rows_[0][along],
                                            rows_[1][along], row_w_.x, row_w_.y, s.a[coordinate], s.a[along], s.w);
    return {coordinate, k, line.norm2, line.e * line.e / line.norm2, line.foot_a, line.foot_w};
  }

  /// A way [tangent] along the line, near its grid point `point`, in units of foot_a - point foot_w: the cross product
  /// of two rows of H^-1, as it is kept, is the determinant times that point in the camera frame.
  double scaled_way(const Line& line, int point, double way) const noexcept {
    const double z = steps_[line.coordinate].z * line.k + steps_[1 - line.coordinate].z * point + corner_.z;
    return way * determinant_ * z * std::sqrt(line.norm2);
  }

  /// A grid point in the camera frame [m].
  Vec3 point(double x, double y) const noexcept { return x * steps_[0] + y * steps_[1] + corner_; }

 private:
  [[gnu::always_inline]] simd::Pair column(std::size_t i) const noexcept { return simd::pair_at(rows_[i].data()); }

  // One component of the four corners in the camera frame [m].
  [[gnu::always_inline]] std::array<double, 4> of_corners(double Vec3::*axis) const noexcept {
    const double origin = corner_.*axis, x = cells_ * steps_[0].*axis, y = cells_ * steps_[1].*axis;
    return {origin, origin + x, origin + y, origin + x + y};
  }

  double cells_ = 0, centre_ = 0, cell_ = 0;
  // Columns of H, from homogeneous grid coordinates to the camera frame [m].
  std::array<Vec3, 2> steps_;
  Vec3 corner_;
  // Rows of H^-1, times the determinant of H; the rows of both coordinates side by side.
  std::array<std::array<double, 2>, 3> rows_{};
  Vec3 row_w_;
  double determinant_ = 0;
  double rate_ = 0;  // see bound_rate
};

}  // namespace evmarker
