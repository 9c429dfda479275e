#pragma once
// Bundle adjustment of a board: where its markers are, from corners seen at many times.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// The four corners of a marker at one time, in the undistorted image [px from the principal point].
struct MarkerSighting {
  std::size_t marker = 0;  ///< its place among the board's markers
  std::array<Vec2, 4> corners;
};

/// Markers seen at one time.
struct BoardView {
  std::vector<MarkerSighting> sightings;
  Eigen::Isometry3d T_camera_board = Eigen::Isometry3d::Identity();
};

/// A square on a board.
struct BoardSquare {
  double length = 0;  ///< [m]
  Eigen::Isometry3d T_board_marker = Eigen::Isometry3d::Identity();
};

/// Finds the poses of squares on a board, all but the first, and of the board in every view, at which the squares'
/// corners are seen where they were: Levenberg-Marquardt, where each view is eliminated (Schur complement) so that the
/// equations are those of the squares alone. Wrong sightings have little weight (Cauchy's loss of the distance of a
/// square's four corners). B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, "Bundle adjustment - a modern
/// synthesis", 2000.
class BoardAdjustment {
 public:
  /// @param squares and views with poses to start from; the first square stays where it is, and every square is in a
  /// view with another
  /// @param focal_length [px]
  BoardAdjustment(std::vector<BoardSquare> squares, std::vector<BoardView> views, double focal_length)
      : squares_(std::move(squares)), views_(std::move(views)), focal_length_(focal_length) {}

  /// Finds the minimum, first with a loss that is wide enough for a rough start.
  void solve() {
    for (int round = 0; round < kRounds; ++round) {
      const double before = scale_px_;
      scale_px_ = std::max(2 * median_px(), kLeastScale_px);
      minimise();
      if (std::abs(scale_px_ - before) < 1e-3 * scale_px_) break;
    }
  }

  const std::vector<BoardSquare>& squares() const noexcept { return squares_; }
  const std::vector<BoardView>& views() const noexcept { return views_; }

