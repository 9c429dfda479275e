#pragma once
// Search for the pose, within reach of a rough one, at which there is most evidence for a wireframe's edges.
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

/// How far the marker may be from a rough pose, to each side.
struct StartPoseReach {
  double sideways_px = 0;   ///< shift in the image, in x and in y
  double depth_share = 0;   ///< change of the depth, as a share of it
  double rotation_rad = 0;  ///< about the line of sight; so small a tilt about the other axes hardly matters
};

/// Searches for the pose with most evidence. First it scans a grid of all shifts, depths and rotations about the line
/// of sight within reach; then it refines the best places of the grid in all six degrees of freedom, in ever smaller
/// steps, without leaving the reach. The order of calls: `set_grid`, `start`, and `step` until `done`. The cost of a
/// call of `step` is proportional to the number of points; no call allocates.
class PoseGridSearch {
 public:
  static constexpr double kSpacing = 4;  ///< of the points along the edges [cells]; `evidence` and `lead` assume it
  static constexpr int kPointCost = 8;   ///< cost of projecting a point [look-ups]

  /// Sets the grid around a rough pose. Where its places are few, its steps are smaller.
  /// @param points on the visible edges, kSpacing cells apart
  /// @param focal_length [px]
  /// @param radius_px half of the wireframe's size in the image
  void set_grid(const CellRegion& region, const WireframePoints& points, double focal_length,
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
    while (set_steps() > kMostFinePlaces && step_cells_ < kStep) step_cells_ = std::min(kStep, 1.2 * step_cells_);
  }

  /// Number of places of the grid.
  double places() const noexcept {
    double places = 1;
    for (const int steps : steps_to_side_) places *= 2 * steps + 1;
    return places;
  }

  /// Starts a search over the grid.
  void start() noexcept {
    for (std::size_t axis = 0; axis < 4; ++axis) place_[axis] = -steps_to_side_[axis];
    best_nodes_.restart(static_cast<int>(std::lround(kStep / step_cells_)));
    scanned_ = done_ = false;
    project_points();
  }

  /// Scores the next place of the grid, or tries the next move of the refinement. Requires that the search is not done.
  /// @param evidence in the cells of the region
  /// @return the cost [look-ups]
  int step(const EdgeEvidence& evidence) noexcept { return scanned_ ? refine(evidence) : scan(evidence); }
  bool done() const noexcept { return done_; }

  /// The best pose of a search that is done, T_camera_marker.
  const Eigen::Isometry3d& T_best() const noexcept { return best_.T; }
  /// Its evidence: the log-likelihood ratio of edges at this pose to edges anywhere in the region [nats].
  double evidence() const noexcept { return to_nats(best_.score); }
  /// How much more evidence it has than any pose from which a tracker would not converge to it, or than 0 [nats].
  double lead() const noexcept { return to_nats(best_.score - rival_score_); }

 private:
  static constexpr double kStep = 3, kFineStep = 1.5;  // of the grid [cells]: evidence of an edge reaches twice as far
  static constexpr int kOverhead = 16;                 // cost of a step besides that of its points [look-ups]
  static constexpr double kMostFinePlaces = 8192;      // of a grid whose steps may be smaller than kStep

  struct Cell {
    int x = 0, y = 0;
  };
  struct Candidate {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    int score = 0;  // [1 / EdgeEvidence::kUnit nat]
  };

  // Converts a score to nats. Points nearer to each other than kFar cells get evidence from the same events and err
  // together, so that each of them counts less.
  static double to_nats(int score) noexcept {
    return score / EdgeEvidence::kUnit * std::min(1.0, kSpacing / EdgeEvidence::kFar);
  }

  // Divides the reach into steps of step_cells_. Returns the number of places.
  double set_steps() noexcept {
    const double step_px = step_cells_ * region_.cell_px;
    const auto steps = [&](double way_px) { return static_cast<int>(std::ceil(std::max(0.0, way_px) / step_px)); };
    const int sideways = steps(reach_.sideways_px);
    steps_to_side_ = {sideways, sideways, steps(reach_.depth_share * radius_px_),
                      steps(reach_.rotation_rad * radius_px_)};
    return places();
  }

