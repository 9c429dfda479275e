#pragma once
// Tracks many markers, given what a detector finds: filter, register, track, verify, drop.
#include <algorithm>
#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/detection/detection_request.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/events/hot_pixels.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/events/time_guard.hpp"
#include "evmarker/matching/event_group.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/tracking/confirmed_markers.hpp"
#include "evmarker/tracking/detection_schedule.hpp"
#include "evmarker/tracking/event_preprocessor.hpp"
#include "evmarker/tracking/marker_range.hpp"
#include "evmarker/tracking/missing_markers.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/pose_outbox.hpp"
#include "evmarker/tracking/tentative_markers.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// A `Tracker` without its detector, for those who run the detector elsewhere: it says when a detection is due, and
/// takes the result whenever it arrives. Between detections nothing throws but the filter and `use`, and nothing
/// allocates unless nearly every event updates several overlapping markers; a copy has no memory in reserve and
/// allocates at first. If the filter throws, the core can only be destroyed.
///
/// The polarity frame, the detector, the history and with it tentative markers get only events that pass the noise
/// filter. Confirmed markers get all events: on the few pixels along their edges most events are real, and the filter
/// would remove the first ones of a slow edge. Events of hot pixels reach none of these, see HotPixels.
///
/// An event whose time is suspect waits for the next one, and is discarded if its time was wrong, see TimeGuard. A time
/// in which even the noise stops, see NoiseFloor, counts as a gap in which events were lost, like one that `skip_to`
/// reports.
template <PoseUpdateRule Rule = KalmanUpdate, EventFilter Filter = SpatiotemporalFilter>
class TrackerCore {
 public:
  using Settings = TrackerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting that is out of range
  template <CameraModel Camera>
  TrackerCore(const Camera& camera, const Settings& settings, Filter filter)
      : settings_((validate(settings), settings)),
        lines_of_sight_(camera),
        events_(camera.sensor_size(), std::move(filter), settings.history_events),
        schedule_(settings),
        confirmed_(lines_of_sight_, settings.max_markers),
        tentative_(settings.max_markers),
        missing_(settings.max_markers),
        // A pose for each of the at most kBetweenChecks events of `push_many`, and one for each marker that is lost or
        // announced. It grows only if nearly every event updates several overlapping markers.
        poses_(settings.max_markers + kBetweenChecks) {
    settings_.marker.start_search.reset();  // a detection has been fitted to the edges already
  }

  /// Tracks the first of the events, as many as can be tracked in one go; to be called again with the rest. Calls
  /// `use(pose)` with each pose that they lead to, in the order of the events, valid during the call.
  /// @param stop called with each event that has passed the noise filter; if it returns true, that event is the last
  /// one
  /// @return how many were taken: tracked, held back or discarded; 0 if an event that TimeGuard had held back was
  /// tracked instead
  template <std::predicate<const Event&> Stop, std::invocable<const PoseEstimate&> Use>
  std::size_t push(std::span<const Event> events, const Stop& stop, const Use& use) {
    if (events.empty()) return 0;
    // One by one as long as there are tentative markers, as each new event makes them replay a few past ones; and where
    // TimeGuard has to judge a time.
    const bool single = events.size() == 1 || !tentative_.empty() || !guard_.passes(events.front().t);
    const std::size_t taken = single ? push_one(events.front(), stop) : push_many(events, stop);
    deliver(use);
    return taken;
  }

  /// Time of the event that `push` would track first: of the one held back if `event` confirms it, else of `event`;
  /// nothing if `event` would be held back itself [us].
  std::optional<Timestamp> next_t(const Event& event) const noexcept { return guard_.next_t(event.t); }

  /// True while a marker that is not confirmed yet has not been given all events since its detection.
  bool behind() const noexcept { return !tentative_.caught_up(events_.history()); }

  /// Gives each of these markers at most `events` of the events that it has not had yet; to be called while no new
  /// events come.
  template <std::invocable<const PoseEstimate&> Use>
  void catch_up(int events, const Use& use) {
    catch_up(events);
    deliver(use);
  }

  /// Goes on after a gap: the events until `t`, the time of the next event, are missing. A gap up to
  /// MarkerTracker::kHarmlessGap is ignored. The result of a detection that was requested before
  /// the gap starts no tracker, as the events to replay are missing.
  template <std::invocable<const PoseEstimate&> Use>
  void skip_to(Timestamp t, const Use& use) {
    if (!is_harmful_gap(t)) return;
    guard_.restart(t);
    statistics_.time_faults = guard_.faults();
    skip_missing(t);
    deliver(use);
  }

