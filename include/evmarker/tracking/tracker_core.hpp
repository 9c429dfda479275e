#pragma once
// Tracks many markers, given what a detector finds: filter, register, track, verify, drop.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/events/time_guard.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/tracking/by_time.hpp"
#include "evmarker/tracking/confirmed_markers.hpp"
#include "evmarker/tracking/detection_schedule.hpp"
#include "evmarker/tracking/marker_range.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/tentative_markers.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// A `Tracker` without its detector, for those who run the detector elsewhere: it says when a detection is due, and
/// takes the result whenever that is there. Between detections nothing throws or allocates.
///
/// The noise filter stands before the polarity frame, the detections and the history, where each noise event counts as
/// much as an edge's. Markers that are tracked take all events: of those on the few pixels of their edges far more are
/// theirs than noise, and the filter would remove the first ones of a slow edge.
///
/// An event whose time is suspect waits for the next one, and is discarded if its time was wrong, see TimeGuard.
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
        schedule_(settings),
        confirmed_(lines_, settings.max_markers),
        tentative_(settings.max_markers),
        by_time_(settings.max_markers + kBetweenChecks) {
    validate(settings);
    settings_.marker.start_search.reset();  // a detection has been fitted to the edges already
    missing_.reserve(settings.max_markers);
    poses_.reserve(settings.max_markers + kBetweenChecks);
  }

  /// Takes events from the first on, up to and with one for which `stop(event)` is true; it is called with each event
  /// that has passed the noise filter. Calls `use(pose)` with each pose that they lead to, in order of time, valid
  /// during the call.
  /// @return how many events were taken; none if one that had waited was taken instead
  template <std::predicate<const Event&> Stop, std::invocable<const PoseEstimate&> Use>
  std::size_t push(std::span<const Event> events, const Stop& stop, const Use& use) {
    if (events.empty()) return 0;
    const bool single = events.size() == 1 || !tentative_.empty() || guard_.releases(events.front().t);
    const std::size_t taken = single ? push_one(events.front(), stop) : push_many(events, stop);
    hand_over(use);
    return taken;
  }

  /// Time of the event that is taken next if this one is pushed, which may be one that has waited; nothing if this one
  /// has to wait [us].
  std::optional<Timestamp> next_t(const Event& event) const noexcept { return guard_.next_t(event.t); }

  /// True while a marker that was detected has not been given all events since.
  bool behind() const noexcept { return !tentative_.caught_up(history_); }

  /// Gives such markers at most `events` events each: for a time in which no new ones come.
  template <std::invocable<const PoseEstimate&> Use>
  void catch_up(int events, const Use& use) {
    catch_up(events);
    hand_over(use);
  }

  /// Goes on at a later time; the events until then are missing. The result of a detection from before registers
  /// nothing.
  template <std::invocable<const PoseEstimate&> Use>
  void skip_to(Timestamp t, const Use& use) {
    if (!(t > last_t_)) return;
    const auto missing = std::chrono::microseconds(std::min<std::uint64_t>(elapsed_us(last_t_, t), kForEver));
    if (missing <= MarkerTracker<Rule>::kBriefly) return;
    guard_.restart(t);
    statistics_.time_faults = guard_.faults();
    followable_since_ = history_.pushed();
    tentative_.skip(missing, history_);
    confirmed_.skip(missing, delivering());
    drop_lost();
    searching_ = searching();
    hand_over(use);
  }

  /// True if the frame as it is after this event, which was taken, should go to the detector. False while a result is
  /// pending.
  bool detection_due(Timestamp t) const noexcept { return schedule_.due(t, searching_); }

  /// True while a marker that should be there is missing: none is tracked, one is not confirmed, or was lost just now.
  bool searching() const noexcept { return confirmed_.empty() || !tentative_.empty() || !missing_.empty(); }

  /// What the detector should say about the frame as it is now. From here on its result is pending.
  DetectionRequest request_detection(Timestamp t) {
    ++statistics_.detections;
    schedule_.begin(t);
    forget_missing(t);
    DetectionRequest request{t, history_.pushed(), lines_.focal_length(), {}, {}};
    tentative_.request_sightings(request, history_);
    for (const PlanarHypotheses<Rule>& marker : missing_)
      request.missing.push_back({marker.id(), marker.tracker().pose_at(t).T_camera_marker});
    return request;
  }

  /// True once `detection_latency` has passed since the request.
  bool result_due(Timestamp t) const noexcept { return schedule_.result_due(t); }
  bool result_pending() const noexcept { return schedule_.running(); }
  /// There will be no result.
  void cancel_detection() noexcept { schedule_.end(); }

  /// Takes the result of the pending detection: announces the markers that were seen often enough, and starts a tracker
  /// for each marker that is not tracked yet, with the events since the request.
  template <std::invocable<const PoseEstimate&> Use>
  void register_markers(const DetectionResult& result, const Use& use) {
    schedule_.end();
    std::erase_if(missing_, [&](const PlanarHypotheses<Rule>& marker) {
      return std::ranges::any_of(result.detected_markers(),
                                 [&](const auto& detected) { return detected.detection.id == marker.id(); });
    });
    tentative_.add(result.sightings);
    announce_confirmed();
    tentative_.remove_hopeless();
    for (const auto& [detection, model] : result.markers) {
      if (result.position <= followable_since_ || tracked(detection)) continue;
      if (confirmed_.size() + tentative_.size() == settings_.max_markers) break;
      tentative_.add({PlanarHypotheses<Rule>(lines_, model, detection, settings_.marker), result.position, history_});
    }
    announce_confirmed();
    drop_lost();
    searching_ = searching();
    hand_over(use);
  }

  const TrackerStatistics& statistics() const noexcept { return statistics_; }
  const PolarityFrame& polarity_frame() const noexcept { return frame_; }
  /// Time of the last event pushed [us].
  Timestamp last_t() const noexcept { return last_t_; }
  /// The `MarkerTracker` of every marker that is being tracked.
  MarkerRange<Rule> markers() const noexcept { return MarkerRange<Rule>(confirmed_.all()); }

 private:
  static constexpr std::uint64_t kForEver = 1000000000;  // [us]
  static constexpr std::size_t kTogether = 64;           // events for each marker: enough for good groups
  static constexpr std::size_t kBetweenChecks = 1024;    // events
  static constexpr std::size_t kAhead = 32;              // events: longer than memory takes, shorter than a cache holds
  static constexpr int kCatchUp = 2;  // events that a tentative marker replays for each new one: it is soon up to date

  enum class Entry { off_sensor, unsupported, supported };

  // Returns 0 if an event that had waited was taken instead.
  template <typename Stop>
  [[gnu::noinline]] std::size_t push_one(const Event& event, const Stop& stop) {
    if (check_due()) searching_ = searching();
    const TimeGuard::Verdict verdict = judge(event);
    const bool released = verdict == TimeGuard::Verdict::release;
    statistics_.events += !released;
    if (verdict == TimeGuard::Verdict::hold) return 1;
    const Event& now = released ? guard_.held() : event;
    const Entry entry = enter(now);
    if (entry == Entry::off_sensor) return !released;
    confirmed_.push(now, delivering());
    if (!poses_.empty()) drop_lost();
    if (!tentative_.empty()) [[unlikely]]
      catch_up(kCatchUp);
    if (entry == Entry::supported) stop(now);
    return !released;
  }

  // The same poses as one by one, and faster: each marker gets its events in groups.
  template <typename Stop>
  std::size_t push_many(std::span<const Event> events, const Stop& stop) {
    events = events.first(
        std::min({events.size(), kTogether * std::max<std::size_t>(confirmed_.size(), 1), kBetweenChecks}));
    std::size_t taken = 0;
    for (bool stopped = false; taken < events.size() && !stopped; ++taken) {
      const Event& event = events[taken];
      if (events.size() - taken > kAhead) prefetch(events[taken + kAhead]);
      if (check_due()) [[unlikely]]
        check_between();
      if (!guard_.passes(event.t) && guard_.releases(event.t)) [[unlikely]]
        break;
      ++statistics_.events;
      if (judge(event) != TimeGuard::Verdict::pass) [[unlikely]]
        continue;
      const Entry entry = enter(event);
      if (entry == Entry::off_sensor) continue;
      confirmed_.push_soon(event, delivering());
      if (entry == Entry::supported) stopped = stop(event);
    }
    confirmed_.push_waiting(delivering());
    if (!poses_.empty()) drop_lost();
    return taken;
  }

  // `searching_` is renewed after the same events, however many of them come together.
  bool check_due() const noexcept { return statistics_.events % kBetweenChecks == 0; }

  // With events waiting: those that may lose a marker go first.
  [[gnu::noinline]] void check_between() {
    confirmed_.push_decisive(delivering());
    if (confirmed_.any_lost()) {
      confirmed_.push_waiting(delivering());
      drop_lost();
    }
    searching_ = searching();
  }

  // With many markers, what an event looks up is all over the memory.
  [[gnu::always_inline]] void prefetch(const Event& event) const noexcept {
    if (!lines_.sensor_size().contains(event.x, event.y)) return;
    if constexpr (requires { filter_.prefetch(event); }) filter_.prefetch(event);
    lines_.prefetch(event);
  }

  // See TimeGuard::judge.
  TimeGuard::Verdict judge(const Event& event) noexcept {
    const bool usual = guard_.passes(event.t);
    const TimeGuard::Verdict verdict = guard_.judge(event);
    if (!usual) [[unlikely]]
      statistics_.time_faults = guard_.faults();
    return verdict;
  }

  // Counts, filters and stores an event whose time is right.
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
    schedule_.count_event();
    frame_.update(event);
    history_.push(event);
    return Entry::supported;
  }

  void catch_up(int events) {
    tentative_.catch_up(history_, events, statistics_);
    announce_confirmed();
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

  template <typename Use>
  void hand_over(const Use& use) {
    if (!poses_.empty()) by_time_.hand_over(poses_, use);
  }

  // The detector may find a lost marker again.
  void drop_lost() {
    confirmed_.remove_lost([&](PlanarHypotheses<Rule>& marker) {
      if (missing_.size() < settings_.max_markers) missing_.push_back(std::move(marker));
    });
  }

  // For a short time after its loss a marker is searched for where its motion must have taken it.
  void forget_missing(Timestamp t) {
    constexpr std::uint64_t kPredictable = 100000;  // [us]
    std::erase_if(missing_,
                  [&](const auto& marker) { return elapsed_us(marker.tracker().estimate().t, t) > kPredictable; });
  }

  // Announces the markers that were seen often enough and have caught up.
  void announce_confirmed() {
    tentative_.release_confirmed(settings_.detections_to_confirm, history_, [&](PlanarHypotheses<Rule>& marker) {
      if (marker.tracker().estimate().quality.matched > 0) deliver(marker.tracker().estimate());
      ++statistics_.registered;
      schedule_.note_found(last_t_);
      confirmed_.add(std::move(marker));
    });
  }

  // True if the detected marker is being tracked where it was detected. A marker that had no events while it is seen
  // elsewhere is lost: nothing moved where it is tracked. One that was never confirmed has followed something else.
  bool tracked(const MarkerDetection& detection) {
    if (const PlanarHypotheses<Rule>* const tentative = tentative_.find(detection.id)) {
      if (same_place(detection, tentative->tracker().T_camera_marker(), lines_.focal_length())) return true;
      tentative_.erase(detection.id);
      return false;
    }
    PlanarHypotheses<Rule>* const marker = confirmed_.find(detection.id);
    if (marker == nullptr) return false;
    const bool silent = marker->silent_until(detection.t, settings_.detection_interval);
    if (!silent || same_place(detection, marker->tracker().T_camera_marker(), lines_.focal_length())) return true;
    deliver(marker->tracker().lose(LossReason::replaced));
    confirmed_.erase(detection.id);
    return false;
  }

  Settings settings_;
  UndistortionTable lines_;
  TimeGuard guard_;
  Filter filter_;
  PolarityFrame frame_;
  EventHistory history_;
  DetectionSchedule schedule_;
  ConfirmedMarkers<Rule> confirmed_;  // announced
  TentativeMarkers<Rule> tentative_;
  std::vector<PlanarHypotheses<Rule>> missing_;  // lost a short time ago
  std::vector<PoseEstimate> poses_;
  ByTime by_time_;
  bool searching_ = true;  // as of the last check
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  std::uint64_t followable_since_ = 0;  // position in the history after which no events are missing
  TrackerStatistics statistics_;
};

}  // namespace evmarker
