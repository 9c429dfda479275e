#pragma once
// A marker from its detection on: followed from both poses that a plane allows, until the events decide.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <concepts>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "evmarker/detection/detection.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/pose_comparison.hpp"

namespace evmarker {

/// A planar marker has two poses that look alike from afar. Where its detection could not tell them apart both are
/// tracked, and none is called `tracking` before the events say which one it is.
template <PoseUpdateRule Rule>
class FoundMarker {
 public:
  /// @throws std::invalid_argument like MarkerTracker
  FoundMarker(const UndistortionTable& lines, const MarkerModel& model, const MarkerDetection& detection,
              const MarkerTrackerSettings<Rule>& settings)
      : tracker_(lines, model, detection.T_camera_marker, settings, detection.id) {
    if (!detection.T_camera_marker_alternative) return;
    rival_.emplace(lines, model, *detection.T_camera_marker_alternative, settings, detection.id);
    tracker_.set_ambiguous(true);
    rival_->set_ambiguous(true);
  }

  /// Takes one event, whose time has been judged already: see MarkerTracker::push_in_time.
  const PoseEstimate* push(const Event& event) noexcept {
    return rival_ ? push_to_both(event) : tracker_.push_one_in_time(event);
  }

  /// Takes many.
  template <std::invocable<const PoseEstimate&> Use>
  void push(std::span<const Event> events, const Use& use) {
    while (rival_ && !events.empty()) {
      if (const PoseEstimate* const pose = push(events.front())) use(*pose);
      events = events.subspan(1);
    }
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
  /// Whether it has had no event for so long at time t, or has those of a time to come, before the camera was started
  /// anew.
  bool silent_until(Timestamp t, std::chrono::microseconds interval) const noexcept {
    const Timestamp heard = tracker_.estimate().t;
    constexpr std::uint64_t kRestart_us = 1000000;
    return heard < t ? elapsed_us(heard, t) > static_cast<std::uint64_t>(interval.count())
                     : elapsed_us(t, heard) > kRestart_us;
  }
  bool lost() const noexcept { return tracker_.state() == TrackingState::lost; }

 private:
  // A rule that knows no motion jitters by more than the poses differ: to wait would not tell more.
  static constexpr int kToDecide = MotionEstimatingRule<Rule> ? std::numeric_limits<int>::max() : 2000;
  static constexpr double kBeyondChance = 4;  // standard deviations
  static constexpr double kAlike_rad = 0.1;   // then it does not matter which

  // Not inlined: for some milliseconds after a detection only.
  [[gnu::noinline]] const PoseEstimate* push_to_both(const Event& event) noexcept {
    comparison_.add(tracker_.misfit_px2(event), rival_->misfit_px2(event));
    rival_->push_one_in_time(event);
    const PoseEstimate* const pose = tracker_.push_one_in_time(event);
    return pose && decided() && settle() ? &tracker_.tell() : pose;
  }

  bool decided() const noexcept {
    return lost() || rival_->state() == TrackingState::lost || std::abs(comparison_.z()) > kBeyondChance || alike() ||
           comparison_.events() >= kToDecide;
  }

  // Both have come to nearly the same pose.
  bool alike() const noexcept {
    const Eigen::Isometry3d &T = tracker_.T_camera_marker(), &other = rival_->T_camera_marker();
    double trace = 0;  // of the rotation between them
    for (int i = 0; i < 3; ++i) trace += dot(axis(T, i), axis(other, i));
    return trace > 1 + 2 * std::cos(kAlike_rad);
  }

  // True if the other pose was the right one.
  bool settle() noexcept {
    const bool better = rival_->state() != TrackingState::lost && (lost() || comparison_.z() < 0);
    if (better) std::swap(tracker_, *rival_);
    rival_.reset();
    tracker_.set_ambiguous(false);
    return better;
  }

  MarkerTracker<Rule> tracker_;
  std::optional<MarkerTracker<Rule>> rival_;
  PoseComparison comparison_;  // of both
};

}  // namespace evmarker