  /// True if a detection should be requested now. False while a result is pending.
  /// @param t time of the last event that was tracked
  bool detection_due(Timestamp t) const noexcept { return schedule_.due(t, search_often_); }

  /// True while no marker is confirmed, one waits to be confirmed, or one was lost a short time ago.
  bool searching() const noexcept { return confirmed_.empty() || !tentative_.empty() || !missing_.empty(); }

  /// Makes a request to the detector about the present frame. From here on its result is pending.
  DetectionRequest request_detection(Timestamp t) {
    note_places_at_request();
    ++statistics_.detections;
    schedule_.begin(t);
    missing_.remove_unpredictable(t);
    DetectionRequest request{
        .t = t, .events_in_frame = events_.history().pushed(), .focal_length = lines_of_sight_.focal_length()};
    tentative_.request_sightings(request, events_.history());
    missing_.request_searches(request);
    for (const PlanarHypotheses<Rule>& marker : confirmed_.all())
      if (marker.tracker().state() == TrackingState::tracking)
        request.tracked.push_back({marker.id(), marker.tracker().pose_at(t).T_camera_marker});
    return request;
  }

  /// True once `detection_latency` has passed since the request.
  bool result_due(Timestamp t) const noexcept { return schedule_.result_due(t); }
  bool result_pending() const noexcept { return schedule_.running(); }
  /// Says that the pending result will not come.
  void cancel_detection() noexcept { schedule_.end(); }

  /// Takes the result of the pending detection: announces the markers that were seen often enough, and starts a tracker
  /// for each marker that is not tracked yet, with the events since the request.
  template <std::invocable<const PoseEstimate&> Use>
  void register_markers(const DetectionResult& result, const Use& use) {
    schedule_.end();
    confirmed_.free_memory();  // of dropped second poses, see PlanarHypotheses: on the event path none is freed
    statistics_.unusable_poses += result.unusable_poses;
    missing_.remove_detected(result);
    tentative_.add(result.sightings);
    announce_confirmed();  // by these sightings
    tentative_.remove_hopeless();
    // If events have gone missing since the frame was taken, what it shows cannot be followed to now, see skip_to.
    for (const MarkerId id : result.refused) drop(id, LossReason::refused);
    const bool followable = result.events_in_frame > followable_from_;
    if (followable)
      for (const DetectionResult::Marker& found : result.markers) {
        drop_contradicted(found);
        if (has_tracker(found.detection.id)) continue;
        if (confirmed_.size() + tentative_.size() == settings_.max_markers) continue;
        tentative_.add({PlanarHypotheses<Rule>(lines_of_sight_, found.model, found.detection, settings_.marker),
                        result.events_in_frame, events_.history()});
      }
    announce_confirmed();  // those just added, if one detection is enough
    move_lost_to_missing();
    search_often_ = searching();
    const bool contradicted = std::ranges::any_of(confirmed_.all(), &PlanarHypotheses<Rule>::detected_elsewhere);
    schedule_.note_all_tracked(result.all_tracked && !search_often_ && !contradicted);
    deliver(use);
  }

  const TrackerStatistics& statistics() const noexcept { return statistics_; }
  const PolarityFrame& polarity_frame() const noexcept { return events_.frame(); }
  /// Time of the last event whose time was right, see TimeGuard [us]; the least Timestamp before the first.
  Timestamp last_t() const noexcept { return last_t_; }
  /// The `MarkerTracker` of every confirmed marker, valid until the next call that is not const.
  MarkerRange<Rule> markers() const noexcept { return MarkerRange<Rule>(confirmed_.all()); }

 private:
  // Longer gaps count as this long, which fits into std::chrono::microseconds and is too long to be bridged.
  static constexpr std::uint64_t kLongestGap_us = 1000000000;
  static constexpr std::size_t kPerMarker = EventGroup::kMost;  // events in a batch per marker: about a group of each
  static constexpr std::size_t kBetweenChecks = HotPixels::kEventsPerUpdate;  // also the most of a batch
  static constexpr std::size_t kPrefetchDistance = 32;  // events: the memory is ready by then, and still cached
  static constexpr int kCatchUp = 2;  // events that a tentative marker replays for each new one: it is soon up to date

  using Verdict = typename EventPreprocessor<Filter>::Verdict;

