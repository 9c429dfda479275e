#pragma once
// Search for a wireframe near a rough pose, with a bounded amount of work for every event.
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
#include "evmarker/events/camera_time.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/search/cell_region.hpp"
#include "evmarker/search/edge_evidence.hpp"
#include "evmarker/search/fading_counts.hpp"
#include "evmarker/search/pose_grid_search.hpp"
#include "evmarker/search/wireframe_points.hpp"

namespace evmarker {

/// How far around a start pose to search, and when to accept a pose.
struct StartPoseSearchSettings {
  double reach_share = 0.18;    ///< StartPoseReach::sideways_px, as a share of the wireframe's size in the image
  double depth_share = 0.1;     ///< StartPoseReach::depth_share
  double rotation_rad = 0.105;  ///< StartPoseReach::rotation_rad
  double false_alarms =
      1e-6;  ///< share of the attempts in mere noise that find a pose; hundreds may be made in a second
  double wrong_basins = 1e-3;  ///< share of the poses found from which a tracker converges to a wrong one
  std::optional<std::chrono::microseconds> longest{};  ///< camera time after which the search is given up; empty: never
};

/// Rejects settings that make no sense.
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

/// Counts the events near a wireframe and attempts, again and again, to find the pose at which they give the most
/// evidence for its edges (see `PoseGridSearch`). A pose is accepted when noise anywhere within reach would hardly ever
/// reach its evidence, and no other pose comes near it.
///
/// Every event costs at most kMostLookUps look-ups (20 to 40 us), whatever the resolution, distance and reach. All
/// memory is allocated by the constructor.
class StartPoseSearch {
 public:
  /// A search ends when it has found a pose, or is given up after StartPoseSearchSettings::longest.
  enum class State { searching, found, given_up };

  /// @param focal_length [px]
  /// @param image the undistorted image of the sensor [px from the principal point]
  /// @param T_rough T_camera_marker at about the first event
  /// @throws std::invalid_argument naming the setting that is out of range
  StartPoseSearch(MarkerModel model, double focal_length, const Box& image, const Eigen::Isometry3d& T_rough,
                  const StartPoseSearchSettings& settings)
      : settings_(settings), model_(std::move(model)), focal_length_(focal_length), image_(image) {
    validate(settings);
    restart(T_rough);
  }

  /// Starts a new search around another pose, with the reach of the settings. Does not allocate.
  void restart(const Eigen::Isometry3d& T_rough) noexcept {
    restart(T_rough, {settings_.reach_share * image_box(model_, focal_length_, T_rough).size(), settings_.depth_share,
                      settings_.rotation_rad});
  }

  /// Starts a new search around another pose, with another reach. Does not allocate.
  void restart(const Eigen::Isometry3d& T_rough, const StartPoseReach& reach) noexcept {
    set_region_and_grid(T_rough, reach);
    state_ = State::searching;
    time_ = {};
    searched_us_ = 0;
    budget_ = kFullBudget;
    forget();
  }

  /// Discards all events so far, as needed after a gap in the events; the search goes on.
  void forget() noexcept {
    counts_.restart();
    recent_.clear();
    phase_ = Phase::waiting;
    tried_at_.fill(recent_.pushed());
    scale_ = FadingCounts::kScales - 1;
  }

  /// Takes an event and does a part of the search; does nothing if the search has ended.
  /// @param u the event's undistorted pixel [px from the principal point]
  /// @return true if the search ends with this event
  bool push(const Event& event, Vec2 u) noexcept {
    if (state_ != State::searching) return false;
    const auto passed_us = static_cast<double>(time_.advance(event.t));
    searched_us_ += passed_us;
    if (settings_.longest && searched_us_ > static_cast<double>(settings_.longest->count())) {
      state_ = State::given_up;
      return true;
    }
    if (const int cell = region_.cell(u); cell >= 0) {
      counts_.add(static_cast<std::size_t>(cell), event.t);
      recent_.push(event);
    }
    budget_ = std::min(budget_ + kBudgetPerUs * passed_us, kFullBudget);
    do_work();
    return state_ != State::searching;
  }

  State state() const noexcept { return state_; }
  bool searching() const noexcept { return state_ == State::searching; }
  /// The pose found, T_camera_marker at about the time of the first event to replay. Valid once the state is `found`.
  const Eigen::Isometry3d& T_found() const noexcept { return grid_.T_best(); }

  /// True while events near the wireframe, since about the time of the pose found, are left to replay.
  bool replaying() const noexcept { return state_ == State::found && next_replayed_ != recent_.pushed(); }
  /// The next event to replay. Requires `replaying()`.
  const Event& replay() noexcept { return recent_.at(next_replayed_++); }
  /// Stores a new event that comes during the replay, to be replayed after the others.
  void keep(const Event& event) noexcept {
    recent_.push(event);
    skip_overwritten();
  }

  /// Of the last attempt: the evidence of its best pose, see `PoseGridSearch` [nats].
  double evidence() const noexcept { return grid_.evidence(); }
  /// The evidence that a pose needs to be accepted [nats].
  double needed_evidence() const noexcept { return needed_nats_; }
  /// Of the last attempt: the lead of its best pose over all others, see `PoseGridSearch` [nats].
  double lead() const noexcept { return grid_.lead(); }
  /// Attempts completed since the construction.
  int attempts() const noexcept { return attempts_; }
  /// Look-ups made since the construction.
  std::uint64_t look_ups() const noexcept { return look_ups_; }
  static constexpr int kMostLookUps = 26000;  ///< largest number for one event

