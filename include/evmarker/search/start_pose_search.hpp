#pragma once
// Looks for a wireframe near a rough pose until its events show it, a bounded step with every event.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "evmarker/base/box.hpp"
#include "evmarker/base/require.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/search/cell_region.hpp"
#include "evmarker/search/edge_evidence.hpp"
#include "evmarker/search/fading_counts.hpp"
#include "evmarker/search/pose_grid_search.hpp"
#include "evmarker/search/wireframe_points.hpp"

namespace evmarker {

struct StartPoseSearchSettings {
  double reach_share = 0.18;    ///< StartPoseReach::sideways_px of a start pose, of the wireframe's size in the image
  double depth_share = 0.1;     ///< of the depth
  double rotation_rad = 0.105;  ///< about the line of sight
  double false_alarms = 1e-6;   ///< share of the searches in mere noise that may end with a pose
  double wrong_basins = 1e-3;   ///< share of the poses found that may belong to another place of the wireframe
  std::optional<std::chrono::microseconds> longest{};  ///< then it is given up; not at all if empty
};

/// @throws std::invalid_argument naming the setting that is out of range
inline void validate(const StartPoseSearchSettings& settings) {
  const Require require("start search");
  const auto is_probability = [](double value) { return value > 0 && value < 1; };
  require.positive(settings.reach_share, "reach_share");
  require(settings.depth_share > 0 && settings.depth_share < 1, "depth_share", settings.depth_share);
  require.positive(settings.rotation_rad, "rotation_rad");
  require(is_probability(settings.false_alarms), "false_alarms", settings.false_alarms);
  require(is_probability(settings.wrong_basins), "wrong_basins", settings.wrong_basins);
  if (settings.longest) require(settings.longest->count() > 0, "longest [us]", settings.longest->count());
}

/// Counts the events near a wireframe and searches, again and again, for the pose at which they speak for its edges:
/// all shifts, depths and turns within reach, then all six degrees of freedom in ever smaller steps. It believes a pose
/// when noise anywhere within reach would hardly ever look as good, and no other pose does either.
///
/// Each event does at most kMostLookUps look-ups, whatever the resolution, distance and reach: 20 to 40 us. All memory
/// is allocated by the constructor. The region around the wireframe has at most kSide x kSide cells, of a pixel or
/// more.
class StartPoseSearch {
 public:
  enum class State { searching, found, given_up };

  /// @param focal_length [px]
  /// @param image the sensor, undistorted, from the principal point [px]
  /// @throws std::invalid_argument naming the setting that is out of range
  StartPoseSearch(MarkerModel model, double focal_length, const Box& image, const Eigen::Isometry3d& T_rough,
                  const StartPoseSearchSettings& settings)
      : settings_(settings), model_(std::move(model)), focal_length_(focal_length), image_(image) {
    validate(settings);
    restart(T_rough);
  }

  /// Searches around another pose, as far as the settings say.
  void restart(const Eigen::Isometry3d& T_rough) noexcept {
    restart(T_rough, {settings_.reach_share * image_box(model_, focal_length_, T_rough).size(), settings_.depth_share,
                      settings_.rotation_rad});
  }

  /// Searches around another pose, as far as is said. Does not allocate.
  void restart(const Eigen::Isometry3d& T_rough, const StartPoseReach& reach) noexcept {
    lay_out(T_rough, reach);
    state_ = State::searching;
    since_.reset();
    earned_ = kMostEarned;
    forget();
  }

  /// Forgets the events so far: there is a gap behind them.
  void forget() noexcept {
    counts_.restart();
    recent_.clear();
    phase_ = Phase::waiting;
    tried_at_.fill(recent_.pushed());
    scale_ = FadingCounts::kScales - 1;
  }