  template <typename Stop>
  std::size_t push_one(const Event& event, const Stop& stop) {
    check_if_due();
    const TimeGuard::Verdict verdict = judge(event);
    if (verdict == TimeGuard::Verdict::release) {
      skip_outage(guard_.held().t);
      track(guard_.held(), stop);
      return 0;  // `event` is pushed again
    }
    ++statistics_.events;
    if (verdict == TimeGuard::Verdict::pass) track(event, stop);
    return 1;
  }

  // If no events came for so long that the sensor or its transmission must have failed, goes on as after a gap. What
  // the frame showed before may have moved away.
  void skip_outage(Timestamp t) {
    if (!is_harmful_gap(t) || !events_.is_outage(last_t_, t)) return;
    ++statistics_.outages;
    events_.clear_frame();
    skip_missing(t);
  }

  bool is_harmful_gap(Timestamp t) const noexcept {
    constexpr std::chrono::microseconds kHarmless = MarkerTracker<Rule>::kHarmlessGap;
    return t > last_t_ && elapsed_us(last_t_, t) > static_cast<std::uint64_t>(kHarmless.count());
  }

  // Events are missing from the last one to t.
  void skip_missing(Timestamp t) {
    const auto missing = std::chrono::microseconds(std::min<std::uint64_t>(elapsed_us(last_t_, t), kLongestGap_us));
    followable_from_ = events_.history().pushed();
    tentative_.skip(missing, events_.history());
    confirmed_.skip(missing, [this](const PoseEstimate& pose) { collect(pose); });
    move_lost_to_missing();
    search_often_ = searching();
  }

  // Tracks one event whose time has been checked.
  template <typename Stop>
  void track(const Event& event, const Stop& stop) {
    events_.count(std::span(&event, 1));  // before or after the rest alike: what counts as hot changes at checks only
    const Verdict verdict = preprocess(event);
    if (verdict == Verdict::discarded) return;
    confirmed_.push(event, [this](const PoseEstimate& pose) { collect(pose); });
    if (!poses_.empty()) move_lost_to_missing();  // a loss comes with a pose
    if (!tentative_.empty()) [[unlikely]]
      catch_up(kCatchUp);
    if (verdict == Verdict::accepted) stop(event);  // whatever it answers: no other event is taken
  }

  // The same poses as one by one, and faster: each marker gets its events in groups.
  template <typename Stop>
  std::size_t push_many(std::span<const Event> events, const Stop& stop) {
    check_if_due();
    const std::size_t together = kPerMarker * std::max<std::size_t>(confirmed_.size(), 1);
    const std::size_t until_check = kBetweenChecks - statistics_.events % kBetweenChecks;
    const std::size_t count = guard_.passing(events.first(std::min({events.size(), together, until_check})));
    std::size_t taken = 0;
    for (bool stopped = false; taken < count && !stopped; ++taken) {
      const Event& event = events[taken];
      if (events.size() - taken > kPrefetchDistance) prefetch(events[taken + kPrefetchDistance]);
      ++statistics_.events;  // here and not for the batch: the filter may throw
      const Verdict verdict = preprocess(event);
      if (verdict == Verdict::discarded) continue;
      confirmed_.enqueue(event, taken, collector());
      if (verdict == Verdict::accepted) stopped = stop(event);
    }
    events_.count(events.first(taken));
    guard_.passed(last_t_);
    confirmed_.flush(collector());
    if (!poses_.empty()) move_lost_to_missing();
    return taken;
  }

  // Does what is due before every kBetweenChecks-th event, counted over all events pushed and not by batch, so that the
  // schedule of detections and what counts as a hot pixel are the same however the events are batched.
  void check_if_due() noexcept {
    if (statistics_.events % kBetweenChecks != 0) return;
    search_often_ = searching();
    events_.update_hot_pixels();
  }

  // With many markers, what an event looks up is all over the memory.
  [[gnu::always_inline]] void prefetch(const Event& event) const noexcept {
    if (!lines_of_sight_.sensor_size().contains(event.x, event.y)) return;
    events_.prefetch(event);
    lines_of_sight_.prefetch(event);
  }

  // See TimeGuard::judge.
  TimeGuard::Verdict judge(const Event& event) noexcept {
    const bool usual = guard_.passes(event.t);
    const TimeGuard::Verdict verdict = guard_.judge(event);
    if (!usual) [[unlikely]]
      statistics_.time_faults = guard_.faults();
    return verdict;
  }

