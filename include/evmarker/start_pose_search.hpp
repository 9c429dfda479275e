#pragma once
// Floor 3. Looks for a wireframe near a rough pose until its events show it, a bounded step with every event.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/cell_region.hpp"
#include "evmarker/distinct_best.hpp"
#include "evmarker/edge_evidence.hpp"
#include "evmarker/event.hpp"
#include "evmarker/event_history.hpp"
#include "evmarker/fading_counts.hpp"
#include "evmarker/marker_model.hpp"
#include "evmarker/so3.hpp"
#include "evmarker/wireframe_points.hpp"

namespace evmarker {

/// How far the marker may be from a rough pose.
struct StartPoseReach {
  double sideways_px = 0;   ///< in the image
  double depth_share = 0;   ///< of the depth
  double rotation_rad = 0;  ///< about the line of sight; about the other axes so small a tilt hardly matters
};

struct StartPoseSearchSettings {
  double reach_share = 0.18;    ///< StartPoseReach::sideways_px of a start pose, of the wireframe's size in the image
  double depth_share = 0.1;     ///< of the depth
  double rotation_rad = 0.105;  ///< about the line of sight
  double false_alarms = 1e-6;   ///< share of the searches in mere noise that may end with a pose
  double wrong_basins = 1e-3;   ///< share of the poses found that may belong to another place of the wireframe
  std::optional<std::chrono::microseconds> longest{};  ///< then it is given up; not at all if empty
};

/// Counts the events near a wireframe and searches, again and again, for the pose at which they speak for its edges:
/// all shifts, depths and turns within reach, then all six degrees of freedom in ever smaller steps. It believes a pose
/// when noise anywhere within reach would hardly ever look as good, and no other pose does either.
///
/// Each event does at most kWork look-ups, whatever the resolution, distance and reach. All memory is allocated by the
/// constructor. The region around the wireframe has at most kSide x kSide cells, of a pixel or more.
class StartPoseSearch {
 public:
  enum class State { searching, found, given_up };

  /// @param focal_length [px]
  /// @param image the sensor, undistorted, from the principal point [px]
  StartPoseSearch(MarkerModel model, double focal_length, const Eigen::AlignedBox2d& image,
                  const Eigen::Isometry3d& T_rough, const StartPoseSearchSettings& settings)
      : settings_(settings), model_(std::move(model)), focal_length_(focal_length), image_(image) {
    restart(T_rough);
  }

  /// Searches around another pose, as far as the settings say.
  void restart(const Eigen::Isometry3d& T_rough) noexcept {
    restart(T_rough, {settings_.reach_share * image_box(model_, focal_length_, T_rough).sizes().maxCoeff(),
                      settings_.depth_share, settings_.rotation_rad});
  }

  /// Searches around another pose, as far as is said. Neither allocates nor takes longer than an event.
  void restart(const Eigen::Isometry3d& T_rough, const StartPoseReach& reach) noexcept {
    T_rough_ = T_rough;
    reach_ = reach;
    lay_out();
    state_ = State::searching;
    forget();
  }

  /// Forgets the events so far: there is a gap behind them.
  void forget() noexcept {
    counts_.restart();
    recent_.clear();
    phase_ = Phase::waiting;
    tried_at_.fill(recent_.pushed());
    scale_ = FadingCounts::kScales - 1;
    since_.reset();
    earned_ = kMostEarned;
  }

  /// Takes an event with its undistorted pixel, counted from the principal point. True when it completes the search.
  bool push(const Event& event, const Eigen::Vector2d& u) noexcept {
    if (state_ != State::searching) return false;
    if (!since_) since_ = last_ = event.t;
    if (settings_.longest && event.t > *since_ && event.t - *since_ > settings_.longest->count()) {
      state_ = State::given_up;
      return true;
    }
    if (const int cell = region_.cell(u); cell >= 0) {
      counts_.add(static_cast<std::size_t>(cell), event.t);
      recent_.push(event);
    }
    work(event.t);
    return state_ != State::searching;
  }

  State state() const noexcept { return state_; }
  /// The pose that was found, of the first event to replay.
  const Eigen::Isometry3d& T_found() const noexcept { return T_found_; }

  bool searching() const noexcept { return state_ == State::searching; }

