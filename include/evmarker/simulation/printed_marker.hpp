#pragma once
// A code marker printed on white paper, seen through a blur.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/model/marker_model.hpp"

namespace evmarker {

/// Distance from an edge, in sigmas of the blur, from which on `edge_profile` is exactly 0 or 1.
inline constexpr double kEdgeReach = 4;

/// Profile of a straight edge behind a Gaussian blur of sigma 1: the integral of the normal distribution. Interpolated
/// in a table to within 1e-6 up to `kEdgeReach`, and rounded to 0 or 1 beyond.
inline double edge_profile(double x) {
  static constexpr int kSteps = 2048;
  static const auto table = [] {
    std::array<float, kSteps + 2> values{};
    for (int i = 0; i <= kSteps + 1; ++i)
      values[static_cast<std::size_t>(i)] =
          static_cast<float>(0.5 * std::erfc((1 - 2.0 * i / kSteps) * kEdgeReach / std::numbers::sqrt2));
    return values;
  }();
  if (!(x > -kEdgeReach)) return 0;
  if (x >= kEdgeReach) return 1;
  const double position = (x + kEdgeReach) * (kSteps / (2 * kEdgeReach));
  const int index = static_cast<int>(position);
  const float* const value = &table[static_cast<std::size_t>(index)];
  return static_cast<double>(value[0]) + (position - index) * static_cast<double>(value[1] - value[0]);
}

/// Reflectance of each cell of a sheet, rows from the top, columns from the left. The first and last row and column are
/// the quiet zone, the second and the last but one the black border.
using CellShades = Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The sheet on which a marker is printed. In its grid coordinates (a, b) the origin is the top left corner of the
/// black border, a points right, b points down, and the unit is a cell. The quiet zone lies around the border.
class PrintedMarker {
 public:
  /// What a point shows of the blurred sheet.
  struct Sample {
    double coverage = 0;   ///< share of the point that the sheet covers
    double radiance = 0;   ///< light from the sheet, weighted with the coverage
    double clearance = 0;  ///< points nearer than this along both axes look the same [cells]; 0 if none do
  };

  /// @param bits the cells inside the black border, 1 white
  /// @param quiet_zone_cells width of the white rim around the border
  /// @param black,white reflectance of ink and paper
  /// @param shades replace black and white on the front, one for each cell of border, code and quiet zone, unless empty
  /// @throws std::invalid_argument naming the argument that makes no sense
  PrintedMarker(const CodeBits& bits, double quiet_zone_cells, double black, double white,
                const CellShades& shades = {})
      : cells_(static_cast<int>(bits.rows()) + 2), white_(white) {
    const Require require("printed marker");
    require(bits.rows() > 0 && bits.rows() <= kMaxCells - 4, "number of code rows", static_cast<double>(bits.rows()));
    require(bits.cols() == bits.rows(), "number of code columns", static_cast<double>(bits.cols()));
    require(std::isfinite(quiet_zone_cells) && quiet_zone_cells >= 0, "quiet_zone_cells", quiet_zone_cells);
    require(std::isfinite(black) && black > 0, "black", black);
    require(std::isfinite(white) && white > 0, "white", white);

    edges_.push_back(-quiet_zone_cells);
    for (int i = 0; i <= cells_; ++i) edges_.push_back(i);
    edges_.push_back(cells_ + quiet_zone_cells);
    shades_.setConstant(cells_ + 2, cells_ + 2, white);
    shades_.block(1, 1, cells_, cells_).setConstant(black);
    for (Eigen::Index row = 0; row < bits.rows(); ++row)
      for (Eigen::Index column = 0; column < bits.cols(); ++column)
        shades_(row + 2, column + 2) = bits(row, column) != 0 ? white : black;
    if (shades.size() == 0) return;
    require(shades.rows() == shades_.rows(), "number of shade rows", static_cast<double>(shades.rows()));
    require(shades.cols() == shades_.cols(), "number of shade columns", static_cast<double>(shades.cols()));
    for (Eigen::Index row = 0; row < shades.rows(); ++row)
      for (Eigen::Index column = 0; column < shades.cols(); ++column) {
        const double shade = shades(row, column);
        const std::string field = "shade in row " + std::to_string(row) + ", column " + std::to_string(column);
        require(std::isfinite(shade) && shade > 0, field.c_str(), shade);
      }
    shades_ = shades;
  }

  /// Number of cells along a side of the black square, border included.
  int cells() const noexcept { return cells_; }
  /// Reflectance of the paper.
  double white() const noexcept { return white_; }
  /// Grid coordinates of the sheet's first and last edge.
  double first_edge() const noexcept { return edges_.front(); }
  double last_edge() const noexcept { return edges_.back(); }