  // A pose after a step: t is the shift in the image [px] and along the line of sight [share of the depth], r a
  // rotation about the points' centre [rad, camera frame].
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

  // The step from the rough pose to a place of the grid.
  Vec6 grid_step(const std::array<int, 4>& place) const noexcept {
    const auto part = [&](std::size_t axis) {
      return steps_to_side_[axis] > 0 ? static_cast<double>(place[axis]) / steps_to_side_[axis] : 0;
    };
    return {{reach_.sideways_px * part(0), reach_.sideways_px * part(1), reach_.depth_share * part(2)},
            {0, 0, reach_.rotation_rad * part(3)}};
  }

  // Projects the points at the present depth and rotation; a shift in the image then moves all of them alike.
  void project_points() noexcept {
    const Eigen::Isometry3d T = moved(T_rough_, grid_step({0, 0, place_[2], place_[3]}));
    for (std::size_t i = 0; i < points_.size(); ++i) projected_[i] = cell_of(transform(T, points_[i]));
  }

  // Scores one place of the grid. After the last one it scores the best places again, as candidates to refine.
  int scan(const EdgeEvidence& evidence) noexcept {
    const Vec3 step = grid_step(place_).t;
    const Cell shift{static_cast<int>(std::round(step.x / region_.cell_px)),
                     static_cast<int>(std::round(step.y / region_.cell_px))};
    int score = 0;
    for (std::size_t i = 0; i < points_.size(); ++i)
      score += evidence_at(evidence, {projected_[i].x + shift.x, projected_[i].y + shift.y});
    best_nodes_.add({place_, score});
    const auto points = static_cast<int>(points_.size()) + kOverhead;
    if (advance(0) || advance(1)) return points;
    if (advance(2) || advance(3)) {
      project_points();
      return kPointCost * points;
    }
    for (std::size_t i = 0; i < best_nodes_.size(); ++i) {
      candidates_[i].T = moved(T_rough_, grid_step(best_nodes_[i].place));
      candidates_[i].score = score_of(evidence, candidates_[i].T);
    }
    candidate_ = 0;
    reset_moves();
    scanned_ = true;
    return kPointCost * points * static_cast<int>(best_nodes_.size());
  }

  // Goes to the next place along an axis; after the last one back to the first, and returns false.
  bool advance(std::size_t axis) noexcept {
    if (++place_[axis] <= steps_to_side_[axis]) return true;
    place_[axis] = -steps_to_side_[axis];
    return false;
  }

  // The cell in which a point [m, camera frame] is seen; a cell far away if it is behind the camera.
  Cell cell_of(Vec3 P) const noexcept {
    constexpr int kAway = 1000000;
    if (!(P.z > 1e-6)) return {kAway, kAway};
    const Vec2 place = region_.to_cells(image_point(P, focal_length_));
    const auto cell = [](double x) {
      return static_cast<int>(std::max(-1.0 * kAway, std::min(std::floor(x), 1.0 * kAway)));
    };
    return {cell(place.x), cell(place.y)};
  }

  int evidence_at(const EdgeEvidence& evidence, Cell cell) const noexcept {
    const bool inside = static_cast<unsigned>(cell.x) < static_cast<unsigned>(region_.width) &&
                        static_cast<unsigned>(cell.y) < static_cast<unsigned>(region_.height);
    return inside ? evidence[static_cast<std::size_t>(cell.y * region_.width + cell.x)] : 0;
  }

  // The evidence of all points at a pose, and the prior of its tilt.
  int score_of(const EdgeEvidence& evidence, const Eigen::Isometry3d& T) const noexcept {
    int score = tilt_prior(T);
    for (const Vec3& point : points_) score += evidence_at(evidence, cell_of(transform(T, point)));
    return score;
  }

  // The rotation from the rough pose to another one [rad, camera frame].
  Vec3 turn_from_rough(const Eigen::Isometry3d& T) const noexcept {
    const Eigen::Matrix3d R_rough_camera = T_rough_.linear().transpose();
    return so3_log(product(T.linear(), R_rough_camera));
  }

