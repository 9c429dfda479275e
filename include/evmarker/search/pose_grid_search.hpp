#pragma once
// The pose within reach of a rough one at which there is most evidence for a wireframe's edges.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/search/cell_region.hpp"
#include "evmarker/search/distinct_best.hpp"
#include "evmarker/search/edge_evidence.hpp"
#include "evmarker/search/wireframe_points.hpp"

namespace evmarker {

/// How far the marker may be from a rough pose.
struct StartPoseReach {
  double sideways_px = 0;   ///< in the image
  double depth_share = 0;   ///< of the depth
  double rotation_rad = 0;  ///< about the line of sight; about the other axes so small a tilt hardly matters
};

/// Looks for the pose with most evidence: at all shifts, depths and turns of a grid within reach, then from the best
/// places of it in all six degrees of freedom in ever smaller steps. A step costs about as many look-ups as there are
/// points, and does not allocate.
class PoseGridSearch {
 public:
  static constexpr double kSpacing = 4;  ///< of the points along the edges, for which its evidence holds [cells]
  static constexpr int kPointCost = 8;   ///< of a point that is projected [look-ups]

  /// Lays the grid around a rough pose.
  /// @param radius_px half of the wireframe's size in the image
  void lay(const CellRegion& region, const WireframePoints& points, double focal_length,
           const Eigen::Isometry3d& T_rough, const StartPoseReach& reach, double radius_px) noexcept {
    region_ = region;
    points_ = points;
    focal_length_ = focal_length;
    T_rough_ = T_rough;
    reach_ = reach;
    radius_px_ = radius_px;
    best_ = {};
    rival_score_ = 0;
    step_cells_ = kFineStep;
    while (lay_steps() > kFewPlaces && step_cells_ < kStep) step_cells_ = std::min(kStep, 1.2 * step_cells_);
  }

  /// Places of the grid.
  double places() const noexcept {
    double places = 1;
    for (const int most : most_) places *= 2 * most + 1;
    return places;
  }

  void start() noexcept {
    for (std::size_t axis = 0; axis < 4; ++axis) place_[axis] = -most_[axis];
    best_nodes_.restart(static_cast<int>(std::lround(kStep / step_cells_)));
    scanned_ = done_ = false;
    project_points();
  }

  /// Goes on with the search. @return its cost [look-ups]
  int step(const EdgeEvidence& evidence) noexcept { return scanned_ ? refine(evidence) : scan(evidence); }
  bool done() const noexcept { return done_; }

  /// The best pose, the logarithm of the likelihood ratio of its edges to any place of the region, and by how much that
  /// is ahead of all poses from which a tracker would not come to it [nats]. Once it is done.
  const Eigen::Isometry3d& T_best() const noexcept { return best_.T; }
  double evidence() const noexcept { return nats(best_.score); }
  double lead() const noexcept { return nats(best_.score - rival_score_); }

 private:
  static constexpr double kStep = 3, kFineStep = 1.5;  // [cells] of the grid: an edge is felt at twice as much
  static constexpr int kOverhead = 16;                 // of a step [look-ups]
  static constexpr double kFewPlaces = 8192;           // of the grid, which may have smaller steps

  struct Cell {
    int x = 0, y = 0;
  };
  struct Candidate {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    int score = 0;  // [1 / EdgeEvidence::kUnit nat]
  };

  // Several points feel the same events, and err together: the nearer they are, the less each of them counts.
  static double nats(int score) noexcept {
    return score / EdgeEvidence::kUnit * std::min(1.0, kSpacing / EdgeEvidence::kFar);
  }

  // How many places the grid has with the present step.
  double lay_steps() noexcept {
    const double step_px = step_cells_ * region_.cell_px;
    const auto steps = [&](double way_px) { return static_cast<int>(std::ceil(std::max(0.0, way_px) / step_px)); };
    const int sideways = steps(reach_.sideways_px);
    most_ = {sideways, sideways, steps(reach_.depth_share * radius_px_), steps(reach_.rotation_rad * radius_px_)};
    return places();
  }

  // A step sideways [px in the image], along the line of sight [share of the depth], and a rotation about the middle.
  Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vec6& step) const noexcept {
    const Vec3 middle = transform(T, points_.centre());
    Eigen::Isometry3d turn = Eigen::Isometry3d::Identity(), moved = turn;
    turn.linear() = so3_exp(step.r);
    moved.linear() = product(turn.linear(), T.linear());
    const double px = middle.z / focal_length_;
    set_translation(moved, middle + rotate(turn, translation(T) - middle) + step.t.z * middle +
                               Vec3(step.t.x * px, step.t.y * px, 0));
    return moved;
  }

  Vec6 grid_step(const std::array<int, 4>& place) const noexcept {
    const auto part = [&](std::size_t axis) {
      return most_[axis] > 0 ? static_cast<double>(place[axis]) / most_[axis] : 0;
    };
    return {{reach_.sideways_px * part(0), reach_.sideways_px * part(1), reach_.depth_share * part(2)},
            {0, 0, reach_.rotation_rad * part(3)}};
  }

  // At the present depth and turn: a shift in the image moves all of them alike.
  void project_points() noexcept {
    const Eigen::Isometry3d T = moved(T_rough_, grid_step({0, 0, place_[2], place_[3]}));
    for (std::size_t i = 0; i < points_.size(); ++i) projected_[i] = cell_of(transform(T, points_[i]));
  }

