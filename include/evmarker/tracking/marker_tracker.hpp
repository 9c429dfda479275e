#pragma once
// One marker, from a known pose on: follow it, verify it, say when it is lost.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <ranges>
#include <span>
#include <tuple>
#include <utility>

#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/time_guard.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/search/start_pose_search.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/tracking/marker_tracker_settings.hpp"
#include "evmarker/tracking/pose_report.hpp"
#include "evmarker/tracking/tilt_check.hpp"
#include "evmarker/tracking/track_health.hpp"
#include "evmarker/tracking/track_progress.hpp"
#include "evmarker/tracking/verification.hpp"
#include "evmarker/tracking/visibility.hpp"
#include "evmarker/update/kalman_update.hpp"

namespace evmarker {

/// Tracks one marker event by event. Once constructed it neither allocates nor throws, unless what the caller passes to
/// `push` does. Copying allocates.
template <PoseUpdateRule Rule = KalmanUpdate>
class MarkerTracker {
 public:
  using Settings = MarkerTrackerSettings<Rule>;
  /// Shorter gaps are ignored: in this time, an edge at 2000 px/s moves by no more than the matching distance.
  static constexpr std::chrono::milliseconds kHarmlessGap{1};

  /// @param camera anything that an UndistortionTable can be made of, or a table to share
  /// @param T_camera_marker first pose [m]
  /// @param t its time, which is that of the estimate until an event comes [us]
  /// @throws std::invalid_argument naming the setting, the model's fault, or a pose that is no rigid motion or behind
  /// the camera
  template <typename Camera>
  MarkerTracker(const Camera& camera, MarkerModel model, const Eigen::Isometry3d& T_camera_marker,
                const Settings& settings = {}, MarkerId id = 0, Timestamp t = 0)
      : settings_(settings),
        lines_of_sight_(camera),
        follower_(std::move(model), lines_of_sight_.focal_length(), T_camera_marker, follower_settings(settings)),
        verification_(follower_, settings.verification),
        health_(follower_.matcher().model(), lines_of_sight_.focal_length(), settings.health,
                lines_of_sight_.inner_image()),
        visibility_(follower_.matcher().model()),
        tilt_(follower_),
        progress_(settings.converging_events),
        t_(t) {
    validate(settings);
    pose_.id = id;
    pose_.quality.updated_t = t;
    if (settings.start_search) {
      const Box image{lines_of_sight_.focal_length() * lines_of_sight_.image().low,
                      lines_of_sight_.focal_length() * lines_of_sight_.image().high};
      start_search_.emplace(this->model(), lines_of_sight_.focal_length(), image, T_camera_marker,
                            *settings.start_search);
      start_pending_ = true;
    }
  }

  /// Takes one event. Returns a pose after every `events_per_update` matched ones, valid until the next push, and null
  /// otherwise. The last pose of all has state `lost`. An event whose time is suspect waits for the next one, see
  /// TimeGuard; if both lead to a pose, the later one is returned.
  template <EventLike E>
  const PoseEstimate* push(const E& event) noexcept {
    const Event own = to_event(event);
    if (!guard_.passes(own.t)) [[unlikely]]
      return push_suspect(own);
    guard_.passed(own.t);
    return progress_.lost() ? nullptr : push_one(own);
  }

  /// Takes events and calls `use(pose)` with each pose, valid during the call. The poses are the same as with single
  /// events, but take less time. After a start search past events are replayed, several with each new one: of the
  /// poses that one new event leads to, only the last is used.
  template <std::ranges::input_range Events, typename Use>
  requires EventLike<std::ranges::range_value_t<Events>> && std::invocable<const Use&, const PoseEstimate&>
  void push(Events&& events, const Use& use) noexcept(
      std::ranges::contiguous_range<Events>&& noexcept(use(std::declval<const PoseEstimate&>()))) {
    for_each_block(events, [&](std::span<const Event> block) {
      while (!block.empty())
        push_checked(guard_.next(block), [&](const PoseEstimate& pose, const Event&) { use(pose); });
    });
  }

