#pragma once
// Floor 6. One marker, from a known pose on: follow it, verify it, say when it is lost.
#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <optional>
#include <ranges>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "evmarker/capture.hpp"
#include "evmarker/edge_coverage.hpp"
#include "evmarker/edge_follower.hpp"
#include "evmarker/kalman_update.hpp"
#include "evmarker/matched_fraction.hpp"
#include "evmarker/misfit.hpp"
#include "evmarker/pose.hpp"
#include "evmarker/time_guard.hpp"
#include "evmarker/undistortion_table.hpp"
#include "evmarker/verification.hpp"

namespace evmarker {

template <PoseUpdateRule Rule = KalmanUpdate>
struct MarkerTrackerSettings {
  int events_per_update = 100;          ///< the paper's n, matched events
  SegmentMatcherSettings matching{};    ///< the paper's segment matching
  typename Rule::Settings update{};     ///< gains of the update rule
  VerificationSettings verification{};  ///< the paper's backtracking
  bool polarity_check = false;          ///< events that contradict their edge's motion do not update, see EdgeFollower
  double polarity_check_px_s = 50;      ///< slower edges are not checked [px/s along the normal]
  int converging_events = 2000;         ///< matched first: verified, but not held against the tracker
  double min_matched_fraction = 0.45;   ///< of the events near the edges; below: it follows something else, lost
  int matched_fraction_events = 500;    ///< about how many events that fraction is averaged over
  double max_silent_share = 0.35;       ///< of the edges' motion that makes no events; above: it is hidden, lost
  std::optional<CaptureSettings> capture = CaptureSettings{};  ///< first look for the marker near its start pose
};

/// Tracks one marker event by event. Copyable; after construction nothing throws or allocates.
template <PoseUpdateRule Rule = KalmanUpdate>
class MarkerTracker {
 public:
  using Settings = MarkerTrackerSettings<Rule>;
  /// Events may be missing for so long without harm: edges at 2000 px/s move by the matching distance.
  static constexpr std::chrono::milliseconds kBriefly{1};

  /// @param camera anything that an UndistortionTable can be made of, or a table to share
  /// @param T_camera_marker first pose [m]
  /// @throws std::invalid_argument naming the setting, the model's fault, or a pose behind the camera
  template <typename Camera>
  MarkerTracker(const Camera& camera, MarkerModel model, const Eigen::Isometry3d& T_camera_marker,
                const Settings& settings = {}, MarkerId id = 0)
      : settings_(settings),
        lines_(camera),
        follower_(std::move(model), lines_.focal_length(), T_camera_marker,
                  {settings.events_per_update, settings.matching, settings.update, settings.polarity_check,
                   settings.polarity_check_px_s}),
        verification_(follower_, settings.verification),
        coverage_(follower_.matcher().model(), lines_.focal_length()),
        centre_(centre(follower_.matcher().model())) {
    const auto require = [](bool good, const char* name, auto value) {
      if (!good) throw std::invalid_argument(name + (" is " + std::to_string(value)));
    };
    const Settings& s = settings;
    require(s.converging_events >= 0, "converging_events", s.converging_events);
    require(s.min_matched_fraction >= 0 && s.min_matched_fraction < 1, "min_matched_fraction", s.min_matched_fraction);
    require(s.matched_fraction_events > 0, "matched_fraction_events", s.matched_fraction_events);
    require(s.max_silent_share > 0 && s.max_silent_share <= 1, "max_silent_share", s.max_silent_share);
    pose_.id = id;
    if (settings.capture) {
      capture_.emplace(this->model(), lines_.focal_length(), T_camera_marker, *settings.capture);
      capturing_ = true;
    }
  }

