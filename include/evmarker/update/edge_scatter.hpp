#pragma once
// How far errors that all events of an edge share shift the pose.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/base/cholesky.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/simd/pack.hpp"

namespace evmarker {

/// Measures the errors of whole edges: ink that has spread, an offset that depends on contrast, corners that are round,
/// a lens that its calibration does not quite describe. They do not average out over events, so that a filter which
/// takes events for independent is too sure of its pose. What they do to the pose follows from the means of the
/// residuals of each edge, as in the cluster-robust ("sandwich") covariance of a regression.
class EdgeScatter {
 public:
  static constexpr std::size_t kStates = 7;  ///< of a row: pose and edge offset
  using Row = std::array<double, kStates>;   ///< how a residual grows with an error of these

  /// Adds the residual of an event.
  /// @param edge its number; edges whose numbers are equal modulo 64 count as one
  [[gnu::always_inline]] void add(int edge, double residual_px, double weight) noexcept {
    edges_[static_cast<std::size_t>(edge) % kEdges] += weight * simd::Pair{residual_px, 1};
  }

  /// Adds the row of an event. It need not be that of every event, only a fair sample.
  [[gnu::always_inline]] void add_row(const Row& row, double weight) noexcept {
    for (std::size_t k = 0; k < kStates; ++k)
      for (std::size_t i = 0; i <= k; ++i) rows_[k][i] += weight * row[k] * row[i];
    rows_weight_ += weight;
    ++row_count_;
  }

  /// Evaluates what has been added, and begins anew: to be called when the edges have moved by several times their
  /// width, so that the events on both sides of them have cancelled. Goes on adding while there are too few rows.
  void evaluate() noexcept {
    if (row_count_ < kFewestRows) return;
    double squares = 0, weight = 0, weight2 = 0;
    for (const simd::Pair& edge : edges_) {
      const double edge_weight = edge[1];
      if (!(edge_weight > 0)) continue;
      squares += edge[0] * edge[0] / edge_weight;
      weight += edge_weight;
      weight2 += edge_weight * edge_weight;
    }
    if (weight > 0 && rows_weight_ > 0) {
      const double variance = squares / weight;
      variance_px2_ = known_ ? variance_px2_ + kShare * (variance - variance_px2_) : variance;
      known_ = true;
      spread_to_pose(variance_px2_ * weight2 / (weight * weight));
    }
    edges_ = {};
    rows_ = {};
    rows_weight_ = 0;
    row_count_ = 0;
  }

  /// Covariance of the pose by the errors of the edges, order as in PoseEstimate; zero until the first evaluation.
  const Matrix6d& covariance() const noexcept { return covariance_; }
  /// Factor of that covariance for edges that err by more than is measured.
  /// @param more_px2 variance of their errors beside the measured one [px^2]
  double covariance_factor(double more_px2) const noexcept {
    return variance_px2_ > 0 ? 1 + more_px2 / variance_px2_ : 1;
  }
  /// Mean squared error of an edge, along its normal [px^2].
  double variance_px2() const noexcept { return variance_px2_; }
  /// About the share of the events of which it is known on which side their edge is dark, each weighted by the square
  /// of its contrast.
  double share_of_known_dark_sides() const noexcept { return share_of_known_dark_sides_; }

 private:
  static constexpr std::size_t kEdges = 64;
  static constexpr int kFewestRows = 3 * kStates;  // fewer may not tell of all states
  static constexpr double kShare = 0.25;           // of an evaluation in the running mean of the variance
  static constexpr double kLeastInformation =
      1e-6;  // of the offset, where no dark side is known; it is about 1 where all are

  // Edges that err with variance v, and whose effective number is k, see evaluate: the pose errs as if found by k
  // measurements of variance v.
  // @param variance_by_count v / k
  void spread_to_pose(double variance_by_count) noexcept {
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
      for (std::size_t i = 0; i < 6; ++i) covariance.data()[6 * k + i] = variance_by_count * column[i];
    }
    covariance_ = covariance;
  }

  std::array<simd::Pair, kEdges> edges_{};  // of each, the sums of weight residual and of weight
  std::array<Row, kStates> rows_{};         // sum of weight row row^T, lower triangle
  double rows_weight_ = 0;
  int row_count_ = 0;
  double variance_px2_ = 0, share_of_known_dark_sides_ = 0;
  bool known_ = false;
  Matrix6d covariance_ = Matrix6d::Zero();
};

}  // namespace evmarker