  /// Once found, the events near the wireframe from about when it was there are to be replayed, one with each call
  /// while `replaying()`. Until then `keep` takes the new ones.
  bool replaying() const noexcept { return replayed_ != recent_.pushed(); }
  const Event& replay() noexcept { return recent_.at(replayed_++); }
  void keep(const Event& event) noexcept {
    recent_.push(event);
    skip_forgotten();
  }

  /// Logarithm of the likelihood ratio of the best pose of the last search to noise [nats], how much it takes, and by
  /// how much it is ahead of all others.
  double evidence() const noexcept { return evidence_nats_; }
  double needed_evidence() const noexcept { return needed_nats_; }
  double lead() const noexcept { return lead_nats_; }
  int searches() const noexcept { return searches_; }
  int scale() const noexcept { return scale_; }

 private:
  static constexpr int kSide = 256;    // [cells] of the region at most
  static constexpr int kWork = 16384;  // look-ups for an event
  // In the long run, so that noise or clutter without a marker does not keep a core busy; but a start is in a hurry.
  static constexpr double kWorkPerUs = 500, kMostEarned = 2e7;  // look-ups for a microsecond, and saved up
  static constexpr int kRowCost = 8, kPointCost = 8;  // of a row's cell, of a point that is projected [look-ups]
  static constexpr std::size_t kReplayed = 4096;
  static constexpr double kSpacing = 4;  // [cells] of the points along the edges: nearer, they err together
  static constexpr double kStep = 3, kFineStep = 1.5;  // [cells] of the grid: an edge is felt at twice as much
  static constexpr double kFewPlaces = 8192;           // of the grid, which may have smaller steps

  using Vector6 = Eigen::Matrix<double, 6, 1>;
  enum class Phase { waiting, weighing, scanning, refining };

  struct Candidate {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    int score = 0;  // [1 / EdgeEvidence::kUnit nat]
  };

  // The region, the points and the grid, at the rough pose.
  void lay_out() noexcept {
    Eigen::AlignedBox2d box = image_box(model_, focal_length_, T_rough_);
    radius_px_ = std::max(1.0, box.sizes().maxCoeff()) / 2;
    const double margin_px =
        reach_.sideways_px + radius_px_ * (reach_.depth_share + std::min(std::abs(reach_.rotation_rad), 1.0));
    box = Eigen::AlignedBox2d(box.min().array() - margin_px, box.max().array() + margin_px);
    region_ = CellRegion::of(box, image_, kSide, EdgeEvidence::kFar);
    points_.place(model_, focal_length_, T_rough_, kSpacing * region_.cell_px);
    step_cells_ = kFineStep;
    while (lay_grid() > kFewPlaces && step_cells_ < kStep) step_cells_ = std::min(kStep, 1.2 * step_cells_);
    needed_nats_ = std::log(lay_grid() / settings_.false_alarms);
  }

  // How many places it has.
  double lay_grid() noexcept {
    const double step_px = step_cells_ * region_.cell_px;
    const auto steps = [&](double way_px) { return static_cast<int>(std::ceil(std::max(0.0, way_px) / step_px)); };
    const int sideways = steps(reach_.sideways_px);
    most_ = {sideways, sideways, steps(reach_.depth_share * radius_px_), steps(reach_.rotation_rad * radius_px_)};
    double places = 1;
    for (const int most : most_) places *= 2 * most + 1;
    return places;
  }

  // A step sideways [px in the image], along the line of sight [share of the depth], and a rotation about the middle.
  Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vector6& step) const noexcept {
    const Eigen::Vector3d middle = T * points_.centre();
    const Eigen::Matrix3d R = so3_exp(step.tail<3>());
    Eigen::Isometry3d moved;
    moved.linear() = R * T.linear();
    moved.translation() = middle + R * (T.translation() - middle) + step(2) * middle;
    moved.translation().head<2>() += step.head<2>() * (middle.z() / focal_length_);
    return moved;
  }

  Vector6 grid_step(const std::array<int, 4>& place) const noexcept {
    const auto part = [&](std::size_t axis) {
      return most_[axis] > 0 ? static_cast<double>(place[axis]) / most_[axis] : 0;
    };
    Vector6 step = Vector6::Zero();
    step << reach_.sideways_px * part(0), reach_.sideways_px * part(1), reach_.depth_share * part(2), 0, 0,
        reach_.rotation_rad * part(3);
    return step;
  }

  // --- The search, a step with every event ---