  // Filters an event whose time has been checked, and counts what becomes of it.
  [[gnu::always_inline]] Verdict preprocess(const Event& event) {
    statistics_.time_steps_back += event.t < last_t_;
    last_t_ = event.t;
    const Verdict verdict = events_.process(event, statistics_);
    if (verdict == Verdict::accepted) schedule_.count_event();
    return verdict;
  }

  void catch_up(int events) {
    tentative_.catch_up(events_.history(), events, statistics_);
    announce_confirmed();
  }

  // Puts a pose into the outbox: that of event `number` of a batch, see PoseOutbox.
  void collect(const PoseEstimate& pose, std::size_t number = 0) {
    poses_.add(pose, number);
    if (pose.quality.state == TrackingState::lost)
      ++statistics_.lost;
    else
      statistics_.matched += static_cast<std::uint64_t>(pose.quality.matched);
  }

  auto collector() noexcept {
    return [this](const PoseEstimate& pose, std::size_t number) { collect(pose, number); };
  }

  template <typename Use>
  void deliver(const Use& use) {
    if (!poses_.empty()) poses_.hand_over(use);
  }

  // Moves lost markers to those that the detector may find again.
  void move_lost_to_missing() {
    if (missing_.add_lost_of(confirmed_)) schedule_.note_all_tracked(false);
  }

  // Announces the markers that were seen often enough and have caught up.
  void announce_confirmed() {
    tentative_.release_confirmed(settings_.detections_to_confirm, events_.history(),
                                 [&](PlanarHypotheses<Rule>& marker) {
                                   // Without an update there is no pose to report yet.
                                   if (marker.tracker().estimate().quality.matched > 0)
                                     collect(marker.tracker().estimate());
                                   ++statistics_.registered;
                                   schedule_.note_found(last_t_);
                                   confirmed_.add(std::move(marker));
                                 });
  }

  void note_places_at_request() {
    at_request_.clear();
    const auto note = [&](const PlanarHypotheses<Rule>& marker) {
      at_request_.push_back({marker.id(), marker.tracker().T_camera_marker()});
    };
    std::ranges::for_each(confirmed_.all(), note);
    tentative_.for_each(note);
  }

  // True if a marker was detected elsewhere than its tracker had it when the frame was taken: not where it has it now,
  // as it may have moved by more than its size since. False if it was not tracked then.
  bool was_elsewhere(const DetectionResult::Marker& found) const {
    const auto then = std::ranges::find(at_request_, found.detection.id, &PlacedMarker::id);
    return then != at_request_.end() && !same_place(found, then->T_camera_marker);
  }

  bool has_tracker(MarkerId id) { return tentative_.find(id) != nullptr || confirmed_.find(id) != nullptr; }

  // Drops the tracker of a marker that was detected elsewhere: a tentative one at once, as it must have followed
  // something else; a confirmed one if it had no events lately, so that it may have been moved away unseen, or if it
  // was detected elsewhere again and again.
  void drop_contradicted(const DetectionResult::Marker& found) {
    const MarkerDetection& detection = found.detection;
    const bool away = was_elsewhere(found);
    if (tentative_.find(detection.id)) {
      if (away) tentative_.erase(detection.id);
      return;
    }
    PlanarHypotheses<Rule>* const marker = confirmed_.find(detection.id);
    if (marker == nullptr) return;
    const bool often = marker->count_detection(away);
    if (often || (away && marker->silent_for(settings_.detection_interval, detection.t)))
      drop(detection.id, LossReason::replaced);
  }

  // Drops the tracker of a marker, if it has one; it is not searched for near its last pose.
  void drop(MarkerId id, LossReason reason) {
    tentative_.erase(id);
    if (PlanarHypotheses<Rule>* const marker = confirmed_.find(id)) {
      collect(marker->tracker().lose(reason));
      confirmed_.erase(id);
    }
  }

  Settings settings_;
  UndistortionTable lines_of_sight_;
  TimeGuard guard_;
  EventPreprocessor<Filter> events_;
  DetectionSchedule schedule_;
  ConfirmedMarkers<Rule> confirmed_;  // announced
  TentativeMarkers<Rule> tentative_;
  MissingMarkers<Rule> missing_;
  PoseOutbox poses_;
  std::vector<PlacedMarker> at_request_;  // the markers, where they were at the last request to the detector
  bool search_often_ = true;              // `searching()` as of the last check, gap or result
  Timestamp last_t_ = std::numeric_limits<Timestamp>::min();
  std::uint64_t followable_from_ = 0;  // EventHistory::pushed() at the last gap: since then, none are missing
  TrackerStatistics statistics_;
};

}  // namespace evmarker