  /// Takes one event. A pose every `events_per_update` matched ones, valid until the next push, and one last pose with
  /// state `lost` when the marker is lost; after that, nothing (null). An event with a time that may be wrong waits for
  /// the next one, see TimeGuard; where both lead to a pose, the later one is returned.
  template <EventLike E>
  [[gnu::flatten]] const PoseEstimate* push(const E& foreign_event) noexcept {
    const Event event = to_event(foreign_event);
    const PoseEstimate* released = nullptr;
    if (guard_.releases(event.t)) [[unlikely]] {
        guard_.judge(event);
        released = push_in_time(Event(guard_.held()));
      }
    if (guard_.judge(event) != TimeGuard::Verdict::pass) [[unlikely]]
      return released;
    const PoseEstimate* const pose = push_in_time(event);
    return pose != nullptr ? pose : released;
  }

  /// Takes many events, with the same poses and faster: `use(pose)` is called with each, valid during the call.
  template <std::ranges::contiguous_range Events, std::invocable<const PoseEstimate&> Use>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push(const Events& all, const Use& use) noexcept(noexcept(use(std::declval<const PoseEstimate&>()))) {
    std::span<const std::ranges::range_value_t<Events>> events(all);
    const auto t = [&](std::size_t i) { return EventTraits<std::ranges::range_value_t<Events>>::t(events[i]); };
    while (!events.empty()) {
      std::size_t count = 0;  // of those that need not wait
      if (guard_.passes(t(0)))
        for (count = 1; count < events.size() && TimeGuard::near(t(count - 1), t(count));) ++count;
      if (count > 0) {
        push_in_time(events.first(count), use);
        guard_.passed(t(count - 1));
      } else if (const PoseEstimate* const pose = push(events.front())) {
        use(*pose);
      }
      events = events.subspan(std::max<std::size_t>(count, 1));
    }
  }

  /// Events that were discarded because the events before and after contradict their times.
  std::uint64_t time_faults() const noexcept { return guard_.faults(); }

  /// Takes one event whose time need not be judged: as `push` otherwise.
  template <EventLike E>
  [[gnu::always_inline]] const PoseEstimate* push_in_time(const E& foreign_event) noexcept {
    const Event event = to_event(foreign_event);
    if (pose_.quality.state == TrackingState::lost || !lines_.sensor_size().contains(event.x, event.y)) return nullptr;
    const Eigen::Vector2d m = lines_(event);
    if (capturing_) [[unlikely]]
      return capture(Event(event), m);                            // a copy: `event` itself stays in registers
    return note(event, follower_.push(m, event.t, event.p > 0));  // a NaN direction is far from everything
  }

  /// Takes many events whose times need not be judged: as `push` otherwise.
  template <std::ranges::contiguous_range Events, std::invocable<const PoseEstimate&> Use>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push_in_time(const Events& all, const Use& use) noexcept(noexcept(use(std::declval<const PoseEstimate&>()))) {
    std::span<const std::ranges::range_value_t<Events>> events(all);
    while (!events.empty() && pose_.quality.state != TrackingState::lost) {
      if (capturing_ || !follower_.in_groups()) {
        if (const PoseEstimate* const pose = push_one_in_time(events.front())) use(*pose);
        events = events.subspan(1);
        continue;
      }
      EventGroup group;
      group.fill(std::min(events.size(), EventGroup::kMost), [&](std::size_t i) {
        const Event event = to_event(events[i]);
        const bool on_sensor = lines_.sensor_size().contains(event.x, event.y);
        return std::pair(on_sensor ? lines_(event) : UndistortionTable::nowhere(), event.t);
      });
      const auto after = [&](std::size_t i, const auto& result) __attribute__((always_inline)) {
        if (const PoseEstimate* const pose = note(to_event(events[i]), result)) use(*pose);
        return state() != TrackingState::lost;
      };
      std::size_t taken = 0;
      while (taken < group.count() && follower_.in_groups() && state() != TrackingState::lost)
        taken = follower_.push(group, taken, after);
      events = events.subspan(taken);
    }
  }