  void work(Timestamp t) noexcept {
    earned_ = std::min(earned_ + kWorkPerUs * static_cast<double>(t > last_ ? elapsed_us(last_, t) : 0), kMostEarned);
    last_ = t;
    if (phase_ == Phase::waiting && (earned_ < 0 || !begin())) return;
    int done = 0;
    while (done < kWork && phase_ != Phase::waiting)
      done += phase_ == Phase::weighing ? weigh() : phase_ == Phase::scanning ? scan() : refine();
    earned_ -= done;
  }

  // Searches when half of the edges' cells can have had an event and those on which it was tried last are mostly gone.
  // Every time on longer memory, until that holds no more: then anew with the shortest.
  bool begin() noexcept {
    for (int i = 1; i <= FadingCounts::kScales; ++i) {
      const int scale = (scale_ + i) % FadingCounts::kScales;
      const double events = counts_.total(scale);
      const auto fresh = static_cast<double>(recent_.pushed() - tried_at_[static_cast<std::size_t>(scale)]);
      if (events < 0.5 * points_.length_px() / region_.cell_px || fresh < 0.6 * events) continue;
      scale_ = scale;
      tried_at_[static_cast<std::size_t>(scale)] = recent_.pushed();
      const auto back = std::min({static_cast<std::size_t>(events / 2), recent_.size(), kReplayed});
      replayed_ = recent_.pushed() - back;
      evidence_.start(region_, scale, events);
      phase_ = Phase::weighing;
      return true;
    }
    return false;
  }

  int weigh() noexcept {
    if (evidence_.step(counts_)) {
      for (std::size_t axis = 0; axis < 4; ++axis) place_[axis] = -most_[axis];
      best_nodes_.restart(static_cast<int>(std::lround(kStep / step_cells_)));
      project_points();
      phase_ = Phase::scanning;
    }
    return kRowCost * region_.width;
  }

  // At the present depth and turn: a shift in the image moves all of them alike.
  void project_points() noexcept {
    const Eigen::Isometry3d T = moved(T_rough_, grid_step({0, 0, place_[2], place_[3]}));
    for (std::size_t i = 0; i < points_.size(); ++i) projected_[i] = cell_of(T * points_[i]);
  }