  /// The front of the sheet at (a, b) behind a Gaussian blur of the given sigmas [cells, positive]. Exact along
  /// straight edges; at corners it is exact where the grid axes are perpendicular in the image.
  Sample front(double a, double b, double sigma_a, double sigma_b) const {
    const Weights columns(edges_, a, sigma_a), rows(edges_, b, sigma_b);
    Sample sample;
    if (columns.sum == 0 || rows.sum == 0) {
      sample.clearance = distance_to_sheet(a, b);
      return sample;
    }
    const double shade = shades_(rows.first, columns.first);
    bool uniform = columns.sum == 1 && rows.sum == 1;
    for (int row = rows.first; row <= rows.last; ++row) {
      double light = 0;
      for (int column = columns.first; column <= columns.last; ++column) {
        light += columns.weight[static_cast<std::size_t>(column)] * shades_(row, column);
        uniform = uniform && shades_(row, column) == shade;
      }
      sample.radiance += rows.weight[static_cast<std::size_t>(row)] * light;
    }
    sample.coverage = columns.sum * rows.sum;
    if (uniform) {
      sample.radiance = shade;  // free of rounding: a point inside a cell must not flicker
      sample.clearance = distance_to_other_shade(a, b, rows.first, columns.first);
    }
    return sample;
  }

  /// The blank back of the sheet, with the arguments of `front`.
  Sample back(double a, double b, double sigma_a, double sigma_b) const {
    const auto profile = [&](double x, double sigma) {
      return edge_profile((x - first_edge()) / sigma) - edge_profile((x - last_edge()) / sigma);
    };
    const double coverage = profile(a, sigma_a) * profile(b, sigma_b);
    double clearance = 0;
    if (coverage == 0) clearance = distance_to_sheet(a, b);
    if (coverage == 1) clearance = distance_to_rim(a, b);
    return {coverage, coverage * white_, clearance};
  }

 private:
  static constexpr int kMaxCells = 64;

  // Weights of the columns (or rows) of the grid at a blurred point: the integral of the blur over each.
  struct Weights {
    std::array<double, kMaxCells> weight;  // only first..last are set
    int first, last;
    double sum;

    Weights(const std::vector<double>& edges, double x, double sigma) {
      const int columns = static_cast<int>(edges.size()) - 1;
      const double reach = kEdgeReach * sigma;
      const auto column_at = [&](double position) {
        return position < 0 ? 0 : position >= columns - 2 ? columns - 1 : 1 + static_cast<int>(position);
      };
      first = column_at(x - reach);
      last = column_at(x + reach);
      const double sharpness = 1 / sigma;
      const double begin = edge_profile((x - edges[static_cast<std::size_t>(first)]) * sharpness);
      double left = begin;
      for (int column = first; column <= last; ++column) {
        const double right = edge_profile((x - edges[static_cast<std::size_t>(column) + 1]) * sharpness);
        weight[static_cast<std::size_t>(column)] = left - right;
        left = right;
      }
      sum = begin - left;
    }
  };

  // Distances along the axis on which they are larger; 0 on the sheet.
  double distance_to_sheet(double a, double b) const {
    const auto outside = [&](double x) { return std::max({first_edge() - x, x - last_edge(), 0.0}); };
    return std::max(outside(a), outside(b));
  }

  // Distance of a point on the sheet from the sheet's nearest edge.
  double distance_to_rim(double a, double b) const {
    return std::min({a - first_edge(), last_edge() - a, b - first_edge(), last_edge() - b});
  }

  // Distance of a point in a cell to the nearest cell of another shade, or to the end of the neighbouring cells if
  // those have the same shade: a lower bound of the true distance that is quick to compute.
  double distance_to_other_shade(double a, double b, int row, int column) const {
    double distance = distance_to_rim(a, b);
    const int first_row = std::max(row - 1, 0), last_row = std::min(row + 1, cells_ + 1);
    const int first_column = std::max(column - 1, 0), last_column = std::min(column + 1, cells_ + 1);
    const auto gap = [&](double x, int i) { return std::max({edge(i) - x, x - edge(i + 1), 0.0}); };
    for (int r = first_row; r <= last_row; ++r)
      for (int c = first_column; c <= last_column; ++c)
        if (shades_(r, c) != shades_(row, column)) distance = std::min(distance, std::max(gap(a, c), gap(b, r)));
    const double to_end_of_neighbours =
        std::min({a - edge(first_column), edge(last_column + 1) - a, b - edge(first_row), edge(last_row + 1) - b});
    return std::min(distance, to_end_of_neighbours);
  }

  double edge(int i) const { return edges_[static_cast<std::size_t>(i)]; }

  int cells_;
  double white_;
  std::vector<double> edges_;  // grid lines, the sheet's own edges included
  CellShades shades_;
};

}  // namespace evmarker