  /// Takes an event with its undistorted pixel, counted from the principal point. True when it completes the search.
  bool push(const Event& event, Vec2 u) noexcept {
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
  bool searching() const noexcept { return state_ == State::searching; }
  /// The pose that was found, of the first event to replay.
  const Eigen::Isometry3d& T_found() const noexcept { return grid_.T_best(); }

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
  double evidence() const noexcept { return grid_.evidence(); }
  double needed_evidence() const noexcept { return needed_nats_; }
  double lead() const noexcept { return grid_.lead(); }
  /// Searches that were completed, and the look-ups that all of them took.
  int searches() const noexcept { return searches_; }
  std::uint64_t look_ups() const noexcept { return look_ups_; }
  static constexpr int kMostLookUps = 26000;  ///< for an event

 private:
  static constexpr int kSide = 256;    // [cells] of the region at most
  static constexpr int kWork = 16384;  // look-ups for an event, after which the step that it was in is completed
  // In the long run, so that noise or clutter without a marker does not keep a core busy; but a start is in a hurry.
  static constexpr double kWorkPerUs = 500, kMostEarned = 2e7;  // look-ups for a microsecond, and saved up
  static constexpr int kCellCost = 12;                          // of a cell in a pass of EdgeEvidence [look-ups]
  static constexpr std::size_t kReplayed = 4096;

  enum class Phase { waiting, weighing, searching };

  // The region, the points and the grid, at the rough pose.
  void lay_out(const Eigen::Isometry3d& T_rough, const StartPoseReach& reach) noexcept {
    const Box box = image_box(model_, focal_length_, T_rough);
    const double radius_px = std::max(1.0, box.size()) / 2;
    const double margin_px = reach.sideways_px + radius_px * (reach.depth_share + std::min(reach.rotation_rad, 1.0));
    region_ = CellRegion::of(box.widened(margin_px), image_, kSide, EdgeEvidence::kFar);
    WireframePoints points;
    points.place(model_, focal_length_, T_rough, PoseGridSearch::kSpacing * region_.cell_px);
    least_events_ = 0.5 * points.length_px() / region_.cell_px;
    grid_.lay(region_, points, focal_length_, T_rough, reach, radius_px);
    needed_nats_ = std::log(grid_.places() / settings_.false_alarms);
  }

  void work(Timestamp t) noexcept {
    earned_ = std::min(earned_ + kWorkPerUs * static_cast<double>(t > last_ ? elapsed_us(last_, t) : 0), kMostEarned);
    last_ = t;
    if (phase_ == Phase::waiting && (earned_ < 0 || !begin())) return;
    int done = 0;
    while (done < kWork && phase_ != Phase::waiting) done += phase_ == Phase::weighing ? weigh() : search();
    earned_ -= done;
    look_ups_ += static_cast<std::uint64_t>(done);
  }

  // Searches when half of the edges' cells can have had an event and those on which it was tried last are mostly gone.
  // Every time on longer memory, until that holds no more: then anew with the shortest.
  bool begin() noexcept {
    for (int i = 1; i <= FadingCounts::kScales; ++i) {
      const int scale = (scale_ + i) % FadingCounts::kScales;
      const double events = counts_.total(scale);
      const auto fresh = static_cast<double>(recent_.pushed() - tried_at_[static_cast<std::size_t>(scale)]);
      if (events < least_events_ || fresh < 0.6 * events) continue;
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
      grid_.start();
      phase_ = Phase::searching;
    }
    return kCellCost * region_.width;
  }

  int search() noexcept {
    const int cost = grid_.step(evidence_);
    if (grid_.done()) judge();
    return cost;
  }

  void judge() noexcept {
    ++searches_;
    phase_ = Phase::waiting;
    if (evidence() < needed_nats_ || lead() < -std::log(settings_.wrong_basins)) return;
    state_ = State::found;
    skip_forgotten();
  }

  void skip_forgotten() noexcept {
    if (!recent_.reaches(replayed_)) replayed_ = recent_.pushed() - recent_.size();
  }

  StartPoseSearchSettings settings_;
  MarkerModel model_;
  double focal_length_;
  Box image_;

  CellRegion region_;
  PoseGridSearch grid_;
  double needed_nats_ = 0, least_events_ = 0;

  FadingCounts counts_{kSide * kSide};
  EdgeEvidence evidence_{kSide * kSide};
  EventHistory recent_{2 * kReplayed};  // near the wireframe
  std::optional<Timestamp> since_;      // the first event
  Timestamp last_ = 0;                  // the last one
  double earned_ = 0;                   // [look-ups]

  State state_ = State::searching;
  Phase phase_ = Phase::waiting;
  int scale_ = 0;
  std::array<std::uint64_t, FadingCounts::kScales> tried_at_{};  // positions in `recent_`
  int searches_ = 0;
  std::uint64_t look_ups_ = 0;
  std::uint64_t replayed_ = 0;
};

}  // namespace evmarker