  // Looks at one place of the grid.
  int scan() noexcept {
    const Eigen::Array2i shift = (grid_step(place_).head<2>() / region_.cell_px).array().round().cast<int>();
    int score = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) score += evidence_at(projected_[i] + shift);
    best_nodes_.add({place_, score});
    const auto points = static_cast<int>(points_.size());
    if (next(0) || next(1)) return points;
    if (next(2) || next(3)) {
      project_points();
      return kPointCost * points;
    }
    for (std::size_t i = 0; i < best_nodes_.size(); ++i) {
      candidates_[i].T = moved(T_rough_, grid_step(best_nodes_[i].place));
      candidates_[i].score = score_of(candidates_[i].T);
    }
    refined_ = 0;
    start_refining();
    phase_ = Phase::refining;
    return kPointCost * points * static_cast<int>(best_nodes_.size());
  }

  // The next place along an axis; false, and back to the first, after the last.
  bool next(std::size_t axis) noexcept {
    if (++place_[axis] <= most_[axis]) return true;
    place_[axis] = -most_[axis];
    return false;
  }

  Eigen::Array2i cell_of(const Eigen::Vector3d& P) const noexcept {
    constexpr double kAway = 1e6;
    if (!(P.z() > 1e-6)) return Eigen::Array2i::Constant(static_cast<int>(kAway));
    const Eigen::Vector2d place = region_.place(focal_length_ / P.z() * P.head<2>());
    return place.array().floor().max(-kAway).min(kAway).cast<int>();
  }

  int evidence_at(const Eigen::Array2i& cell) const noexcept {
    const bool inside = static_cast<unsigned>(cell.x()) < static_cast<unsigned>(region_.width) &&
                        static_cast<unsigned>(cell.y()) < static_cast<unsigned>(region_.height);
    return inside ? evidence_[static_cast<std::size_t>(cell.y() * region_.width + cell.x())] : 0;
  }

  int score_of(const Eigen::Isometry3d& T) const noexcept {
    int score = 0;
    for (const Eigen::Vector3d& point : points_) score += evidence_at(cell_of(T * point));
    return score;
  }

  void start_refining() noexcept {
    constexpr double kTilt = 0.05;
    const double step_px = kStep / 2 * region_.cell_px, turn = step_px / radius_px_;
    steps_ << step_px, step_px, turn, kTilt, kTilt, turn;
    trial_ = 0;
  }

  // Tries to move one candidate along one axis.
  int refine() noexcept {
    constexpr int kHalvings = 4, kRounds = 3, kTrials = 12;
    Candidate& candidate = candidates_[refined_];
    const int axis = trial_ % kTrials / 2;
    const Eigen::Isometry3d T = moved(candidate.T, (trial_ % 2 == 0 ? -1 : 1) * steps_(axis) * Vector6::Unit(axis));
    if (const int score = score_of(T); score > candidate.score) candidate = {T, score};
    if (++trial_ % (kRounds * kTrials) == 0) steps_ /= 2;
    if (trial_ == kHalvings * kRounds * kTrials) {
      start_refining();
      if (++refined_ == best_nodes_.size()) judge();
    }
    return kPointCost * static_cast<int>(points_.size());
  }

  void judge() noexcept {
    const std::span<const Candidate> all(candidates_.data(), best_nodes_.size());
    const Candidate best = *std::ranges::max_element(all, {}, &Candidate::score);
    int rival = 0;  // noise: no better than any place
    for (const Candidate& other : all)
      if (apart(other.T, best.T)) rival = std::max(rival, other.score);
    T_found_ = best.T;
    evidence_nats_ = best.score / EdgeEvidence::kUnit;
    lead_nats_ = (best.score - rival) / EdgeEvidence::kUnit;
    ++searches_;
    phase_ = Phase::waiting;
    if (evidence_nats_ < needed_nats_ || lead_nats_ < -std::log(settings_.wrong_basins)) return;
    state_ = State::found;
    skip_forgotten();
  }

  // Whether two poses are so far from each other that a tracker does not come from one to the other.
  bool apart(const Eigen::Isometry3d& T, const Eigen::Isometry3d& U) const noexcept {
    double squared_px = 0;
    for (const Eigen::Vector3d& point : points_) {
      const Eigen::Vector3d P = T * point, Q = U * point;
      squared_px += (focal_length_ * (P.head<2>() / P.z() - Q.head<2>() / Q.z())).squaredNorm();
    }
    const double same_px = kStep * region_.cell_px;
    return squared_px > same_px * same_px * static_cast<double>(points_.size());
  }

  void skip_forgotten() noexcept {
    if (!recent_.reaches(replayed_)) replayed_ = recent_.pushed() - recent_.size();
  }

  StartPoseSearchSettings settings_;
  MarkerModel model_;
  double focal_length_;
  Eigen::AlignedBox2d image_;

  Eigen::Isometry3d T_rough_ = Eigen::Isometry3d::Identity();
  StartPoseReach reach_;
  double radius_px_ = 1;  // of the wireframe in the image
  CellRegion region_;
  WireframePoints points_;
  double step_cells_ = kStep;  // of the grid
  std::array<int, 4> most_{};  // its steps to each side: right, down, depth, turn
  double needed_nats_ = 0;

  FadingCounts counts_{kSide * kSide};
  EdgeEvidence evidence_{kSide * kSide};
  EventHistory recent_{2 * kReplayed};  // near the wireframe
  std::optional<Timestamp> since_;      // the first event
  Timestamp last_ = 0;                  // the last one
  double earned_ = 0;                   // [look-ups]

  State state_ = State::searching;
  Phase phase_ = Phase::waiting;
  int scale_ = 0;
  std::array<std::uint64_t, FadingCounts::kScales> tried_at_{};     // positions in `recent_`
  std::array<int, 4> place_{};                                      // of the grid
  std::array<Eigen::Array2i, WireframePoints::kMost> projected_{};  // [cells]
  DistinctBest best_nodes_;
  std::array<Candidate, DistinctBest::kMost> candidates_{};
  std::size_t refined_ = 0;
  int trial_ = 0;
  Vector6 steps_ = Vector6::Zero();

  Eigen::Isometry3d T_found_ = Eigen::Isometry3d::Identity();
  double evidence_nats_ = 0, lead_nats_ = 0;
  int searches_ = 0;
  std::uint64_t replayed_ = 0;
};

}  // namespace evmarker
