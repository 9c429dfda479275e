#pragma once
// A code marker's grid of cells as a camera sees it: its homography, and the lines nearest to an event.
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

/// A line of a grid and an event's foot on it, in the image of lines of sight (m; 1). `Number` is one number, or one
/// for each of two lines.
template <typename Number>
struct GridLine {
  Number e;                   ///< the line's equation (row - k row_w) (m; 1) at the event
  Number normal_x, normal_y;  ///< toward larger coordinates, not of unit length
  Number norm2;               ///< its squared length: the squared distance is e^2 / norm2
  Number foot_a, foot_w;      ///< homogeneous coordinate along the line of the foot, m - e / norm2 normal
};

/// @param k number of the line among those of its coordinate
/// @param row_x,row_y of the inverse homography, for that coordinate; along_x,along_y for the other; w_x,w_y the third
/// @param a,a_along,w the event in homogeneous coordinates of the grid
template <typename Number>
[[gnu::always_inline]] inline GridLine<Number> grid_line(Number k, Number row_x, Number row_y, Number along_x,
                                                         Number along_y, double w_x, double w_y, Number a,
                                                         Number a_along, double w) noexcept {
  GridLine<Number> line;
  line.e = a - k * w;
  line.normal_x = row_x - k * w_x;
  line.normal_y = row_y - k * w_y;
  line.norm2 = line.normal_x * line.normal_x + line.normal_y * line.normal_y;
  line.foot_a = line.norm2 * a_along - line.e * (along_x * line.normal_x + along_y * line.normal_y);
  line.foot_w = line.norm2 * w - line.e * (w_x * line.normal_x + w_y * line.normal_y);
  return line;
}

/// The grid of `GridEdges` at one pose, by its homography. The image is that of lines of sight (m; 1), distances in it
/// are tangents. What is computed for every event is computed for the nearest vertical (element 0) and horizontal line
/// at once: two numbers fit into a register, and which line will count cannot be foreseen.
class ProjectedGrid {
 public:
  static constexpr int kMaxFringe = 2;  ///< cells around the marker over which `rate()` holds

  ProjectedGrid() = default;
  ProjectedGrid(int cells, double cell_length_m) : cells_(cells), centre_(cells / 2.0), cell_(cell_length_m) {}

  /// Computes the homography H = [step_x, step_y, corner] and its inverse at a pose. False while the marker is not
  /// wholly in front of the camera, seen from behind, or not finite.
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

  /// Where the grid's four corners are seen, (X/Z, Y/Z).
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
  /// True if the corners are less than `distance` [tangent] away from `there`, in either coordinate.
  [[gnu::always_inline]] bool near(const Corners& there, double distance) const noexcept {
    const std::array<double, 4> X = of_corners(&Vec3::x), Y = of_corners(&Vec3::y), Z = of_corners(&Vec3::z);
    double least[4];
    for (std::size_t i = 0; i < 4; ++i)
      least[i] = distance * Z[i] - simd::larger(std::abs(X[i] - there.x[i] * Z[i]), std::abs(Y[i] - there.y[i] * Z[i]));
    return simd::smaller(simd::smaller(least[0], least[1]), simd::smaller(least[2], least[3])) > 0;
  }

  /// A bound on the change of grid coordinates [cells] by a unit of the tangent, up to `reach` [tangent] from the
  /// grid's lines; not positive if there is none. Changes rarely while the marker moves.
  double bound_rate(double reach) noexcept {
    const double z_far = corner_.z + std::max(cells_ * steps_[0].z, 0.0) + std::max(cells_ * steps_[1].z, 0.0);
    // w = determinant / z on the marker; its least value, times z_far, where an event may still be near an edge.
    const double w = determinant_ - reach * z_far * (std::abs(row_w_.x) + std::abs(row_w_.y));
    // Grid coordinates change by at most |row - k row_w| / w by the tangent, most on one of the outermost lines.
    double steepest = 0;
    for (const double k : {-1.0 * kMaxFringe, cells_ + kMaxFringe})
      for (std::size_t i = 0; i < 2; ++i)
        steepest = std::max(steepest, squared_norm(Vec2(rows_[0][i] - k * row_w_.x, rows_[1][i] - k * row_w_.y)));
    const double squared = z_far * z_far * steepest;
    // The bound leaves room for small motions, so that it need not be computed, with a root and a division, every time.
    const double squared_bound = rate_ * rate_ * w * w;
    if (!(w > 0 && squared <= squared_bound && squared_bound <= 1.3 * squared)) rate_ = 1.05 * std::sqrt(squared) / w;
    return rate_;
  }
  double rate() const noexcept { return rate_; }
  double cells() const noexcept { return cells_; }

