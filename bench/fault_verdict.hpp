#pragma once
// What a tracker made of a recording with faults: wrong poses, losses, and how soon it tracked again.
#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "injected_faults.hpp"
#include "scenarios.hpp"
#include "verdict.hpp"

namespace evmarker::bench {

/// Sums over the recordings with one fault.
class FaultVerdict {
 public:
  /// Takes the poses of one more recording.
  void begin_recording() { poses_.clear(); }

  /// @param clock_ahead_us how far the clock of the events that led to the pose is ahead of the recording's
  void add(const Situation& situation, PoseEstimate pose, Timestamp clock_ahead_us) {
    pose.t -= clock_ahead_us;
    const JudgedPose judged = judge(pose, situation.truth(0, pose.t));
    poses_.push_back(judged);
    if (judged.state == TrackingState::lost) ++losses_[static_cast<std::size_t>(pose.quality.loss_reason)];
    if (!judged.tracking()) return;
    ++tracking_;
    wrong_ += judged.wild();
    worst_.translation_mm = std::max(worst_.translation_mm, judged.error.translation_mm);
    worst_.rotation_deg = std::max(worst_.rotation_deg, judged.error.rotation_deg);
  }

  /// To be called when a recording has ended, with the moments at which its faults began.
  void end_recording(std::span<const Timestamp> moments, Timestamp fault_us) {
    for (const WildStretch& stretch : wild_stretches(poses_, Verdict::kSlot))
      longest_wrong_ms_ = std::max(longest_wrong_ms_, stretch.length_ms);
    for (std::size_t i = 0; i < moments.size(); ++i) {
      const Timestamp until = i + 1 < moments.size() ? moments[i + 1] : std::numeric_limits<Timestamp>::max();
      settled_ms_ = std::max(settled_ms_, settled_ms(moments[i], moments[i] + fault_us, until));
    }
  }

  std::size_t tracking() const { return tracking_; }
  /// Poses that are called `tracking` and are far from the truth, see JudgedPose::wild.
  std::size_t wrong() const { return wrong_; }
  /// Longest time in which all poses were wrong.
  double longest_wrong_ms() const { return longest_wrong_ms_; }
  /// Largest errors of the poses that are called `tracking`.
  const PoseError& worst() const { return worst_; }
  /// Longest time from the end of a fault until the marker was tracked for 0.1 s on end; infinite if it never was.
  double settled_ms() const { return settled_ms_; }

  /// How often the marker was lost and why, as "2 hidden, 1 verification".
  std::string losses() const {
    std::string text;
    for (std::size_t reason = 0; reason < losses_.size(); ++reason)
      if (losses_[reason] > 0)
        text += (text.empty() ? "" : ", ") + std::to_string(losses_[reason]) + " " +
                to_string(static_cast<LossReason>(reason));
    return text.empty() ? "-" : text;
  }

 private:
  // The first pose `tracking` after the fault behind which, for 0.1 s, there is none of another state. Later doubts
  // have other reasons.
  double settled_ms(Timestamp begin, Timestamp end, Timestamp until) const {
    constexpr double kOnEnd_ms = 100;
    double settled = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      const JudgedPose& pose = poses_[i];
      // A loss has the time of the last event on or near the marker, and is reported with one after the fault.
      const bool loss = pose.state == TrackingState::lost;
      const Timestamp t = loss && i + 1 < poses_.size() ? poses_[i + 1].t : pose.t;
      if (t < begin || t >= until) continue;
      if (settled + kOnEnd_ms < 1e-3 * static_cast<double>(t - end)) break;
      if (!pose.tracking())
        settled = std::numeric_limits<double>::infinity();
      else if (pose.t >= end && settled == std::numeric_limits<double>::infinity())
        settled = 1e-3 * static_cast<double>(pose.t - end);
    }
    return settled;
  }

  std::vector<JudgedPose> poses_;  // of the recording that is going on
  std::array<std::size_t, kLossReasons> losses_{};
  std::size_t tracking_ = 0, wrong_ = 0;
  PoseError worst_;
  double settled_ms_ = 0, longest_wrong_ms_ = 0;
};

}  // namespace evmarker::bench
