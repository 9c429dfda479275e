#pragma once
// Where markers are on a board: the poses of all of them that agree best with those tracked at many times.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "evmarker/base/median.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/pose_perturbation.hpp"

namespace evmarker {

/// The pose of one of a board's markers at one time.
struct MarkerSighting {
  std::size_t marker = 0;  ///< its place among the board's markers
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
  Matrix6d whitening = Matrix6d::Identity();  ///< W with W P W^T = I, P the covariance by which the pose counts
};

/// Markers seen at one time.
struct BoardView {
  std::vector<MarkerSighting> sightings;
  Eigen::Isometry3d T_camera_board = Eigen::Isometry3d::Identity();
};

/// Finds the poses of the markers on the board, of all but the first, and of the board in every view, that agree best
/// with the poses of single markers, each weighted by its whole covariance: depth and tilt are far less certain than
/// the place in the image. Levenberg-Marquardt, where each view is eliminated (Schur complement), so that the equations
/// are those of the markers alone, as in bundle adjustment (B. Triggs et al., "Bundle adjustment - a modern synthesis",
/// 2000). Wrong sightings, as with a mirrored tilt, have little weight (Cauchy's loss).
class BoardAdjustment {
 public:
  /// @param markers T_board_marker to start from; the first stays as it is, and each is in a view with another
  /// @param views with poses of the board to start from
  BoardAdjustment(std::vector<Eigen::Isometry3d> markers, std::vector<BoardView> views)
      : markers_(std::move(markers)), views_(std::move(views)) {}

  /// Finds the minimum. The loss is as wide as the median residual, at first that of the start.
  void solve() {
    for (int round = 0; round < kRounds; ++round) {
      const double before = std::exchange(scale_, std::max(median_residual(), kLeastScale));
      minimise();
      if (std::abs(scale_ - before) < 1e-3 * scale_) break;
    }
  }

  const std::vector<Eigen::Isometry3d>& markers() const noexcept { return markers_; }
  const std::vector<BoardView>& views() const noexcept { return views_; }
  /// How much a sighting counts: 1 where it agrees, near 0 where it is wrong.
  double weight(const BoardView& view, const MarkerSighting& sighting) const {
    return 1 / (1 + residual(view, sighting).squaredNorm() / (scale_ * scale_));
  }

  /// Covariance of the poses on the board of all markers but the first, one after the other, each of a perturbation as
  /// in PoseEstimate, in the board's frame. By the scatter of the residuals, which err alike in successive views.
  Eigen::MatrixXd covariance() const {
    const Eigen::MatrixXd S = reduce(0).S;
    return residual_variance() * S.ldlt().solve(Eigen::MatrixXd::Identity(S.rows(), S.cols()));
  }

 private:
  static constexpr int kRounds = 20, kSteps = 50;
  static constexpr double kLeastScale = 1e-3;  // of residuals without any noise

  // The normal equations of the markers after the views are eliminated, and what gives the steps of the views back.
  struct Reduced {
    Eigen::MatrixXd S;
    Eigen::VectorXd b;
    std::vector<Eigen::LDLT<Matrix6d>> solvers;      // of each view
    std::vector<Vector6d> gradients;                 // of each view
    std::vector<std::vector<Matrix6d>> couplings{};  // of each sighting: marker by view
  };

  // From the pose that the board gives a marker to the one that was tracked, whitened.
  Vector6d residual(const BoardView& view, const MarkerSighting& sighting) const {
    const Eigen::Isometry3d T = view.T_camera_board * markers_[sighting.marker];
    return sighting.whitening * pose_difference(T, sighting.T_camera_marker);
  }

  // How a marker's pose in the camera changes with that of the board in the camera.
  Matrix6d by_view(const BoardView& view, const MarkerSighting& sighting) const {
    const Vec3 lever = rotate(view.T_camera_board, translation(markers_[sighting.marker]));
    Matrix6d J = Matrix6d::Identity();
    for (int i = 0; i < 3; ++i)
      J.block<3, 1>(0, 3 + i) = Eigen::Vector3d(cross(axis(Eigen::Isometry3d::Identity(), i), lever));
    return sighting.whitening * J;
  }
  // And with that of the marker on the board.
  static Matrix6d by_marker(const BoardView& view, const MarkerSighting& sighting) {
    Matrix6d J = Matrix6d::Zero();
    J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = view.T_camera_board.linear();
    return sighting.whitening * J;
  }