  /// As `push`, for events that the caller's own TimeGuard has passed. Calls `use(pose, event)`, the event of the span
  /// that led to the pose.
  template <std::invocable<const PoseEstimate&, const Event&> Use>
  void push_checked(std::span<const Event> events,
                    const Use& use) noexcept(noexcept(use(std::declval<const PoseEstimate&>(), Event()))) {
    while (!events.empty() && !progress_.lost()) {
      if (events.size() > 1 && !start_pending_ && accepts_groups()) {
        events = events.subspan(push_group(events, use));
      } else {
        if (const PoseEstimate* const pose = push_one(events.front())) use(*pose, events.front());
        events = events.subspan(1);
      }
    }
  }

  /// The same for one event; returns as `push` does.
  [[gnu::noinline]] const PoseEstimate* push_checked(const Event& event) noexcept {
    return progress_.lost() ? nullptr : push_one(event);
  }

  /// Events that were discarded because the events before and after contradict their times.
  std::uint64_t time_faults() const noexcept { return guard_.faults(); }

  /// Goes on after a gap in which a queue or a camera dropped events. Gaps up to kHarmlessGap are ignored, and so are
  /// those before the first event on or near the marker, as nothing has been followed yet. Longer ones are bridged if
  /// the rule estimates the motion and still predicts all vertices to within the matching distance; else the marker is
  /// lost. A start search begins again; a gap while the events since a found start are replayed loses the marker.
  /// @param missing length of the gap itself. The motion goes on for this time alone from the last event on or near the
  /// marker: between that event and the gap the marker was at rest, as it made no events
  /// @return null, or the last pose if the marker is lost
  const PoseEstimate* skip(std::chrono::microseconds missing) noexcept {
    if (progress_.lost() || missing <= kHarmlessGap) return nullptr;
    if (searching()) {
      start_search_->forget();
      return nullptr;
    }
    if (!had_near_event_ && !start_pending_) return nullptr;
    tilt_.stop(follower_);
    follower_.set_no_other_pose();
    if constexpr (MotionEstimatingRule<Rule>) {
      const Timestamp t = later(t_, missing);
      if (!start_pending_ && vertices_known_to_matching_distance(pose_at(t))) {
        follower_.extrapolate(t, t_);
        verification_.restart(follower_);
        t_ = t;
        return nullptr;
      }
    }
    return &lose(LossReason::events_missing);
  }

  /// The pose of the last update, at `quality.updated_t`, or the start. Its `t` is the time of the last event on or
  /// near the marker, to which it is not moved on: see pose_at for that.
  PoseEstimate estimate() const noexcept {
    PoseEstimate pose = pose_;
    return fill(pose);
  }
  /// The same without a copy, valid until the next push.
  const PoseEstimate& refresh_pose() noexcept { return fill(pose_); }

  /// The pose at a time at or after the last event, predicted by a rule that estimates the velocity. Its covariance
  /// grows with its age.
  /// @param pushed_until the caller has pushed all events before this time: that none came until then is a measurement,
  /// too, as a moving marker would have made some, and the covariance hardly grows
  PoseEstimate pose_at(Timestamp t, Timestamp pushed_until = kPushedUntilUnknown) const noexcept {
    return extrapolated(estimate(), follower_.rule(), t, pushed_until);
  }

  /// Declares the marker lost, for a reason that only the caller knows. Returns the last pose.
  [[gnu::noinline]] const PoseEstimate& lose(LossReason reason) noexcept {
    progress_.lose();
    pose_.quality.loss_reason = reason;
    return refresh_pose();
  }

