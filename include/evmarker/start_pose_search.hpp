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
#include <utility>

#include "evmarker/edge_evidence.hpp"
#include "evmarker/event.hpp"
#include "evmarker/event_history.hpp"
#include "evmarker/fading_counts.hpp"
#include "evmarker/marker_model.hpp"
#include "evmarker/so3.hpp"

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
    restart(T_rough, {settings_.reach_share * box_of(T_rough).sizes().maxCoeff(), settings_.depth_share,
                      settings_.rotation_rad});
  }

  /// Searches around another pose, as far as is said. Neither allocates nor takes longer than an event.
  void restart(const Eigen::Isometry3d& T_rough, const StartPoseReach& reach) noexcept {
    T_rough_ = T_rough;
    reach_ = reach;
    lay_region();
    place_points();
    lay_steps();
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
  }

  /// Takes an event with its undistorted pixel, counted from the principal point. True when it completes the search.
  bool push(const Event& event, const Eigen::Vector2d& u) noexcept {
    if (state_ != State::searching) return false;
    if (!since_) since_ = event.t;
    if (settings_.longest && event.t > *since_ && event.t - *since_ > settings_.longest->count()) {
      state_ = State::given_up;
      return true;
    }
    if (const int cell = cell_of(u); cell >= 0) {
      counts_.add(static_cast<std::size_t>(cell), event.t);
      recent_.push(event);
    }
    work();
    return state_ != State::searching;
  }

  State state() const noexcept { return state_; }
  /// The pose that was found, of the first event to replay.
  const Eigen::Isometry3d& T_found() const noexcept { return best().T; }

  bool searching() const noexcept { return state_ == State::searching; }

  /// Once found, the events near the wireframe from about when it was there are to be replayed, one with each call while
  /// `replaying()`. Until then `keep` takes the new ones.
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
  static constexpr int kSide = 256;
  static constexpr int kWork = 16384;            // look-ups for an event at most
  static constexpr int kRowCost = 8, kPointCost = 8;  // of a row's cell, of a point that is projected [look-ups]
  static constexpr std::size_t kMostPoints = 128, kKept = 8, kReplayed = 4096;
  static constexpr double kSpacing = 4;  // [cells] of the points along the edges: they err together if nearer
  static constexpr double kStep = 3;     // [cells] of the coarse search: half of what an edge is felt at

  using Vector6 = Eigen::Matrix<double, 6, 1>;
  enum class Phase { waiting, weighing, scanning, refining };

  struct Candidate {
    std::array<int, 4> place{};  // shifts, depth, turn [steps]
    int score = 0;               // [1 / EdgeEvidence::kUnit nat]
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  };

  // --- The region, the points and the steps, at the rough pose ---

  template <typename Use>
  void for_each_visible(const Eigen::Isometry3d& T, const Use& use) const noexcept {
    for (const MarkerSegment& edge : model_.segments) {
      const Eigen::Vector3d &from = model_.vertices[static_cast<std::size_t>(edge.from)],
                            &to = model_.vertices[static_cast<std::size_t>(edge.to)];
      const Eigen::Vector3d a = T * from, b = T * to;
      if (a.z() > 1e-6 && b.z() > 1e-6 && faces_camera(edge, a, T.linear()))
        use(from, to, focal_length_ / a.z() * a.head<2>(), focal_length_ / b.z() * b.head<2>());
    }
  }

  Eigen::AlignedBox2d box_of(const Eigen::Isometry3d& T) const noexcept {
    Eigen::AlignedBox2d box(Eigen::Vector2d::Zero().eval());
    bool empty = true;
    for_each_visible(T, [&](const auto&, const auto&, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
      if (std::exchange(empty, false)) box = Eigen::AlignedBox2d(a);
      box.extend(a).extend(b);
    });
    return box;
  }

  void lay_region() noexcept {
    Eigen::AlignedBox2d box = box_of(T_rough_);
    size_px_ = std::max(1.0, box.sizes().maxCoeff());
    const double margin = reach_.sideways_px + 0.5 * size_px_ * (reach_.depth_share + std::min(reach_.rotation_rad, 1.0));
    box = Eigen::AlignedBox2d(box.min().array() - margin, box.max().array() + margin);
    box = box.intersection(image_);
    if (box.isEmpty()) box = Eigen::AlignedBox2d(Eigen::Vector2d::Zero().eval());
    cell_px_ = std::max(1.0, box.sizes().maxCoeff() / (kSide - 2 * EdgeEvidence::kFar - 1));
    const int margin_cells = EdgeEvidence::kFar;
    low_ = box.min().array() - margin_cells * cell_px_;
    const Eigen::Vector2i size = ((box.sizes() / cell_px_).array().floor().cast<int>() + 2 * margin_cells + 1).min(kSide);
    width_ = size.x();
    height_ = size.y();
    const auto cells = [&](const Eigen::Vector2d& u) { return ((u - low_) / cell_px_).array().floor().cast<int>().eval(); };
    const Eigen::Array2i first = cells(image_.min()).max(0), last = cells(image_.max()).min(size.array() - 1);
    on_sensor_ = {first.x(), first.y(), last.x() + 1, last.y() + 1};
  }

  void place_points() noexcept {
    double length_px = 0;
    for_each_visible(T_rough_, [&](const auto&, const auto&, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
      length_px += (b - a).norm();
    });
    length_cells_ = length_px / cell_px_;
    const double wanted = std::clamp(length_cells_ / kSpacing, 1.0, static_cast<double>(kMostPoints));
    const double spacing_px = length_px / std::floor(wanted);
    double next_px = spacing_px / 2;  // from the beginning of the present edge
    point_count_ = 0;
    centre_.setZero();
    for_each_visible(T_rough_, [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector2d& a,
                                   const Eigen::Vector2d& b) {
      const double edge_px = (b - a).norm();
      for (; next_px < edge_px && point_count_ < kMostPoints; next_px += spacing_px)
        centre_ += points_[point_count_++] = from + next_px / edge_px * (to - from);
      next_px -= edge_px;
    });
    centre_ /= static_cast<double>(std::max<std::size_t>(1, point_count_));
  }

  void lay_steps() noexcept {
    const double step_px = kStep * cell_px_, radius_px = 0.5 * size_px_;
    const auto steps = [](double way, double step) { return static_cast<int>(std::ceil(std::max(0.0, way) / step)); };
    sideways_ = steps(reach_.sideways_px, step_px);
    depths_ = steps(reach_.depth_share * radius_px, step_px);
    turns_ = steps(reach_.rotation_rad * radius_px, step_px);
    const auto places = [](int to_each_side) { return 2.0 * to_each_side + 1; };
    const double candidates = places(sideways_) * places(sideways_) * places(depths_) * places(turns_);
    needed_nats_ = std::log(candidates / settings_.false_alarms);
    least_lead_nats_ = -std::log(settings_.wrong_basins);
  }

  int cell_of(const Eigen::Vector2d& u) const noexcept {
    const Eigen::Vector2d p = (u - low_) / cell_px_;
    const bool inside = p.x() >= 0 && p.y() >= 0 && p.x() < width_ && p.y() < height_;
    return inside ? static_cast<int>(p.y()) * width_ + static_cast<int>(p.x()) : -1;
  }

  // A step sideways [px in the image], along the line of sight [share of the depth], and a rotation about the middle.
  Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vector6& step) const noexcept {
    const Eigen::Vector3d middle = T * centre_;
    const Eigen::Matrix3d R = so3_exp(step.tail<3>());
    Eigen::Isometry3d moved;
    moved.linear() = R * T.linear();
    moved.translation() = middle + R * (T.translation() - middle) + step(2) * middle;
    moved.translation().head<2>() += step.head<2>() * (middle.z() / focal_length_);
    return moved;
  }

  Vector6 coarse_step(const std::array<int, 4>& place) const noexcept {
    const auto part = [](int step, int steps) { return steps > 0 ? static_cast<double>(step) / steps : 0.0; };
    Vector6 step = Vector6::Zero();
    step << reach_.sideways_px * part(place[0], sideways_), reach_.sideways_px * part(place[1], sideways_),
        reach_.depth_share * part(place[2], depths_), 0, 0, reach_.rotation_rad * part(place[3], turns_);
    return step;
  }

  // --- The search, a step with every event ---

  void work() noexcept {
    if (phase_ == Phase::waiting && !begin()) return;
    for (int left = kWork; left > 0 && phase_ != Phase::waiting;) {
      if (phase_ == Phase::weighing) left -= weigh();
      else if (phase_ == Phase::scanning) left -= scan();
      else left -= refine();
    }
  }

  // Searches when half of the edges' cells can have had an event and those on which it was tried last are mostly gone.
  // Every time on longer memory, until that holds no more: then anew with the shortest.
  bool begin() noexcept {
    for (int i = 1; i <= FadingCounts::kScales; ++i) {
      const int scale = (scale_ + i) % FadingCounts::kScales;
      const double events = counts_.total(scale);
      const auto fresh = static_cast<double>(recent_.pushed() - tried_at_[static_cast<std::size_t>(scale)]);
      if (events < 0.5 * length_cells_ || fresh < 0.6 * events) continue;
      scale_ = scale;
      tried_at_[static_cast<std::size_t>(scale)] = recent_.pushed();
      const auto back = std::min({static_cast<std::size_t>(events / 2), recent_.size(), kReplayed});
      replayed_ = recent_.pushed() - back;
      evidence_.start(width_, height_, on_sensor_, scale, events);
      phase_ = Phase::weighing;
      return true;
    }
    return false;
  }

  int weigh() noexcept {
    if (evidence_.step(counts_)) {
      place_ = {-sideways_, -sideways_, -depths_, -turns_};
      kept_ = 0;
      project_points();
      phase_ = Phase::scanning;
    }
    return kRowCost * width_;
  }

  // Of the present depth and turn.
  void project_points() noexcept {
    const Eigen::Isometry3d T = moved(T_rough_, coarse_step({0, 0, place_[2], place_[3]}));
    for (std::size_t i = 0; i < point_count_; ++i) {
      const Eigen::Vector3d P = T * points_[i];
      const Eigen::Vector2d p = (focal_length_ / P.z() * P.head<2>() - low_) / cell_px_;
      x_[i] = static_cast<int>(std::clamp(p.x(), -1e6, 1e6));
      y_[i] = static_cast<int>(std::clamp(p.y(), -1e6, 1e6));
    }
  }

  int scan() noexcept {
    const Vector6 step = coarse_step(place_);
    const int dx = static_cast<int>(std::lround(step(0) / cell_px_)), dy = static_cast<int>(std::lround(step(1) / cell_px_));
    int score = 0;
    for (std::size_t i = 0; i < point_count_; ++i) score += look_up(x_[i] + dx, y_[i] + dy);
    keep({place_, score});
    const auto advance = [&](std::size_t axis, int most) { return ++place_[axis] > most ? (place_[axis] = -most, true) : false; };
    int cost = static_cast<int>(point_count_) + 16;
    if (advance(0, sideways_) && advance(1, sideways_)) {
      if (advance(2, depths_) && advance(3, turns_)) {
        for (std::size_t i = 0; i < kept_; ++i) {
          best_[i].T = moved(T_rough_, coarse_step(best_[i].place));
          best_[i].score = score_of(best_[i].T);
        }
        refined_ = 0;
        start_refining();
        phase_ = Phase::refining;
        return cost + static_cast<int>(kKept * point_count_) * kPointCost;
      }
      project_points();
      cost += static_cast<int>(point_count_) * kPointCost;
    }
    return cost;
  }

  int look_up(int x, int y) const noexcept {
    const bool inside = static_cast<unsigned>(x) < static_cast<unsigned>(width_) &&
                        static_cast<unsigned>(y) < static_cast<unsigned>(height_);
    return inside ? evidence_.data()[y * width_ + x] : 0;
  }

  // The best ones, each of another place: those beside a better one lead to the same pose.
  void keep(const Candidate& candidate) noexcept {
    if (kept_ == kKept && candidate.score <= best_[kKept - 1].score) return;
    const auto beside = [&](const Candidate& other) {
      for (std::size_t axis = 0; axis < 4; ++axis)
        if (std::abs(other.place[axis] - candidate.place[axis]) > 1) return false;
      return true;
    };
    std::size_t i = 0;
    for (; i < kept_ && best_[i].score >= candidate.score; ++i)
      if (beside(best_[i])) return;
    std::size_t end = i;
    while (end < kept_ && !beside(best_[end])) ++end;
    if (end == kept_) {
      if (kept_ < kKept) ++kept_;
      else --end;
    }
    for (; end > i; --end) best_[end] = best_[end - 1];
    best_[i] = candidate;
  }

  int score_of(const Eigen::Isometry3d& T) const noexcept {
    int score = 0;
    for (std::size_t i = 0; i < point_count_; ++i) {
      const Eigen::Vector3d P = T * points_[i];
      if (!(P.z() > 1e-6)) continue;
      const Eigen::Vector2d p = (focal_length_ / P.z() * P.head<2>() - low_) / cell_px_;
      if (p.x() >= 0 && p.y() >= 0) score += look_up(static_cast<int>(p.x()), static_cast<int>(p.y()));
    }
    return score;
  }

  void start_refining() noexcept {
    const double step_px = kStep * cell_px_ / 2, radius_px = 0.5 * size_px_;
    const double depth = step_px / radius_px, turn = step_px / radius_px;
    steps_ << step_px, step_px, depth, 0.05, 0.05, turn;
    trial_ = 0;
  }

  // Tries to move one candidate along one axis.
  int refine() noexcept {
    constexpr int kHalvings = 4, kRounds = 3, kTrials = 12;
    Candidate& candidate = best_[refined_];
    const int axis = trial_ % kTrials / 2;
    const Eigen::Isometry3d T = moved(candidate.T, (trial_ % 2 == 0 ? -1 : 1) * steps_(axis) * Vector6::Unit(axis));
    if (const int score = score_of(T); score > candidate.score) {
      candidate.T = T;
      candidate.score = score;
    }
    if (++trial_ % (kRounds * kTrials) == 0) steps_ /= 2;
    if (trial_ == kHalvings * kRounds * kTrials) {
      start_refining();
      if (++refined_ == kept_) judge();
    }
    return static_cast<int>(point_count_) * kPointCost;
  }

  void skip_forgotten() noexcept {
    if (!recent_.reaches(replayed_)) replayed_ = recent_.pushed() - recent_.size();
  }

  const Candidate& best() const noexcept { return best_[best_index_]; }

  // Whether two poses are so far from each other that a tracker does not come from one to the other.
  bool apart(const Eigen::Isometry3d& T, const Eigen::Isometry3d& U) const noexcept {
    double squared_px = 0;
    for (std::size_t i = 0; i < point_count_; ++i) {
      const Eigen::Vector3d P = T * points_[i], Q = U * points_[i];
      squared_px += (focal_length_ * (P.head<2>() / P.z() - Q.head<2>() / Q.z())).squaredNorm();
    }
    const double same_px = kStep * cell_px_;
    return squared_px > same_px * same_px * static_cast<double>(point_count_);
  }

  void judge() noexcept {
    best_index_ = 0;
    for (std::size_t i = 1; i < kept_; ++i)
      if (best_[i].score > best().score) best_index_ = i;
    int rival = 0;
    for (std::size_t i = 0; i < kept_; ++i)
      if (apart(best_[i].T, best().T)) rival = std::max(rival, best_[i].score);
    evidence_nats_ = best().score / EdgeEvidence::kUnit;
    lead_nats_ = (best().score - rival) / EdgeEvidence::kUnit;
    ++searches_;
    if (evidence_nats_ >= needed_nats_ && lead_nats_ >= least_lead_nats_) state_ = State::found;
    phase_ = Phase::waiting;
    skip_forgotten();
  }

  StartPoseSearchSettings settings_;
  MarkerModel model_;
  double focal_length_;
  Eigen::AlignedBox2d image_;
  State state_ = State::searching;

  Eigen::Isometry3d T_rough_ = Eigen::Isometry3d::Identity();
  StartPoseReach reach_;
  double size_px_ = 1, length_cells_ = 0;
  Eigen::Vector2d low_{0, 0};  // corner of the region
  double cell_px_ = 1;
  int width_ = 1, height_ = 1;
  std::array<int, 4> on_sensor_{};                 // left, top, right, bottom [cells]
  std::array<Eigen::Vector3d, kMostPoints> points_;  // along the visible edges, marker frame [m]
  std::size_t point_count_ = 0;
  Eigen::Vector3d centre_{0, 0, 0};             // of the points
  int sideways_ = 0, depths_ = 0, turns_ = 0;   // coarse steps to each side
  double needed_nats_ = 0, least_lead_nats_ = 0;

  FadingCounts counts_{kSide * kSide};
  EdgeEvidence evidence_{kSide * kSide};
  EventHistory recent_{2 * kReplayed};
  std::optional<Timestamp> since_;

  Phase phase_ = Phase::waiting;
  int scale_ = 0;
  std::array<std::uint64_t, FadingCounts::kScales> tried_at_{};
  std::uint64_t replayed_ = 0;
  std::array<int, 4> place_{};  // that is scanned
  std::array<int, kMostPoints> x_{}, y_{};
  std::array<Candidate, kKept> best_{};
  std::size_t kept_ = 0, refined_ = 0, best_index_ = 0;
  Vector6 steps_ = Vector6::Zero();
  int trial_ = 0;
  double evidence_nats_ = 0, lead_nats_ = 0;
  int searches_ = 0;
};

}  // namespace evmarker