  // @param damping share by which the diagonal is enlarged
  Reduced reduce(double damping) const {
    const auto n = 6 * static_cast<Eigen::Index>(markers_.size() - 1);
    Reduced reduced{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n), {}, {}, {}};
    for (const BoardView& view : views_) add(view, damping, reduced);
    return reduced;
  }

  void add(const BoardView& view, double damping, Reduced& r) const {
    Matrix6d A = Matrix6d::Zero();
    Vector6d g = Vector6d::Zero();
    std::vector<Matrix6d> couplings;
    for (const MarkerSighting& sighting : view.sightings) {
      const Matrix6d V = by_view(view, sighting), M = by_marker(view, sighting);
      const Vector6d e = residual(view, sighting);
      const double w = weight(view, sighting);
      A += w * V.transpose() * V;
      g += w * V.transpose() * e;
      couplings.push_back(w * M.transpose() * V);
      if (sighting.marker == 0) continue;
      Matrix6d square = w * M.transpose() * M;
      square.diagonal() *= 1 + damping;
      r.S.block<6, 6>(at(sighting), at(sighting)) += square;
      r.b.segment<6>(at(sighting)) += w * M.transpose() * e;
    }
    A.diagonal() *= 1 + damping;
    const Eigen::LDLT<Matrix6d> solver(A);
    for (std::size_t i = 0; i < couplings.size(); ++i) {
      const MarkerSighting& a = view.sightings[i];
      if (a.marker == 0) continue;
      r.b.segment<6>(at(a)) -= couplings[i] * solver.solve(g);
      for (std::size_t k = 0; k < couplings.size(); ++k)
        if (const MarkerSighting& b = view.sightings[k]; b.marker != 0)
          r.S.block<6, 6>(at(a), at(b)) -= couplings[i] * solver.solve(Matrix6d(couplings[k].transpose()));
    }
    r.solvers.push_back(solver);
    r.gradients.push_back(g);
    r.couplings.push_back(std::move(couplings));
  }

  static Eigen::Index at(const MarkerSighting& sighting) { return 6 * static_cast<Eigen::Index>(sighting.marker - 1); }

  void minimise() {
    double damping = 1e-4, now = cost();
    for (int step = 0; step < kSteps && damping < 1e8; ++step) {
      const auto markers = markers_;
      const auto views = views_;
      move(reduce(damping));
      const double moved = cost();
      if (moved < now) {
        damping = std::max(damping / 10, 1e-9);
        if (std::exchange(now, moved) - moved < 1e-10 * moved) return;
      } else {
        markers_ = markers;
        views_ = views;
        damping *= 10;
      }
    }
  }

  void move(const Reduced& r) {
    const Eigen::VectorXd by = r.S.ldlt().solve(r.b);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      Vector6d g = r.gradients[v];
      for (std::size_t i = 0; i < views_[v].sightings.size(); ++i)
        if (const MarkerSighting& s = views_[v].sightings[i]; s.marker != 0)
          g -= r.couplings[v][i].transpose() * by.segment<6>(at(s));
      perturb(views_[v].T_camera_board, r.solvers[v].solve(g));
    }
    for (std::size_t m = 1; m < markers_.size(); ++m)
      perturb(markers_[m], by.segment<6>(6 * static_cast<Eigen::Index>(m - 1)));
  }

  double cost() const {
    double sum = 0;
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings)
        sum += std::log1p(residual(view, sighting).squaredNorm() / (scale_ * scale_));
    return sum;
  }

  double median_residual() const {
    std::vector<double> lengths;
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings) lengths.push_back(residual(view, sighting).norm());
    return median(std::move(lengths));
  }

  // Variance of an element of the whitened residuals, times the number of successive views in which they err alike.
  double residual_variance() const {
    double sum = 0, product = 0, elements = 0;
    std::vector<Vector6d> last(markers_.size(), Vector6d::Zero());
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings) {
        const Vector6d e = std::sqrt(weight(view, sighting)) * residual(view, sighting);
        sum += e.squaredNorm();
        product += e.dot(std::exchange(last[sighting.marker], e));
        elements += 6;
      }
    const double unknowns = 6 * static_cast<double>(markers_.size() - 1 + views_.size());
    const double correlation = std::clamp(product / sum, 0.0, 0.98);
    return sum / std::max(elements - unknowns, 1.0) * (1 + correlation) / (1 - correlation);
  }

  std::vector<Eigen::Isometry3d> markers_;  // T_board_marker
  std::vector<BoardView> views_;
  double scale_ = 1;  // of the loss: the residual at which a sighting has half its weight
};

}  // namespace evmarker