  // Log-density of the pose's tilt relative to the rough one, up to a constant, as a score: normal, with half of the
  // rotation's reach as sigma. Few events hardly show the tilt; the prior keeps it near the rough one.
  int tilt_prior(const Eigen::Isometry3d& T) const noexcept {
    const double sigma = std::max(reach_.rotation_rad / 2, 1e-3);
    const Vec3 turn = turn_from_rough(T);
    const double tilt2 = turn.x * turn.x + turn.y * turn.y;
    return static_cast<int>(-0.5 * std::min(tilt2 / (sigma * sigma), 1e3) / to_nats(1));
  }

  // True for a pose whose shift, depth and rotation about the line of sight are those of the grid, or off by half a
  // cell at most: the evidence of a small marker grows while it shrinks into the events of its own code.
  bool within_reach(const Eigen::Isometry3d& T) const noexcept {
    const Vec3 rough = transform(T_rough_, points_.centre()), middle = transform(T, points_.centre());
    const Vec2 shift = focal_length_ * (on_plane(middle) - on_plane(rough));
    const double half_cell_px = region_.cell_px / 2, sideways_px = reach_.sideways_px + half_cell_px,
                 share = half_cell_px / radius_px_;
    return std::abs(shift.x) <= sideways_px && std::abs(shift.y) <= sideways_px &&
           std::abs(middle.z / rough.z - 1) <= reach_.depth_share + share &&
           std::abs(turn_from_rough(T).z) <= reach_.rotation_rad + share;
  }

  // Sets the moves to their first sizes, for the next candidate.
  void reset_moves() noexcept {
    constexpr double kTilt = 0.05;
    const double step_px = kStep / 2 * region_.cell_px, turn = step_px / radius_px_;
    move_sizes_ = {step_px, step_px, turn, kTilt, kTilt, turn};
    trial_ = 0;
  }

  // Moves a candidate along one axis if that raises its score. Halves the moves after some rounds over all axes, and
  // goes to the next candidate after some halvings.
  int refine(const EdgeEvidence& evidence) noexcept {
    constexpr int kHalvings = 4, kRounds = 3, kTrials = 12;
    Candidate& candidate = candidates_[candidate_];
    const auto axis = static_cast<std::size_t>(trial_ % kTrials / 2);
    std::array<double, 6> step{};
    step[axis] = (trial_ % 2 == 0 ? -1 : 1) * move_sizes_[axis];
    const Eigen::Isometry3d T = moved(candidate.T, {{step[0], step[1], step[2]}, {step[3], step[4], step[5]}});
    if (const int score = score_of(evidence, T); score > candidate.score && within_reach(T)) candidate = {T, score};
    if (++trial_ % (kRounds * kTrials) == 0)
      for (double& size : move_sizes_) size /= 2;
    if (trial_ == kHalvings * kRounds * kTrials) {
      reset_moves();
      if (++candidate_ == best_nodes_.size()) choose_best();
    }
    return kPointCost * static_cast<int>(points_.size()) + kOverhead;
  }

  // Ends the search: chooses the best candidate, and the best score of those far apart from it.
  void choose_best() noexcept {
    const std::span<const Candidate> all(candidates_.data(), best_nodes_.size());
    best_ = *std::ranges::max_element(all, {}, &Candidate::score);
    rival_score_ = 0;
    for (const Candidate& other : all)
      if (far_apart(other.T, best_.T)) rival_score_ = std::max(rival_score_, other.score);
    done_ = true;
  }

  // True if two poses are too far apart for a tracker to converge from one to the other: by kStep cells in the image.
  bool far_apart(const Eigen::Isometry3d& T, const Eigen::Isometry3d& U) const noexcept {
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
  double step_cells_ = kStep;           // step of the grid
  std::array<int, 4> steps_to_side_{};  // of the grid: right, down, in depth, in rotation

  std::array<int, 4> place_{};  // that is scored next, along the same axes [steps from the rough pose]
  std::array<Cell, WireframePoints::kMost> projected_{};  // points without the shift
  DistinctBest best_nodes_;
  bool scanned_ = false, done_ = true;
  std::array<Candidate, DistinctBest::kMost> candidates_{};
  std::size_t candidate_ = 0;           // that is being refined
  int trial_ = 0;                       // number of moves tried with it
  std::array<double, 6> move_sizes_{};  // along the axes of `moved`
  Candidate best_;
  int rival_score_ = 0;
};

}  // namespace evmarker