  /// Homogeneous grid coordinates (x, y; 1) to camera frame [m]: the step to the next cell, and the top left corner.
  const Vec3& step(std::size_t coordinate) const noexcept { return steps_[coordinate]; }
  const Vec3& corner() const noexcept { return corner_; }
  /// The inverse, but for a factor: the row of a coordinate, and the third.
  Vec3 row(std::size_t coordinate) const noexcept {
    return {rows_[0][coordinate], rows_[1][coordinate], rows_[2][coordinate]};
  }
  const Vec3& row_w() const noexcept { return row_w_; }

  /// An event in homogeneous grid coordinates (a; w): those of the line of sight's intersection with the marker.
  struct Sight {
    simd::Pair a;
    double w;
  };

  [[gnu::always_inline]] Sight sight(Vec2 m) const noexcept {
    return {column(0) * m.x + column(1) * m.y + column(2), row_w_.x * m.x + row_w_.y * m.y + row_w_.z};
  }

  /// True if an event is on the marker or at most `fringe` cells beside it.
  // Without a division: the processor cannot predict the result, and what follows has to wait for it.
  [[gnu::always_inline]] bool within(double fringe, const Sight& s) const noexcept {
    const simd::Pair from_centre = s.a - centre_ * s.w;
    return simd::larger(std::abs(from_centre[0]), std::abs(from_centre[1])) < (centre_ + fringe) * s.w;
  }

  /// 1/Z [1/m] of the point of the marker's plane that the event's line of sight meets.
  double inverse_depth(const Sight& s) const noexcept { return s.w / determinant_; }

  /// Adding and subtracting this rounds a number; the last bits of the sum are the integer.
  // SSE2 cannot round, and a conversion to an integer and back takes longer.
  static constexpr double kRounding = 0x1.8p52;
  static int rounded(double sum) noexcept { return static_cast<int>(std::bit_cast<std::int64_t>(sum)); }

  /// The nearest vertical and horizontal line, and the event's feet on them.
  struct Lines : GridLine<simd::Pair> {
    simd::Pair k, k_sum;  ///< their numbers, and with kRounding added
    simd::Pair squared;   ///< the squared distances
  };

  [[gnu::always_inline]] Lines nearest_lines(const Sight& s) const noexcept {
    Lines lines;
    lines.k_sum = simd::smaller(simd::larger(s.a / s.w, simd::Pair{}), simd::Pair{} + cells_) + kRounding;
    lines.k = lines.k_sum - kRounding;
    static_cast<GridLine<simd::Pair>&>(lines) =
        grid_line(lines.k, column(0), column(1), simd::swapped(column(0)), simd::swapped(column(1)), row_w_.x, row_w_.y,
                  s.a, simd::swapped(s.a), s.w);
    lines.squared = lines.e * lines.e / lines.norm2;
    return lines;
  }

  /// One line, and the event's foot on it.
  struct Line {
    std::size_t coordinate;
    double k, norm2, squared, foot_a, foot_w;
  };

  static Line line(const Lines& lines, std::size_t i) noexcept {
    return {i, lines.k[i], lines.norm2[i], lines.squared[i], lines.foot_a[i], lines.foot_w[i]};
  }

  /// Line `k` of a coordinate, wherever it is.
  Line line(std::size_t coordinate, double k, const Sight& s) const noexcept {
    const std::size_t along = 1 - coordinate;
    const GridLine<double> line = grid_line(k, rows_[0][coordinate], rows_[1][coordinate], rows_[0][along],
                                            rows_[1][along], row_w_.x, row_w_.y, s.a[coordinate], s.a[along], s.w);
    return {coordinate, k, line.norm2, line.e * line.e / line.norm2, line.foot_a, line.foot_w};
  }

  /// The change of `foot_a - point foot_w` over a way in the image [tangent] at a grid point of the line.
  double at_point(const Line& line, int point, double way) const noexcept {
    const double z = steps_[line.coordinate].z * line.k + steps_[1 - line.coordinate].z * point + corner_.z;
    return way * determinant_ * z * std::sqrt(line.norm2);
  }

  /// A grid point in the camera frame [m].
  Vec3 point(double x, double y) const noexcept { return x * steps_[0] + y * steps_[1] + corner_; }

 private:
  [[gnu::always_inline]] simd::Pair column(std::size_t i) const noexcept { return simd::pair_at(rows_[i].data()); }

  [[gnu::always_inline]] std::array<double, 4> of_corners(double Vec3::*axis) const noexcept {
    const double origin = corner_.*axis, x = cells_ * steps_[0].*axis, y = cells_ * steps_[1].*axis;
    return {origin, origin + x, origin + y, origin + x + y};
  }

  double cells_ = 0, centre_ = 0, cell_ = 0;
  // Columns of H, homogeneous grid coordinates to camera frame [m].
  std::array<Vec3, 2> steps_;
  Vec3 corner_;
  // Rows of H^-1, times the determinant of H; those of both coordinates side by side.
  std::array<std::array<double, 2>, 3> rows_{};
  Vec3 row_w_;
  double determinant_ = 0;
  double rate_ = 0;
};

}  // namespace evmarker
