#pragma once
// The two poses that a detection of a planar marker allows: both are tracked until the events decide.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <concepts>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/pose_comparison.hpp"

namespace evmarker {

/// One detected marker. From afar, a planar marker looks alike at two poses, mirrored in depth. Where the detection has
/// both, both are tracked, and the state stays `converging` until the events have decided between them.
template <PoseUpdateRule Rule>
class PlanarHypotheses {
 public:
  /// @throws std::invalid_argument like MarkerTracker
  PlanarHypotheses(const UndistortionTable& lines, const MarkerModel& model, const MarkerDetection& detection,
                   const MarkerTrackerSettings<Rule>& settings)
      : tracker_(lines, model, detection.T_camera_marker, settings, detection.id) {
    if (!detection.T_camera_marker_alternative) return;
    rival_.emplace(lines, model, *detection.T_camera_marker_alternative, settings, detection.id);
    tracker_.set_ambiguous(true);
    rival_->set_ambiguous(true);
  }

  /// Takes events whose times have been judged, see MarkerTracker::push_in_time.
  template <std::invocable<const PoseEstimate&> Use>
  void push(std::span<const Event> events, const Use& use) {
    for (; rival_ && !events.empty(); events = events.subspan(1)) push_to_both(events.front(), use);
    tracker_.push_in_time(events, use);
  }

  /// See MarkerTracker::skip.
  const PoseEstimate* skip(std::chrono::microseconds missing) noexcept {
    if (rival_) rival_->skip(missing);
    return tracker_.skip(missing);
  }

  MarkerTracker<Rule>& tracker() noexcept { return tracker_; }
  const MarkerTracker<Rule>& tracker() const noexcept { return tracker_; }
  MarkerId id() const noexcept { return tracker_.id(); }
  /// See MarkerTracker::reach.
  Box reach(double around = 0) const noexcept { return rival_ ? Box::everywhere() : tracker_.reach(around); }
  /// See MarkerTracker::stays.
  bool stays(std::size_t events) const noexcept { return events == 0 || (!rival_ && tracker_.stays(events)); }
  /// True if its last event is older than `interval` at time t, or in the future: the camera was started anew.
  bool silent_until(Timestamp t, std::chrono::microseconds interval) const noexcept {
    const Timestamp heard = tracker_.estimate().t;
    constexpr std::uint64_t kRestart_us = 1000000;
    return heard < t ? elapsed_us(heard, t) > static_cast<std::uint64_t>(interval.count())
                     : elapsed_us(t, heard) > kRestart_us;
  }
  bool lost() const noexcept { return tracker_.state() == TrackingState::lost; }

 private:
  // A rule without a motion model jitters by more than the poses differ: more events would not decide it either.
  static constexpr int kMostEvents = MotionEstimatingRule<Rule> ? std::numeric_limits<int>::max() : 2000;
  static constexpr double kBeyondChance = 4;  // standard deviations
  static constexpr double kAlike_rad = 0.1;   // then it does not matter which

  // Not inlined: it is needed for some milliseconds after a detection only.
  template <typename Use>
  [[gnu::noinline]] void push_to_both(const Event& event, const Use& use) {
    const std::span<const Event> one(&event, 1);
    comparison_.add(tracker_.misfit_px2(event), rival_->misfit_px2(event));
    rival_->push_in_time(one, [](const PoseEstimate&) {});
    bool updated = false;
    PoseEstimate pose;
    tracker_.push_in_time(one, [&](const PoseEstimate& last) {
      updated = true;
      pose = last;
    });
    if (!updated) return;
    if (decided() && decide()) pose = tracker_.estimate();
    use(pose);
  }

  bool decided() const noexcept {
    return lost() || rival_->state() == TrackingState::lost || std::abs(comparison_.z()) > kBeyondChance || alike() ||
           comparison_.events() >= kMostEvents;
  }

  // True if both have converged to nearly the same pose.
  bool alike() const noexcept {
    const Eigen::Isometry3d &T = tracker_.T_camera_marker(), &other = rival_->T_camera_marker();
    double trace = 0;  // of the rotation between them
    for (int i = 0; i < 3; ++i) trace += dot(axis(T, i), axis(other, i));
    return trace > 1 + 2 * std::cos(kAlike_rad);
  }

  // Goes on with the better pose. True if that is the rival's.
  bool decide() noexcept {
    const bool better = rival_->state() != TrackingState::lost && (lost() || comparison_.z() < 0);
    if (better) std::swap(tracker_, *rival_);
    rival_.reset();
    tracker_.set_ambiguous(false);
    return better;
  }

  MarkerTracker<Rule> tracker_;
  std::optional<MarkerTracker<Rule>> rival_;
  PoseComparison comparison_;
};

}  // namespace evmarker