  /// While ambiguous, a `converging` marker does not become `tracking`: the caller has another pose that may be the
  /// right one.
  void set_ambiguous(bool ambiguous) noexcept {
    ambiguous_ = ambiguous;
    if (!ambiguous) follower_.set_no_other_pose();
  }
  /// See EdgeFollower::set_other_pose; holds until the next update.
  void set_other_pose(const Eigen::Isometry3d& T_camera_marker, double probability) noexcept {
    follower_.set_other_pose(T_camera_marker, probability);
  }
  /// See TiltCheck::doubt.
  void doubt_tilt(bool both_alike) noexcept { tilt_.doubt(follower_, both_alike); }
  /// See EdgeFollower::follows_motion.
  bool follows_motion() const noexcept { return follower_.follows_motion(); }
  /// See EdgeFollower::residual; no edge and 0 px for an event off the sensor, which speaks for no pose.
  EdgeResidual residual(const Event& event) const noexcept {
    return lines_of_sight_.sensor_size().contains(event.x, event.y)
               ? follower_.residual(lines_of_sight_(event), polarity(event))
               : EdgeResidual();
  }

  /// Events with lines of sight (X/Z, Y/Z) outside of this box have no effect. It holds until the next pose.
  /// @param border_cells the box contains at least this wide a border around a code marker [cells]
  Box reach(double border_cells = 0) const noexcept {
    return start_pending_ ? Box::everywhere() : tilt_.reach(follower_.matcher().reach(border_cells), border_cells);
  }

  /// True while it tracks and no evidence speaks against that.
  bool reliable() const noexcept { return state() == TrackingState::tracking && health_.sure(); }

  /// True only if the next `events` events, whichever they are, cannot change the pose, the state or `reliable()`. May
  /// be false although nothing would change.
  bool unchanged_by_next(std::size_t events) const noexcept {
    if (events == 0 || progress_.lost()) return true;
    return !start_pending_ && !tilt_.comparing() && events < follower_.until_update() &&
           !verification_.ends_within(events) && health_.not_due_within(events);
  }

  /// True while the marker is searched around its start pose: the state is `converging`, there is no pose yet.
  bool searching() const noexcept { return start_pending_ && start_search_->searching(); }
  /// The search around the start pose, also when it is over; null without one.
  const StartPoseSearch* start_search() const noexcept { return start_search_ ? &*start_search_ : nullptr; }

  MarkerId id() const noexcept { return pose_.id; }
  /// Where the events show the marker: late by the rule's delay, which `estimate` makes up for.
  const Eigen::Isometry3d& T_camera_marker() const noexcept { return follower_.T_camera_marker(); }
  /// As in the poses: `tracking` becomes `converging` while more evidence speaks against the pose than for it, while
  /// events come so late that they lie anywhere near the edges, or while a flat marker may as well be tilted to the
  /// other side.
  TrackingState state() const noexcept {
    return progress_.tracking() && (health_.doubtful() || events_fill_distance() || tilt_.doubtful())
               ? TrackingState::converging
               : progress_.state();
  }
  const MarkerModel& model() const noexcept { return follower_.matcher().model(); }
  const EdgeFollower<Rule>& follower() const noexcept { return follower_; }

 private:
  // Not inlined: it is rare.
  [[gnu::noinline]] const PoseEstimate* push_suspect(const Event& event) noexcept {
    const PoseEstimate* last = nullptr;
    for (std::span<const Event> waiting(&event, 1); !waiting.empty();)
      for (const Event& checked : guard_.next(waiting))
        if (const PoseEstimate* const pose = push_checked(checked)) last = pose;
    return last;
  }

  [[gnu::always_inline]] const PoseEstimate* push_one(const Event& event) noexcept {
    if (!lines_of_sight_.sensor_size().contains(event.x, event.y)) return nullptr;
    const Vec2 m = lines_of_sight_(event);
    return start_pending_ ? start(event, m) : follow(event, m);
  }

  [[gnu::always_inline]] const PoseEstimate* follow(const Event& event, Vec2 m) noexcept {
    if (tilt_.comparing()) [[unlikely]]
      tilt_.push(follower_, m, event.t, polarity(event));
    return after_event(event, follower_.push(m, event.t, polarity(event)));
  }

  bool accepts_groups() const noexcept { return follower_.accepts_groups() && !tilt_.comparing(); }