  /// Root mean square distance of corners from where they should be, wrong sightings left out by their weight [px].
  double residual_px() const {
    double sum = 0, weights = 0;
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings) {
        const double error2 = squared_norm(residual(view, sighting));
        sum += weight(error2) * error2;
        weights += 4 * weight(error2);
      }
    return std::sqrt(sum / weights);
  }

  /// Covariance of the squares' poses on the board, of all but the first, each a perturbation as in PoseEstimate, in
  /// the board's frame. From the scatter of the residuals, of which those of successive views of a square are partly
  /// the same.
  Eigen::MatrixXd covariance() const {
    const Reduced reduced = reduce(0);
    const Eigen::Index n = reduced.S.rows();
    return residual_variance() * reduced.S.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
  }

 private:
  static constexpr int kRounds = 10, kSteps = 50;
  static constexpr double kLeastScale_px = 0.05;

  using Residual = Eigen::Matrix<double, 8, 1>;
  using Jacobian = Eigen::Matrix<double, 8, 6>;

  // The normal equations of the squares after the views are eliminated, and what gives the views' steps back.
  struct Reduced {
    Eigen::MatrixXd S;
    Eigen::VectorXd b;
    std::vector<Eigen::LDLT<Matrix6d>> view_solvers;
    std::vector<Vector6d> view_gradients;
    std::vector<std::vector<Matrix6d>> couplings;  // by view and sighting: square by view
  };

  static double squared_norm(const Residual& e) { return e.squaredNorm(); }
  // Of a sighting whose corners have this sum of squared distances.
  double weight(double error2) const { return 1 / (1 + error2 / (4 * scale_px_ * scale_px_)); }

  std::array<Vec3, 4> corners_on_board(const BoardSquare& square) const {
    const double h = square.length / 2;
    std::array<Vec3, 4> corners{Vec3(-h, h, 0), Vec3(h, h, 0), Vec3(h, -h, 0), Vec3(-h, -h, 0)};
    for (Vec3& corner : corners) corner = transform(square.T_board_marker, corner);
    return corners;
  }

  Residual residual(const BoardView& view, const MarkerSighting& sighting) const {
    Residual e;
    const auto corners = corners_on_board(squares_[sighting.marker]);
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec2 seen = image_point(transform(view.T_camera_board, corners[i]), focal_length_);
      e.segment<2>(2 * static_cast<Eigen::Index>(i)) = Eigen::Vector2d(sighting.corners[i] - seen);
    }
    return e;
  }

  // Derivatives of the corners' images by the perturbations of the board in the camera and of the square on the board.
  void differentiate(const BoardView& view, const MarkerSighting& sighting, Jacobian& by_view,
                     Jacobian& by_square) const {
    const BoardSquare& square = squares_[sighting.marker];
    const auto corners = corners_on_board(square);
    const Eigen::Isometry3d& T = view.T_camera_board;
    const Eigen::Isometry3d back = T.inverse();
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3 lever = rotate(T, corners[i]), X = lever + translation(T);
      const Vec3 lever_on_board = corners[i] - translation(square.T_board_marker);
      for (int k = 0; k < 2; ++k) {
        const Vec3 g = image_gradient(k == 0 ? Vec2(1, 0) : Vec2(0, 1), X, focal_length_), on_board = rotate(back, g);
        const Eigen::Index row = 2 * static_cast<Eigen::Index>(i) + k;
        by_view.row(row) = Vector6d(Vec6(g, cross(lever, g))).transpose();
        by_square.row(row) = Vector6d(Vec6(on_board, cross(lever_on_board, on_board))).transpose();
      }
    }
  }

  // @param damping share that is added to the diagonal
  Reduced reduce(double damping) const {
    const auto n = 6 * static_cast<Eigen::Index>(squares_.size() - 1);
    Reduced r{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n), {}, {}, {}};
    for (const BoardView& view : views_) add(view, damping, r);
    return r;
  }

  void add(const BoardView& view, double damping, Reduced& r) const {
    Matrix6d A = Matrix6d::Zero();
    Vector6d g = Vector6d::Zero();
    std::vector<Matrix6d> couplings;
    for (const MarkerSighting& sighting : view.sightings) {
      Jacobian V, M;
      differentiate(view, sighting, V, M);
      const Residual e = residual(view, sighting);
      const double w = weight(e.squaredNorm());
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
    r.view_solvers.push_back(solver);
    r.view_gradients.push_back(g);
    r.couplings.push_back(std::move(couplings));
  }

  static Eigen::Index at(const MarkerSighting& sighting) { return 6 * static_cast<Eigen::Index>(sighting.marker - 1); }

  void minimise() {
    double damping = 1e-4, now = cost();
    for (int step = 0; step < kSteps && damping < 1e8; ++step) {
      const auto squares = squares_;
      const auto views = views_;
      move(reduce(damping));
      const double moved = cost();
      if (moved < now) {
        const bool done = now - moved < 1e-10 * now;
        now = moved;
        damping = std::max(damping / 10, 1e-9);
        if (done) return;
      } else {
        squares_ = squares;
        views_ = views;
        damping *= 10;
      }
    }
  }

  void move(const Reduced& r) {
    const Eigen::VectorXd by = r.S.ldlt().solve(r.b);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      Vector6d g = r.view_gradients[v];
      for (std::size_t i = 0; i < views_[v].sightings.size(); ++i)
        if (const MarkerSighting& s = views_[v].sightings[i]; s.marker != 0)
          g -= r.couplings[v][i].transpose() * by.segment<6>(at(s));
      perturb(views_[v].T_camera_board, r.view_solvers[v].solve(g));
    }
    for (std::size_t m = 1; m < squares_.size(); ++m)
      perturb(squares_[m].T_board_marker, by.segment<6>(6 * static_cast<Eigen::Index>(m - 1)));
  }

  static void perturb(Eigen::Isometry3d& T, const Vector6d& by) {
    const Vec6 step = by;
    set_translation(T, translation(T) + step.t);
    turn(T, step.r);
    orthonormalize(T);
  }

  double cost() const {
    double sum = 0;
    const double c2 = 4 * scale_px_ * scale_px_;
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings)
        sum += c2 * std::log1p(residual(view, sighting).squaredNorm() / c2);
    return sum;
  }

  // Median over the sightings of the root mean square distance of the corners.
  double median_px() const {
    std::vector<double> errors;
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings)
        errors.push_back(std::sqrt(residual(view, sighting).squaredNorm() / 4));
    const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
    std::nth_element(errors.begin(), middle, errors.end());
    return *middle;
  }

  // Of a coordinate of a corner [px^2], times the number of successive views of a square in which it errs alike.
  double residual_variance() const {
    double sum = 0, product = 0, coordinates = 0;
    std::vector<Residual> last(squares_.size(), Residual::Zero());
    for (const BoardView& view : views_)
      for (const MarkerSighting& sighting : view.sightings) {
        Residual e = residual(view, sighting);
        e *= std::sqrt(weight(e.squaredNorm()));
        sum += e.squaredNorm();
        product += e.dot(last[sighting.marker]);
        coordinates += 8;
        last[sighting.marker] = e;
      }
    const double unknowns = 6 * static_cast<double>(squares_.size() - 1 + views_.size());
    const double correlation = std::clamp(product / sum, 0.0, 0.98);
    return sum / std::max(coordinates - unknowns, 1.0) * (1 + correlation) / (1 - correlation);
  }

  std::vector<BoardSquare> squares_;
  std::vector<BoardView> views_;
  double focal_length_;
  double scale_px_ = 1;  // of the loss: the distance of corners at which a sighting has half its weight
};

}  // namespace evmarker
