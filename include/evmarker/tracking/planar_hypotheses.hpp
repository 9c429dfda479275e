#pragma once
// The two poses that a detection of a planar marker allows: both are tracked until the events decide.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/pose_comparison.hpp"

namespace evmarker {

/// One detected marker. From afar, a planar marker looks alike at two poses, mirrored in depth. Where the detection has
/// both, both are tracked, and the state stays `converging` until the events have decided between them, one is lost, or
/// they have become alike.
template <PoseUpdateRule Rule>
class PlanarHypotheses {
 public:
  /// @throws std::invalid_argument like MarkerTracker
  PlanarHypotheses(const UndistortionTable& lines_of_sight, const MarkerModel& model, const MarkerDetection& detection,
                   const MarkerTrackerSettings<Rule>& settings)
      : tracker_(lines_of_sight, model, detection.T_camera_marker, settings, detection.id, detection.t) {
    if (!detection.T_camera_marker_alternative) return;
    rival_.emplace(lines_of_sight, model, *detection.T_camera_marker_alternative, settings, detection.id, detection.t);
    set_ambiguous(true);
  }

  /// Takes events that a TimeGuard has passed, see MarkerTracker::push_checked.
  template <std::invocable<const PoseEstimate&, const Event&> Use>
  void push(std::span<const Event> events, const Use& use) {
    for (; ambiguous_ && !events.empty(); events = events.subspan(1))
      if (const PoseEstimate* const pose = push_to_both(events.front())) use(*pose, events.front());
    tracker_.push_checked(events, use);
  }
  /// The same for one event; returns a pose that is valid until the next push, or null.
  const PoseEstimate* push(const Event& event) noexcept {
    return ambiguous_ ? push_to_both(event) : tracker_.push_checked(event);
  }

  /// See MarkerTracker::skip. The marker is lost if both poses are.
  const PoseEstimate* skip(std::chrono::microseconds missing) noexcept {
    if (ambiguous_) rival_->skip(missing);
    const PoseEstimate* const lost_pose = tracker_.skip(missing);
    // A loss is not reported if the other pose goes on. A lost rival is dropped with the next pose, see
    // comparison_over().
    if (lost_pose && ambiguous_ && keep_better()) return nullptr;
    return lost_pose;
  }

  MarkerTracker<Rule>& tracker() noexcept { return tracker_; }
  const MarkerTracker<Rule>& tracker() const noexcept { return tracker_; }
  MarkerId id() const noexcept { return tracker_.id(); }
  /// See MarkerTracker::reach.
  Box reach(double border_cells = 0) const noexcept {
    Box reach = tracker_.reach(border_cells);
    if (ambiguous_) reach.extend(rival_->reach(border_cells));
    return reach;
  }
  /// See MarkerTracker::unchanged_by_next.
  bool unchanged_by_next(std::size_t events) const noexcept {
    return events == 0 || (!ambiguous_ && tracker_.unchanged_by_next(events));
  }
  /// True if its last event is more than `interval` before t, or more than 1 s after it, as when the camera was
  /// restarted.
  bool silent_for(std::chrono::microseconds interval, Timestamp t) const noexcept {
    const Timestamp last = tracker_.estimate().t;
    constexpr std::uint64_t kRestart_us = 1000000;
    return last < t ? elapsed_us(last, t) > static_cast<std::uint64_t>(interval.count())
                    : elapsed_us(t, last) > kRestart_us;
  }
  bool lost() const noexcept { return tracker_.state() == TrackingState::lost; }

  /// Counts a detection of its id, at its place or elsewhere. True after so many elsewhere in a row that the tracker
  /// must be following something else; fewer are enough while its state is not `tracking`.
  bool count_detection(bool elsewhere) noexcept {
    detected_elsewhere_ = elsewhere ? detected_elsewhere_ + 1 : 0;
    return detected_elsewhere_ >= (tracker_.state() == TrackingState::tracking ? kOftenElsewhere : kOftenInDoubt);
  }
  /// True if it was elsewhere at the last detection.
  bool detected_elsewhere() const noexcept { return detected_elsewhere_ > 0; }
  /// Frees the memory of the pose that was dropped, which `push` leaves.
  void free_memory() noexcept {
    if (!ambiguous_) rival_.reset();
  }

 private:
  // Its code may be read falsely elsewhere, and in the next frame again, but hardly so often in a row.
  static constexpr int kOftenElsewhere = 5, kOftenInDoubt = 2;
  // A rule without a motion model jitters by more than the poses differ: more events would not decide it either.
  static constexpr std::int64_t kMostEvents =
      MotionEstimatingRule<Rule> ? std::numeric_limits<std::int64_t>::max() : 2000;  // twenty of its averages
  static constexpr double kAlike_rad = 0.1;                                          // then it does not matter which

  // Not inlined: it is needed for some milliseconds after a detection only.
  [[gnu::noinline]] const PoseEstimate* push_to_both(const Event& event) noexcept {
    if (tracker_.follows_motion() && rival_->follows_motion())
      comparison_.add(tracker_.residual(event), rival_->residual(event));
    rival_->push_checked(event);
    const PoseEstimate* const pose = tracker_.push_checked(event);
    if (!pose) return nullptr;
    // Before the pose is handed on: a loss is not reported if the other pose goes on. If this pose is kept, it is
    // handed on as it is, still as ambiguous.
    if (comparison_over()) return keep_better() ? &tracker_.refresh_pose() : pose;
    tracker_.set_other_pose(rival_->T_camera_marker(), comparison_.probability_of_second());
    return &tracker_.refresh_pose();
  }

  // Decided or not.
  bool comparison_over() const noexcept {
    return lost() || rival_->state() == TrackingState::lost || comparison_.decided() || alike() ||
           comparison_.events() >= kMostEvents;
  }

  // True if both have nearly the same orientation: if they differ at all, it is in that.
  bool alike() const noexcept {
    const Eigen::Isometry3d &T = tracker_.T_camera_marker(), &other = rival_->T_camera_marker();
    double trace = 0;  // of the rotation between them
    for (int i = 0; i < 3; ++i) trace += dot(axis(T, i), axis(other, i));
    return trace > 1 + 2 * std::cos(kAlike_rad);
  }

  // Keeps the better pose and drops the other. True if the rival's was kept.
  bool keep_better() noexcept {
    const bool rival_is_better = rival_->state() != TrackingState::lost && (lost() || comparison_.second_is_nearer());
    if (rival_is_better) std::swap(tracker_, *rival_);
    set_ambiguous(false);
    if (!comparison_.decided()) tracker_.doubt_tilt(alike());
    return rival_is_better;
  }

  void set_ambiguous(bool ambiguous) noexcept {
    ambiguous_ = ambiguous;
    tracker_.set_ambiguous(ambiguous);
    rival_->set_ambiguous(ambiguous);
  }

  MarkerTracker<Rule> tracker_;
  std::optional<MarkerTracker<Rule>> rival_;  // at the other pose; still allocated when not ambiguous, see free_memory
  bool ambiguous_ = false;                    // both poses are tracked
  PoseComparison comparison_;
  int detected_elsewhere_ = 0;  // times in a row
};

}  // namespace evmarker