  // Several events by loops that become vector instructions. Returns how many were taken.
  template <typename Use>
  [[gnu::noinline]] std::size_t push_group(std::span<const Event> events, const Use& use) {
    EventGroup group;
    group.fill(std::min(events.size(), EventGroup::kMost), [&](std::size_t i) {
      const bool on_sensor = lines_of_sight_.sensor_size().contains(events[i].x, events[i].y);
      return std::tuple(on_sensor ? lines_of_sight_(events[i]) : UndistortionTable::nowhere(), events[i].t,
                        polarity(events[i]));
    });
    const auto after = [&](std::size_t i, const auto& result) __attribute__((always_inline)) {
      if (const PoseEstimate* const pose = after_event(events[i], result)) use(*pose, events[i]);
      return !progress_.lost() && !tilt_.comparing();
    };
    std::size_t taken = 0;
    while (taken < group.count() && accepts_groups() && !progress_.lost()) taken = follower_.push(group, taken, after);
    return taken;
  }

  // Everything that follows from an event: evidence, verification, state. Returns the pose to report, of an update or a
  // loss; else null.
  [[gnu::always_inline]] const PoseEstimate* after_event(const Event& event,
                                                         const typename EdgeFollower<Rule>::Result& result) noexcept {
    const auto [match, updated, segment] = result;
    if (match == MatchResult::far) return nullptr;
    t_ = event.t;
    had_near_event_ = true;
    health_.add(match, segment, event.p > 0);
    if (const BacktrackError* const error = verification_.push(event, updated, follower_, lines_of_sight_)) [[unlikely]]
      apply_verification(*error);
    if (updated) after_update();
    // Judged at updates and at events beside an edge that are not matched, so that one that is merely collected stays
    // cheap.
    if (progress_.settled() && health_.due() && (updated || match == MatchResult::near)) health_.judge_matches(t_);
    const LossReason certain = progress_.certain_loss();  // that no evidence for the marker outweighs
    if (health_.lost() || certain != LossReason::none) [[unlikely]]
      return &lose(certain != LossReason::none ? certain : health_.reason());
    if (!updated) return nullptr;
    const Eigen::Isometry3d& T = follower_.T_camera_marker();
    if (!follower_.in_front() || visibility_.out_of_image(T, lines_of_sight_.image()))
      return &lose(LossReason::left_image);
    if (visibility_.turned_away(T)) return &lose(LossReason::turned_away);
    if (health_.edges_due()) judge_edges();
    return &refresh_pose();
  }

  // Counts an update, and lets the state converge.
  void after_update() noexcept {
    progress_.add_update(follower_.last_update().matched, t_);
    if (ambiguous_) follower_.set_no_other_pose();
    pose_.quality.updated_t = t_;
    if (!ambiguous_ && tilt_.judge(follower_)) {
      verification_.restart(follower_);
      health_.restart_edges();
      // The marker is tilted to the other side, and its follower is now a copy that has followed it there since the
      // comparison began, maybe before the marker was confirmed.
      if (progress_.tracking()) follower_.enable_rest_detection();
    }
    if (progress_.converging()) converge();
  }

  // Once the start has settled, a brief verification over the events that follow decides whether the marker is
  // `tracking`.
  [[gnu::noinline]] void converge() noexcept {
    if (!progress_.settled() && settles()) {
      progress_.settle();
      health_.restart(t_);
      verification_.restart(follower_, VerificationWindow::brief);
    }
    if (!ambiguous_ && health_.sure() && progress_.confirm()) follower_.enable_rest_detection();
  }

  // True once the start has been refined: by enough matched events, or at once after a start search, which has fitted
  // it to events. If the rule has a covariance, all vertices must also be known to within the matching distance, unless
  // there were four times as many events.
  bool settles() const noexcept {
    const int needed = follower_.events_to_fix_pose();
    const bool refined = progress_.matched() >= needed || start_search_;
    if constexpr (MotionEstimatingRule<Rule>)
      return refined && (progress_.matched() >= 4 * needed || vertices_known_to_matching_distance(estimate()));
    else
      return refined;
  }