  /// The events of a time are missing, dropped by a queue or a camera. A rule that knows the marker's motion bridges it
  /// as long as it knows the edges to within the matching distance, any other one for a millisecond.
  /// @return null, or the last pose if the marker is lost
  const PoseEstimate* skip(std::chrono::microseconds missing) noexcept {
    if (pose_.quality.state == TrackingState::lost || missing <= kBriefly) return nullptr;
    if constexpr (MotionEstimatingRule<Rule>) {
      const Timestamp t = t_ + missing.count();
      if (!capturing_ && knows_edges(pose_at(t))) {
        follower_.extrapolate(t);
        verification_.start_window(follower_);
        t_ = t;
        return nullptr;
      }
    }
    return &lose();
  }

  /// The present estimate: of the last update, or the start.
  PoseEstimate estimate() const noexcept {
    PoseEstimate pose = pose_;
    describe(pose);
    return pose;
  }

  /// The same, valid until the next push.
  const PoseEstimate& tell() noexcept {
    describe(pose_);
    return pose_;
  }

  /// The pose at a time at or after the last event, by the velocity of a rule that knows one. Its covariance grows
  /// with its age.
  PoseEstimate pose_at(Timestamp t) const noexcept { return extrapolated(estimate(), follower_.rule(), t); }

  /// Declares the marker lost, for a reason that only the caller knows; the last pose.
  const PoseEstimate& lose() noexcept {
    pose_.quality.state = TrackingState::lost;
    return tell();
  }

  /// How badly the edges explained the events while the tracker converged, to tell which of two starts was right: root
  /// mean square distance of those on or near the wireframe, unmatched ones at the limit [px]; infinite at first.
  double misfit_px() const noexcept { return misfit_.px(); }

  /// Events with lines of sight (X/Z, Y/Z) outside of this do nothing until the next pose.
  /// @param around the least width of what it contains around a code marker [cells]
  Eigen::AlignedBox2d reach(double around = 0) const noexcept {
    return capturing_ ? LatticeMatcher::everywhere() : follower_.matcher().reach(around);
  }

  /// Whether it tracks, and far from being lost for too few matches: at most half way.
  bool reliable() const noexcept {
    return state() == TrackingState::tracking && matched_fraction_.value() > least_reliable_fraction();
  }

  /// Whether no so many events, whatever they are, move it, lose it, or change whether it is `reliable`.
  bool stays(std::size_t events) const noexcept {
    if (events == 0 || state() == TrackingState::lost) return true;
    return !capturing_ && events < follower_.until_update() && !verification_.ends_within(events) &&
           matched_fraction_.keeps_side(settings_.min_matched_fraction, events) &&
           matched_fraction_.keeps_side(least_reliable_fraction(), events);
  }

  MarkerId id() const noexcept { return pose_.id; }
  const Eigen::Isometry3d& T_camera_marker() const noexcept { return follower_.T_camera_marker(); }
  TrackingState state() const noexcept { return pose_.quality.state; }
  const MarkerModel& model() const noexcept { return follower_.matcher().model(); }
  const EdgeFollower<Rule>& follower() const noexcept { return follower_; }

 private:
  // What an event does to the follower, and to what is known of its quality.
  [[gnu::always_inline]] const PoseEstimate* note(const Event& event,
                                                  const typename EdgeFollower<Rule>::Result& result) noexcept {
    const auto [match, updated, segment] = result;
    if (match == MatchResult::far) return nullptr;
    t_ = event.t;

    matched_fraction_.add(match == MatchResult::matched || match == MatchResult::ambiguous);
    if (match == MatchResult::matched) coverage_.add(segment);
    const auto error = verification_.push(event, updated, follower_, lines_);
    if (error) note(*error);
    if (updated) {
      matched_ += follower_.last_update().matched;
      pose_.quality.updated_t = t_;
      if (pose_.quality.state == TrackingState::converging)
        misfit_.add(follower_.last_update(), settings_.matching.max_distance_px);
    }
    if (pose_.quality.state == TrackingState::converging) {
      if (matched_ > settings_.converging_events) start_judging();
    } else if (matched_fraction_.value() < settings_.min_matched_fraction || (error && !verification_.passes(*error))) {
      return &lose();
    }
    if (!updated) return nullptr;
    if (!follower_.in_front() || out_of_image() || hidden()) return &lose();
    return &tell();
  }

