#pragma once
// How far errors that all events of an edge share shift the pose.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "evmarker/base/cholesky.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/simd/pack.hpp"

namespace evmarker {

/// Measures the errors of whole edges: ink that has spread, an offset that depends on contrast, corners that are round,
/// a lens that its calibration does not quite describe. They do not average out over events, so that a filter which
/// takes events for independent is too sure of its pose. What they do to the pose follows from the means of the
/// residuals of each edge, as in the cluster-robust ("sandwich") covariance of a regression.
///
/// What differs between an edge's means over two motions is no such error, but the noise of its events. It tells how
/// fast that averages out: events that lie evenly over an edge's width, as in an ideal sensor, have an exact mean; on a
/// real sensor, their mean varies like that of independent ones.
class EdgeScatter {
 public:
  static constexpr std::size_t kStates = 7;  ///< of a row: pose and edge offset
  using Row = std::array<double, kStates>;   ///< how a residual grows with an error of these

  /// Adds the residual of an event.
  /// @param edge its number; edges whose numbers are equal modulo 64 count as one
  [[gnu::always_inline]] void add(int edge, double residual_px, double weight) noexcept {
    edges_[static_cast<std::size_t>(edge) % kEdges] += weight * simd::Pair{residual_px, 1};
  }

  /// Adds the row and the residual of an event. It need not be every event, only a fair sample.
  [[gnu::always_inline]] void add_row(const Row& row, double residual_px, double weight) noexcept {
    for (std::size_t k = 0; k < kStates; ++k)
      for (std::size_t i = 0; i <= k; ++i) rows_[k][i] += weight * row[k] * row[i];
    rows_weight_ += weight;
    rows_squares_ += weight * weight * residual_px * residual_px;
    ++row_count_;
  }

  /// Ends the first half of a motion, whose means are compared with those of the second. Both should be longer than the
  /// edges are wide, so that the events on both sides of them have cancelled.
  void end_first_half() noexcept {
    first_half_ = std::exchange(edges_, {});
    in_second_half_ = true;
  }
  bool in_second_half() const noexcept { return in_second_half_; }

  /// Evaluates what has been added, and begins anew: to be called at the end of a motion. Goes on adding while there
  /// are too few rows.
  void evaluate() noexcept {
    if (row_count_ < kFewestRows) return;
    if (in_second_half_) compare_halves();
    double squares = 0, weight = 0, weight2 = 0;
    int count = 0;
    for (const simd::Pair& edge : edges_) {
      const double edge_weight = edge[1];
      if (!(edge_weight > 0)) continue;
      squares += edge[0] * edge[0] / edge_weight;
      weight += edge_weight;
      weight2 += edge_weight * edge_weight;
      ++count;
    }
    if (weight > 0 && rows_weight_ > 0) {
      const double variance = std::max(0.0, squares - count * event_noise() * if_independent_px2()) / weight;
      variance_px2_ = known_ ? variance_px2_ + kShare * (variance - variance_px2_) : variance;
      known_ = true;
      spread_to_pose(weight2 / (weight * weight));
    }
    edges_ = {};
    rows_ = {};
    rows_weight_ = rows_squares_ = 0;
    row_count_ = 0;
  }

  /// Covariance of the pose by the errors of the edges, order as in PoseEstimate; zero until the first evaluation.
  Matrix6d covariance() const noexcept { return variance_px2_ * covariance_per_px2_; }
  /// That covariance for edges whose mean squared error is 1 px^2.
  const Matrix6d& covariance_per_px2() const noexcept { return covariance_per_px2_; }
  /// Variance of the mean of many residuals by the noise of their events, relative to that of independent ones, which
  /// it is taken to be until it has been measured. ("Design effect" in the statistics of surveys.)
  double event_noise() const noexcept { return if_independent_px2_ > 0 ? noise_px2_ / if_independent_px2_ : 1; }
  /// Mean squared error of an edge, along its normal [px^2].
  double variance_px2() const noexcept { return variance_px2_; }
  /// About the share of the events of which it is known on which side their edge is dark, each weighted by the square
  /// of its contrast.
  double share_of_known_dark_sides() const noexcept { return share_of_known_dark_sides_; }

 private:
  static constexpr std::size_t kEdges = 64;
  static constexpr int kFewestRows = 3 * kStates;     // fewer may not tell of all states
  static constexpr double kShare = 0.25;              // of an evaluation in the running means
  static constexpr double kShareOfDifference = 0.01;  // of an edge in those of the noise: a few edges tell little of it
  static constexpr double kLeastInformation =
      1e-6;  // of the offset, where no dark side is known; it is about 1 where all are

  // The mean of residuals whose weights are W in all would have this variance, divided by W, if they were independent.
  double if_independent_px2() const noexcept { return rows_squares_ / rows_weight_; }

  // The means m of an edge's two halves, whose weights are a and b, differ by noise: (m - m')^2 a b / (a + b) is that
  // variance as it is. Then adds the first half to the second.
  void compare_halves() noexcept {
    double squares = 0;
    int count = 0;
    for (std::size_t k = 0; k < kEdges; ++k) {
      const double a = first_half_[k][1], b = edges_[k][1];
      if (a > 0 && b > 0) {
        const double difference = first_half_[k][0] / a - edges_[k][0] / b;
        squares += difference * difference * a * b / (a + b);
        ++count;
      }
      edges_[k] += first_half_[k];
    }
    if (count > 0 && rows_weight_ > 0) {
      const double share = std::min(kShare, count * kShareOfDifference);
      noise_px2_ += share * (squares / count - noise_px2_);
      if_independent_px2_ += share * (if_independent_px2() - if_independent_px2_);
    }
    in_second_half_ = false;
  }

  // The pose errs as if found by as many measurements as there are edges, in effect, each with the error of an edge.
  // @param by_count the reciprocal of their effective number, see evaluate
  void spread_to_pose(double by_count) noexcept {
    std::array<Row, kStates> information = rows_;
    for (Row& row : information)
      for (double& x : row) x /= rows_weight_;
    double& of_offset = information[kStates - 1][kStates - 1];
    share_of_known_dark_sides_ = std::min(1.0, of_offset);
    of_offset += kLeastInformation;
    const Cholesky<kStates> factors(information);
    Matrix6d covariance;
    for (std::size_t k = 0; k < 6; ++k) {
      Row unit{};
      unit[k] = 1;
      const Row column = factors.solve(unit);  // of the inverse
      if (!std::isfinite(column[k])) return;
      for (std::size_t i = 0; i < 6; ++i) covariance.data()[6 * k + i] = by_count * column[i];
    }
    covariance_per_px2_ = covariance;
  }

  std::array<simd::Pair, kEdges> edges_{};  // of each, the sums of weight residual and of weight
  std::array<simd::Pair, kEdges> first_half_{};
  bool in_second_half_ = false;
  std::array<Row, kStates> rows_{};            // sum of weight row row^T, lower triangle
  double rows_weight_ = 0, rows_squares_ = 0;  // sums of weight, and of (weight residual)^2
  int row_count_ = 0;
  double noise_px2_ = 0, if_independent_px2_ = 0;  // running means of the variance as it is and as it would be
  double variance_px2_ = 0, share_of_known_dark_sides_ = 0;
  bool known_ = false;
  Matrix6d covariance_per_px2_ = Matrix6d::Zero();
};

}  // namespace evmarker