  // Judges each edge by the events that it made, and learns how many a pixel makes in a passage. Not before the start
  // has settled: until then corrections move the pose, and edges would seem to have passed pixels that they never
  // passed.
  [[gnu::noinline]] void judge_edges() noexcept {
    if (!progress_.settled()) return health_.restart_edges();
    health_.judge_edges(model(), T_camera_marker(), t_, follower_.middle_events());
    if (progress_.tracking() && health_.events_per_passage() > 0) {
      follower_.set_events_per_passage(health_.events_per_passage());
      follower_.set_contrasts(health_.contrasts());
    }
  }

  // Sets everything but the id, the time of the last update, the reason of a loss and the results of verification.
  PoseEstimate& fill(PoseEstimate& pose) const noexcept {
    pose.t = t_;
    report(follower_, pose);
    pose.quality.state = state();
    pose.quality.health = health_.probability();
    return pose;
  }

  // Feeds the search. The pose that it finds is that of an earlier time: the events since then are replayed, a few with
  // each new one, until none is left.
  [[gnu::noinline]] const PoseEstimate* start(const Event& event, Vec2 m) noexcept {
    constexpr int kReplayed = 8;
    if (searching()) {
      if (!start_search_->push(event, lines_of_sight_.focal_length() * m)) return nullptr;
      if (start_search_->state() == StartPoseSearch::State::given_up) return &lose(LossReason::not_confirmed);
      follower_.start_from(start_search_->T_found());
      verification_.restart(follower_);
      return nullptr;
    }
    start_search_->keep(event);
    const PoseEstimate* pose = nullptr;
    for (int i = 0; i < kReplayed && start_pending_ && !progress_.lost(); ++i) {
      const Event past = start_search_->replay();
      if (const auto* next = follow(past, lines_of_sight_(past))) pose = next;
      start_pending_ = start_search_->replaying();
    }
    return pose;
  }

  bool events_fill_distance() const noexcept {
    if constexpr (SensorEstimatingRule<Rule>)
      return follower_.rule().events_fill_distance();
    else
      return false;
  }

  [[gnu::noinline]] void apply_verification(const BacktrackError& error) noexcept {
    pose_.quality.backtrack_px = error.translation_px;
    pose_.quality.backtrack_rad = error.rotation_rad;
    pose_.quality.backtrack_angle_rad = error.angle_rad;
    pose_.quality.backtrack_t = t_;
    const bool passed = verification_.passes(error);
    if (progress_.settled()) health_.judge_verification(passed);
    if (progress_.add_verification(passed)) verification_.restart(follower_);  // at once after a failure: two lose it
  }

  // True if every vertex's place in the image has a standard deviation, x and y together, below the matching distance.
  bool vertices_known_to_matching_distance(const PoseEstimate& pose) const noexcept {
    const double limit2 = settings_.matching.max_distance_px * settings_.matching.max_distance_px;
    return pose.covariance && std::ranges::all_of(model().vertices, [&](const Eigen::Vector3d& vertex) {
             return image_variance(pose, vertex, lines_of_sight_.focal_length()) < limit2;
           });
  }

  Settings settings_;
  UndistortionTable lines_of_sight_;
  TimeGuard guard_;
  EdgeFollower<Rule> follower_;
  Verification<Rule> verification_;
  TrackHealth health_;
  std::optional<StartPoseSearch> start_search_;  // kept when it is done: nothing is freed while events come
  Visibility visibility_;
  TiltCheck<Rule> tilt_;
  TrackProgress progress_;
  PoseEstimate pose_;            // the last one reported, with the present results of verification
  bool start_pending_ = false;   // the start search has not found a pose, or not replayed all events since that pose
  Timestamp t_;                  // of the last event on or near the marker, or of its start
  bool had_near_event_ = false;  // there has been an event on or near the marker
  bool ambiguous_ = false;       // another pose may be the right one
};

}  // namespace evmarker