  double least_reliable_fraction() const noexcept { return (1 + settings_.min_matched_fraction) / 2; }

  // In place: at a pose for every event, making and copying one would cost as much as the matching.
  void describe(PoseEstimate& pose) const noexcept {
    const Rule& rule = follower_.rule();
    pose.t = t_;
    pose.T_camera_marker = follower_.T_camera_marker();
    if constexpr (MotionEstimatingRule<Rule>) {
      pose.covariance = rule.covariance();
      pose.twist = rule.twist();
    }
    if constexpr (requires { rule.edge_offset_px(); }) pose.edge_offset_px = rule.edge_offset_px();
    pose.quality.matched = follower_.last_update().matched;
    pose.quality.offered = follower_.last_update().offered;
    pose.quality.residual_px = follower_.last_update().residual_px;
  }

  template <typename E>
  [[gnu::flatten, gnu::noinline]] const PoseEstimate* push_one_in_time(const E& event) noexcept {
    return push_in_time(event);
  }

  // The first events tell where the marker is; from there they are tracked.
  const PoseEstimate* capture(const Event& event, const Eigen::Vector2d& m) noexcept {
    if (!capture_->push(event, lines_.focal_length() * m)) return nullptr;
    capturing_ = false;
    follower_.start_from(capture_->solve());
    verification_.start_window(follower_);
    const PoseEstimate* pose = nullptr;
    for (const Event& first : capture_->events())
      if (const PoseEstimate* const next = push_one_in_time(first)) pose = next;
    return pose;
  }

  // The first updates refine the detection; what happened in them is not held against the tracker.
  void start_judging() noexcept {
    pose_.quality.state = TrackingState::tracking;
    verification_.start_window(follower_);
    matched_fraction_.restore();
    coverage_.restart();
  }

  bool hidden() noexcept {
    if (!coverage_.due()) return false;
    const auto silent_share = coverage_.silent_share(model(), T_camera_marker());
    return silent_share && *silent_share > settings_.max_silent_share && pose_.quality.state == TrackingState::tracking;
  }

  void note(const BacktrackError& error) noexcept {
    pose_.quality.backtrack_px = error.translation_px;
    pose_.quality.backtrack_rad = error.rotation_rad;
    pose_.quality.backtrack_angle_rad = error.angle_rad;
    pose_.quality.backtrack_t = t_;
  }

  // With less than half of the marker left in the image, no more events will come to tell where it went.
  bool out_of_image() const noexcept {
    const Eigen::Vector3d centre = follower_.T_camera_marker() * centre_;
    const Eigen::Vector2d low = centre.z() * lines_.low(), high = centre.z() * lines_.high();
    return centre.x() < low.x() || centre.y() < low.y() || centre.x() > high.x() || centre.y() > high.y();
  }

  // Whether every point of the model is known in the image to within the matching distance: root of the sum of both
  // variances.
  bool knows_edges(const PoseEstimate& pose) const noexcept {
    const double limit2 = settings_.matching.max_distance_px * settings_.matching.max_distance_px;
    return pose.covariance && std::ranges::all_of(model().vertices, [&](const Eigen::Vector3d& vertex) {
             return image_covariance(pose, vertex, lines_.focal_length()).trace() < limit2;
           });
  }

  Settings settings_;
  UndistortionTable lines_;
  TimeGuard guard_;
  EdgeFollower<Rule> follower_;
  Verification<Rule> verification_;
  EdgeCoverage coverage_;
  std::optional<Capture> capture_;  // kept when it is done: nothing is freed while events come
  Eigen::Vector3d centre_;          // of the model's bounding box, marker frame [m]
  PoseEstimate pose_;  // the last one that was told, but `quality.state` and what verification found are as of now
  bool capturing_ = false;
  Timestamp t_ = 0;
  std::int64_t matched_ = 0;
  Misfit misfit_;                                                        // of the converging updates
  MatchedFraction matched_fraction_{settings_.matched_fraction_events};  // of the events on or near the wireframe
};

}  // namespace evmarker