  // Looks at one place of the grid.
  int scan(const EdgeEvidence& evidence) noexcept {
    const Vec3 step = grid_step(place_).t;
    const Cell shift{static_cast<int>(std::round(step.x / region_.cell_px)),
                     static_cast<int>(std::round(step.y / region_.cell_px))};
    int score = 0;
    for (std::size_t i = 0; i < points_.size(); ++i)
      score += at(evidence, {projected_[i].x + shift.x, projected_[i].y + shift.y});
    best_nodes_.add({place_, score});
    const auto points = static_cast<int>(points_.size()) + kOverhead;
    if (next(0) || next(1)) return points;
    if (next(2) || next(3)) {
      project_points();
      return kPointCost * points;
    }
    for (std::size_t i = 0; i < best_nodes_.size(); ++i) {
      candidates_[i].T = moved(T_rough_, grid_step(best_nodes_[i].place));
      candidates_[i].score = score_of(evidence, candidates_[i].T);
    }
    refined_ = 0;
    start_refining();
    scanned_ = true;
    return kPointCost * points * static_cast<int>(best_nodes_.size());
  }

  // The next place along an axis; false, and back to the first, after the last.
  bool next(std::size_t axis) noexcept {
    if (++place_[axis] <= most_[axis]) return true;
    place_[axis] = -most_[axis];
    return false;
  }

  Cell cell_of(Vec3 P) const noexcept {
    constexpr int kAway = 1000000;
    if (!(P.z > 1e-6)) return {kAway, kAway};
    const Vec2 place = region_.place(image_point(P, focal_length_));
    const auto cell = [](double x) {
      return static_cast<int>(std::max(-1.0 * kAway, std::min(std::floor(x), 1.0 * kAway)));
    };
    return {cell(place.x), cell(place.y)};
  }

  int at(const EdgeEvidence& evidence, Cell cell) const noexcept {
    const bool inside = static_cast<unsigned>(cell.x) < static_cast<unsigned>(region_.width) &&
                        static_cast<unsigned>(cell.y) < static_cast<unsigned>(region_.height);
    return inside ? evidence[static_cast<std::size_t>(cell.y * region_.width + cell.x)] : 0;
  }

  int score_of(const EdgeEvidence& evidence, const Eigen::Isometry3d& T) const noexcept {
    int score = prior(T);
    for (const Vec3& point : points_) score += at(evidence, cell_of(transform(T, point)));
    return score;
  }

  // Of the tilt, which few events hardly show: the rough one, to within half of the rotation's reach (sigma).
  int prior(const Eigen::Isometry3d& T) const noexcept {
    const double sigma = std::max(reach_.rotation_rad / 2, 1e-3);
    const Eigen::Matrix3d R_rough_camera = T_rough_.linear().transpose();
    const Vec3 turn = so3_log(product(T.linear(), R_rough_camera));
    const double tilt2 = turn.x * turn.x + turn.y * turn.y;
    return static_cast<int>(-0.5 * std::min(tilt2 / (sigma * sigma), 1e3) / nats(1));
  }

  void start_refining() noexcept {
    constexpr double kTilt = 0.05;
    const double step_px = kStep / 2 * region_.cell_px, turn = step_px / radius_px_;
    steps_ = {step_px, step_px, turn, kTilt, kTilt, turn};
    trial_ = 0;
  }

  // Tries to move one candidate along one axis.
  int refine(const EdgeEvidence& evidence) noexcept {
    constexpr int kHalvings = 4, kRounds = 3, kTrials = 12;
    Candidate& candidate = candidates_[refined_];
    const auto axis = static_cast<std::size_t>(trial_ % kTrials / 2);
    std::array<double, 6> step{};
    step[axis] = (trial_ % 2 == 0 ? -1 : 1) * steps_[axis];
    const Eigen::Isometry3d T = moved(candidate.T, {{step[0], step[1], step[2]}, {step[3], step[4], step[5]}});
    if (const int score = score_of(evidence, T); score > candidate.score) candidate = {T, score};
    if (++trial_ % (kRounds * kTrials) == 0)
      for (double& step_of_axis : steps_) step_of_axis /= 2;
    if (trial_ == kHalvings * kRounds * kTrials) {
      start_refining();
      if (++refined_ == best_nodes_.size()) finish();
    }
    return kPointCost * static_cast<int>(points_.size()) + kOverhead;
  }

  void finish() noexcept {
    const std::span<const Candidate> all(candidates_.data(), best_nodes_.size());
    best_ = *std::ranges::max_element(all, {}, &Candidate::score);
    rival_score_ = 0;
    for (const Candidate& other : all)
      if (apart(other.T, best_.T)) rival_score_ = std::max(rival_score_, other.score);
    done_ = true;
  }

  // True if two poses are too far from each other for a tracker to come from one to the other.
  bool apart(const Eigen::Isometry3d& T, const Eigen::Isometry3d& U) const noexcept {
    double squared_px = 0;
    for (const Vec3& point : points_)
      squared_px += squared_norm(focal_length_ * (on_plane(transform(T, point)) - on_plane(transform(U, point))));
    const double same_px = kStep * region_.cell_px;
    return squared_px > same_px * same_px * static_cast<double>(points_.size());
  }

  CellRegion region_;
  WireframePoints points_;
  double focal_length_ = 1;
  Eigen::Isometry3d T_rough_ = Eigen::Isometry3d::Identity();
  StartPoseReach reach_;
  double radius_px_ = 1;
  double step_cells_ = kStep;  // of the grid
  std::array<int, 4> most_{};  // its steps to each side: right, down, depth, turn

  std::array<int, 4> place_{};
  std::array<Cell, WireframePoints::kMost> projected_{};  // [cells]
  DistinctBest best_nodes_;
  bool scanned_ = false, done_ = true;
  std::array<Candidate, DistinctBest::kMost> candidates_{};
  std::size_t refined_ = 0;
  int trial_ = 0;
  std::array<double, 6> steps_{};
  Candidate best_;
  int rival_score_ = 0;
};

}  // namespace evmarker
