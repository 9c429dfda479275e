#pragma once
// Many markers from what a detector finds, whenever that is told: filter, register, track, verify, drop.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/detection/look.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/events/time_guard.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/tracking/by_time.hpp"
#include "evmarker/tracking/candidates.hpp"
#include "evmarker/tracking/found_marker.hpp"
#include "evmarker/tracking/look_schedule.hpp"
#include "evmarker/tracking/marker_range.hpp"
#include "evmarker/tracking/tracked_markers.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// Everything that tracks markers but the detector: says when a look at the polarity frame is due, and is told at any
/// time after it what was found. What `Tracker` is made of, for those who run the detector elsewhere. Between looks
/// nothing throws or allocates.
///
/// The noise filter stands before the polarity frame, the looks and the history, where each noise event counts as much
/// as an edge's. Markers that are tracked take all events: of those that fall on the few pixels of their edges, far
/// more are theirs than noise, and the filter would take the first ones of a slow edge away.
///
/// An event with a time that may be wrong waits for the next one, and one with a wrong time is discarded, see
/// TimeGuard.
template <PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class TrackerCore {
 public:
  using Settings = TrackerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting that is out of range
  template <CameraModel Camera>
  TrackerCore(const Camera& camera, const Settings& settings, Filter filter)
      : settings_(settings),
        lines_(camera),
        filter_(std::move(filter)),
        frame_(camera.sensor_size()),
        history_(settings.history_events),
        looks_(settings),
        markers_(lines_, settings.max_markers),
        candidates_(settings.max_markers),
        by_time_(settings.max_markers + kBetweenChecks) {
    validate(settings);
    settings_.marker.start_search.reset();  // a detection has been fitted to the edges already
    missing_.reserve(settings.max_markers);
    poses_.reserve(settings.max_markers + kBetweenChecks);
  }

  /// Takes one event, and the one before it if that had to wait; `poses()` are then those that they led to. Calls
  /// `after(event)` after each that has passed the noise filter.
  template <std::invocable<const Event&> After>
  void push(const Event& event, const After& after) {
    poses_.clear();
    TimeGuard::Verdict verdict;
    do {
      check();
      verdict = judge(event);
      if (verdict == TimeGuard::Verdict::release) take_one(guard_.held(), after);
    } while (verdict == TimeGuard::Verdict::release);
    ++statistics_.events;
    if (verdict == TimeGuard::Verdict::pass) take_one(event, after);
  }

  /// Takes the first of some events, but none after one about which `stop(event)` is true: asked of each that has
  /// passed the noise filter. Calls `use(pose)` with each pose, in order of time: the same as one by one, and faster.
  /// None are left in `poses()`.
  /// @return how many were taken: none if it was time for one that had waited
  template <std::predicate<const Event&> Stop, std::invocable<const PoseEstimate&> Use>
  std::size_t push(std::span<const Event> events, const Stop& stop, const Use& use) {
    if (events.empty()) return 0;
    poses_.clear();
    if (!candidates_.empty() || guard_.releases(events.front().t)) return push_first(events.front(), stop, use);
    events = events.first(
        std::min({events.size(), kTogether * std::max<std::size_t>(markers_.size(), 1), std::size_t{kBetweenChecks}}));
    std::size_t taken = 0;
    for (bool stopped = false; taken < events.size() && !stopped; ++taken) {
      const Event& event = events[taken];
      if (events.size() - taken > kAhead) prefetch(events[taken + kAhead]);
      if (statistics_.events % kBetweenChecks == 0) [[unlikely]]
        check_meanwhile();
      if (!guard_.passes(event.t) && guard_.releases(event.t)) [[unlikely]]
        break;
      ++statistics_.events;
      if (judge(event) != TimeGuard::Verdict::pass) [[unlikely]]
        continue;
      const Entry entry = enter(event);
      if (entry == Entry::off_sensor) continue;
      markers_.push_soon(event, delivering());
      if (entry == Entry::supported) stopped = stop(event);
    }
    markers_.push_waiting(delivering());
    if (!poses_.empty()) drop_lost();
    by_time_.hand_over(poses_, use);
    return taken;
  }

  /// Time of the event that is taken next if this one comes, which may be one that has waited; null if this one has to
  /// wait [us].
  std::optional<Timestamp> next_t(const Event& event) const noexcept { return guard_.next_t(event.t); }

  /// Whether a marker that was found has not seen all events yet that came since the look.
  bool behind() const noexcept { return !candidates_.caught_up(history_); }

  /// Has such markers take so many of these events, for the time in which no others come. Adds to `poses()`.
  void catch_up(int events) {
    candidates_.catch_up(history_, events, statistics_);
    announce_confirmed();
  }

  /// Goes on at a later time, the events until then missing: `poses()` are those of the markers that this loses. What
  /// is found in a look before it is not followed.
  void skip_to(Timestamp t) {
    poses_.clear();
    if (!(t > last_t_)) return;
    const auto missing = std::chrono::microseconds(std::min<std::uint64_t>(elapsed_us(last_t_, t), kForEver));
    if (missing <= MarkerTracker<Rule>::kBriefly) return;
    guard_.restart(t);
    statistics_.time_faults = guard_.faults();
    followable_since_ = history_.pushed();
    candidates_.skip(missing, history_);
    markers_.skip(missing, delivering());
    drop_lost();
    searching_ = searching();
  }

  /// The poses since the last event was pushed, valid until the next one is.
  std::span<const PoseEstimate> poses() const noexcept { return poses_; }
  void clear_poses() noexcept { poses_.clear(); }

  /// Whether the frame should be looked at after this event that was taken. Not while an answer is awaited.
  bool look_due(Timestamp t) const noexcept { return looks_.due(t, searching_); }

  /// Whether a marker is looked for that should be there: none is tracked, or not confirmed, or one was just lost.
  bool searching() const noexcept { return markers_.empty() || !candidates_.empty() || !missing_.empty(); }

  /// What to ask the detector about the frame as it is now. From here on the answer is awaited.
  Look look(Timestamp t) {
    ++statistics_.detections;
    looks_.begin(t);
    forget_missing(t);
    Look look{t, history_.pushed(), lines_.focal_length(), {}, {}};
    candidates_.ask(look, history_);
    for (const FoundMarker<Rule>& marker : missing_)
      look.missing.push_back({marker.id(), marker.tracker().pose_at(t).T_camera_marker});
    return look;
  }

  /// Whether the answer is due, `detection_latency` after the look.
  bool answer_due(Timestamp t) const noexcept { return looks_.answer_due(t); }
  bool answer_awaited() const noexcept { return looks_.answer_awaited(); }
  /// No answer will come to the look.
  void give_up_look() noexcept { looks_.end(); }

  /// The answer to the look: announces the markers that were seen often enough, starts a tracker for every marker that
  /// is not tracked yet, with the events since the look. Adds to `poses()`.
  void take(const Findings& findings) {
    looks_.end();
    std::erase_if(missing_, [&](const FoundMarker<Rule>& marker) {
      return std::ranges::any_of(std::span(findings.found).first(findings.detected),
                                 [&](const auto& found) { return found.detection.id == marker.id(); });
    });
    candidates_.answer(findings);
    announce_confirmed();
    candidates_.remove_hopeless();
    for (const Findings::Found& found : findings.found) {
      if (findings.position <= followable_since_ || tracked(found.detection)) continue;
      if (markers_.size() + candidates_.size() == settings_.max_markers) break;
      candidates_.add(
          {FoundMarker<Rule>(lines_, found.model, found.detection, settings_.marker), findings.position, history_});
    }
    announce_confirmed();
    drop_lost();
    searching_ = searching();
  }

  const TrackerStatistics& statistics() const noexcept { return statistics_; }
  const PolarityFrame& polarity_frame() const noexcept { return frame_; }
  /// Time of the last event pushed [us].
  Timestamp last_t() const noexcept { return last_t_; }
  /// The `MarkerTracker` of every marker that is being tracked.
  MarkerRange<Rule> markers() const noexcept { return MarkerRange<Rule>(markers_.all()); }

 private:
  static constexpr std::uint64_t kForEver = 1000000000;  // [us]
  static constexpr std::size_t kTogether = 64;           // events: so many for each marker make good groups
  static constexpr std::size_t kBetweenChecks = 1024;    // events
  static constexpr std::size_t kAhead = 32;              // events: longer than memory takes, shorter than a cache holds
  static constexpr int kEventsForOne = 2;  // that candidates take for each that comes: a look's lag is soon gone

  enum class Entry { off_sensor, unsupported, supported };

  // Whether markers are looked for is seen anew after the same events, however many of them come together.
  void check() noexcept {
    if (statistics_.events % kBetweenChecks == 0) searching_ = searching();
  }

  // The same while events wait, once those have been taken by which a marker may be lost.
  [[gnu::noinline]] void check_meanwhile() {
    markers_.push_decisive(delivering());
    if (markers_.any_lost()) {
      markers_.push_waiting(delivering());
      drop_lost();
    }
    searching_ = searching();
  }

  // Has what an event will look up brought into the cache: with many markers, that is all over the image.
  [[gnu::always_inline]] void prefetch(const Event& event) const noexcept {
    if (!lines_.sensor_size().contains(event.x, event.y)) return;
    if constexpr (requires { filter_.prefetch(event); }) filter_.prefetch(event);
    lines_.prefetch(event);
  }

  // One event of a range, as it would be by itself; none if one that had waited was taken instead.
  template <typename Stop, typename Use>
  [[gnu::noinline]] std::size_t push_first(const Event& event, const Stop& stop, const Use& use) {
    check();
    const TimeGuard::Verdict verdict = judge(event);
    const bool released = verdict == TimeGuard::Verdict::release;
    if (verdict != TimeGuard::Verdict::hold) take_one(released ? guard_.held() : event, stop);
    statistics_.events += !released;
    by_time_.hand_over(poses_, use);
    return released ? 0 : 1;
  }

  // See TimeGuard::judge.
  TimeGuard::Verdict judge(const Event& event) noexcept {
    const bool usual = guard_.passes(event.t);
    const TimeGuard::Verdict verdict = guard_.judge(event);
    if (!usual) [[unlikely]]
      statistics_.time_faults = guard_.faults();
    return verdict;
  }

  // An event whose time is right.
  template <typename After>
  void take_one(const Event& event, const After& after) {
    const Entry entry = enter(event);
    if (entry == Entry::off_sensor) return;
    markers_.push(event, delivering());
    if (!poses_.empty()) drop_lost();
    if (!candidates_.empty()) [[unlikely]]
      catch_up(kEventsForOne);
    if (entry == Entry::supported) after(event);
  }

  // Counts, filters and remembers the event.
  [[gnu::always_inline]] Entry enter(const Event& event) {
    statistics_.time_steps_back += event.t < last_t_;
    last_t_ = event.t;
    if (!lines_.sensor_size().contains(event.x, event.y)) {
      ++statistics_.off_sensor;
      return Entry::off_sensor;
    }
    if (!filter_.accept(event)) {
      ++statistics_.filtered;
      return Entry::unsupported;
    }
    looks_.count_event();
    frame_.update(event);
    history_.push(event);
    return Entry::supported;
  }

  void deliver(const PoseEstimate& pose) {
    poses_.push_back(pose);
    if (pose.quality.state == TrackingState::lost)
      ++statistics_.lost;
    else
      statistics_.matched += static_cast<std::uint64_t>(pose.quality.matched);
  }

  auto delivering() noexcept {
    return [this](const PoseEstimate& pose) { deliver(pose); };
  }

  // A lost marker's id goes back to the detector.
  void drop_lost() {
    markers_.remove_lost([&](FoundMarker<Rule>& marker) {
      if (missing_.size() < settings_.max_markers) missing_.push_back(std::move(marker));
    });
  }

  // A marker that was just lost is looked for where its motion must have taken it.
  void forget_missing(Timestamp t) {
    constexpr std::uint64_t kPredictable = 100000;  // [us]
    std::erase_if(missing_,
                  [&](const auto& marker) { return elapsed_us(marker.tracker().estimate().t, t) > kPredictable; });
  }

  // Announces the candidates that were seen often enough and have seen all events.
  void announce_confirmed() {
    candidates_.take_confirmed(settings_.detections_to_confirm, history_, [&](FoundMarker<Rule>& marker) {
      if (marker.tracker().estimate().quality.matched > 0) deliver(marker.tracker().estimate());
      ++statistics_.registered;
      looks_.note_found(last_t_);
      markers_.add(std::move(marker));
    });
  }

  // Whether the id is being tracked where it was found. A marker that was silent while it is seen elsewhere is lost:
  // nothing moved where its tracker waits. One that was never confirmed has followed something else.
  bool tracked(const MarkerDetection& detection) {
    if (const FoundMarker<Rule>* const candidate = candidates_.find(detection.id)) {
      if (same_place(detection, candidate->tracker().T_camera_marker(), lines_.focal_length())) return true;
      candidates_.erase(detection.id);
      return false;
    }
    FoundMarker<Rule>* const marker = markers_.find(detection.id);
    if (marker == nullptr) return false;
    const bool silent = marker->silent_until(detection.t, settings_.detection_interval);
    if (!silent || same_place(detection, marker->tracker().T_camera_marker(), lines_.focal_length())) return true;
    deliver(marker->tracker().lose(LossReason::replaced));
    markers_.erase(detection.id);
    return false;
  }

  Settings settings_;
  UndistortionTable lines_;
  TimeGuard guard_;
  Filter filter_;
  PolarityFrame frame_;
  EventHistory history_;
  LookSchedule looks_;
  TrackedMarkers<Rule> markers_;  // announced
  Candidates<Rule> candidates_;
  std::vector<FoundMarker<Rule>> missing_;  // lost a short time ago
  std::vector<PoseEstimate> poses_;
  ByTime by_time_;
  bool searching_ = true;  // as of the last check
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  std::uint64_t followable_since_ = 0;  // position in the history after which no events are missing
  TrackerStatistics statistics_;
};

}  // namespace evmarker