 private:
  static constexpr int kSide = 256;               // largest width and height of the region [cells]
  static constexpr int kLookUpsPerEvent = 16384;  // look-ups after which an event starts no further step
  // No attempt begins while the budget is overdrawn, so that noise or clutter without a marker takes about half of a
  // core. The budget is full at the start: the first attempts are urgent.
  static constexpr double kBudgetPerUs = 500, kFullBudget = 2e7;  // [look-ups/us], [look-ups]
  static constexpr int kCellCost = 12;                            // of a cell in a pass of EdgeEvidence [look-ups]
  static constexpr std::size_t kReplayed = 4096;                  // largest number of events to replay

  enum class Phase { waiting, computing_evidence, searching_grid };

  // Sets the region, the grid and the thresholds for a rough pose.
  void set_region_and_grid(const Eigen::Isometry3d& T_rough, const StartPoseReach& reach) noexcept {
    const Box box = image_box(model_, focal_length_, T_rough);
    const double radius_px = std::max(1.0, box.size()) / 2;
    const double margin_px = reach.sideways_px + radius_px * (reach.depth_share + std::min(reach.rotation_rad, 1.0));
    region_ = CellRegion::of(box.widened(margin_px), image_, kSide, EdgeEvidence::kFar);
    WireframePoints points;
    points.place(model_, focal_length_, T_rough, PoseGridSearch::kSpacing * region_.cell_px);
    least_events_ = 0.5 * points.length_px() / region_.cell_px;
    grid_.set_grid(region_, points, focal_length_, T_rough, reach, radius_px);
    needed_nats_ = std::log(grid_.places() / settings_.false_alarms);
  }

  // Begins an attempt if none is under way, and does a bounded part of it.
  void do_work() noexcept {
    if (phase_ == Phase::waiting && (budget_ < 0 || !try_to_begin())) return;
    int done = 0;
    while (done < kLookUpsPerEvent && phase_ != Phase::waiting)
      done += phase_ == Phase::computing_evidence ? compute_evidence() : search_grid();
    budget_ -= done;
    look_ups_ += static_cast<std::uint64_t>(done);
  }

  // Begins an attempt at the next longer time scale (after the longest, the shortest) with enough events: at least one
  // for every second cell of the edges, and most of them newer than the last attempt at that scale. Returns false if
  // none has.
  bool try_to_begin() noexcept {
    for (int i = 1; i <= FadingCounts::kScales; ++i) {
      const int scale = (scale_ + i) % FadingCounts::kScales;
      const double events = counts_.total(scale);
      const auto fresh = static_cast<double>(recent_.pushed() - tried_at_[static_cast<std::size_t>(scale)]);
      if (events < least_events_ || fresh < 0.6 * events) continue;
      scale_ = scale;
      tried_at_[static_cast<std::size_t>(scale)] = recent_.pushed();
      // The counts fade: they show the wireframe where it was about half of their number of events ago.
      const auto back = std::min({static_cast<std::size_t>(events / 2), recent_.size(), kReplayed});
      next_replayed_ = recent_.pushed() - back;
      evidence_.start(region_, scale, events);
      phase_ = Phase::computing_evidence;
      return true;
    }
    return false;
  }

  // Does a step of EdgeEvidence; returns its cost.
  int compute_evidence() noexcept {
    if (evidence_.step(counts_)) {
      grid_.start();
      phase_ = Phase::searching_grid;
    }
    return kCellCost * region_.width;
  }

  // Does a step of PoseGridSearch; returns its cost.
  int search_grid() noexcept {
    const int cost = grid_.step(evidence_);
    if (grid_.done()) accept_or_wait();
    return cost;
  }

  // Ends an attempt: its pose is accepted, or the next one waits for new events.
  void accept_or_wait() noexcept {
    ++attempts_;
    phase_ = Phase::waiting;
    if (evidence() < needed_nats_ || lead() < -std::log(settings_.wrong_basins)) return;
    state_ = State::found;
    skip_overwritten();
  }

  // Skips events to replay that the ring no longer has.
  void skip_overwritten() noexcept {
    if (!recent_.reaches(next_replayed_)) next_replayed_ = recent_.pushed() - recent_.size();
  }

  StartPoseSearchSettings settings_;
  MarkerModel model_;
  double focal_length_;
  Box image_;

  CellRegion region_;
  PoseGridSearch grid_;
  double needed_nats_ = 0, least_events_ = 0;  // least evidence of an accepted pose, least events of an attempt

  FadingCounts counts_{kSide * kSide};
  EdgeEvidence evidence_{kSide * kSide};
  EventHistory recent_{2 * kReplayed};  // events in the region
  CameraTime time_;
  double searched_us_ = 0;  // camera time since the first event of this search
  double budget_ = 0;       // [look-ups], negative if overdrawn

  State state_ = State::searching;
  Phase phase_ = Phase::waiting;
  int scale_ = 0;                                                // time scale of the attempt
  std::array<std::uint64_t, FadingCounts::kScales> tried_at_{};  // recent_.pushed() at the last attempt at each scale
  int attempts_ = 0;
  std::uint64_t look_ups_ = 0;
  std::uint64_t next_replayed_ = 0;  // its position in `recent_`
};

}  // namespace evmarker
