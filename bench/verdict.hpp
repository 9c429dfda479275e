#pragma once
// Compares a method's poses with the truth of a recording.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "scenarios.hpp"

namespace evmarker::bench {

/// A pose compared with the truth.
struct JudgedPose {
  Timestamp t = 0;
  TrackingState state = TrackingState::tracking;
  PoseError error;
  double nees = std::numeric_limits<double>::quiet_NaN();

  bool tracking() const { return state == TrackingState::tracking; }
  bool wild() const { return tracking() && !(error.translation_mm <= 50 && error.rotation_deg <= 20); }
};

inline JudgedPose judge(const PoseEstimate& pose, const Eigen::Isometry3d& truth) {
  return {pose.t, pose.quality.state, pose_error(pose.T_camera_marker, truth), nees(pose, truth)};
}

/// All results of a method on one recording.
struct Run {
  std::vector<std::vector<JudgedPose>> markers;  ///< by place in the scene, in order of time
  std::vector<JudgedPose> strangers;             ///< poses of ids that are not in the scene
  std::vector<MarkerId> stranger_ids;
  std::uint64_t events = 0;
  double track_s = 0, detect_s = 0;  ///< processor time of events and of detections
  double pose_interval_us = 0;       ///< between the frames that a frame method uses

  explicit Run(std::size_t marker_count = 0) : markers(marker_count) {}

  void add(const Situation& situation, const PoseEstimate& pose) {
    const auto& known = situation.scene.markers;
    const auto marker = std::ranges::find(known, pose.id, &SimulatedMarker::id);
    if (marker == known.end()) {
      strangers.push_back({pose.t, pose.quality.state, {}});
      stranger_ids.push_back(pose.id);
      return;
    }
    const auto index = static_cast<std::size_t>(marker - known.begin());
    markers[index].push_back(judge(pose, situation.truth(index, pose.t)));
  }
};

/// A time in which every pose was wild.
struct WildStretch {
  Timestamp begin = 0;
  double length_ms = 0;
};

/// A pose holds until the next one, but no longer than `longest_us`.
inline std::vector<WildStretch> wild_stretches(const std::vector<JudgedPose>& poses, Timestamp longest_us) {
  std::vector<WildStretch> found;
  for (std::size_t i = 0; i < poses.size();) {
    if (!poses[i].wild()) {
      ++i;
      continue;
    }
    const Timestamp begin = poses[i].t;
    Timestamp end = begin;
    for (bool linked = true; linked && i < poses.size() && poses[i].wild(); ++i) {
      end = poses[i].t + longest_us;
      if (i + 1 < poses.size()) end = std::min(end, poses[i + 1].t);
      linked = i + 1 < poses.size() && end == poses[i + 1].t;
    }
    found.push_back({begin, static_cast<double>(end - begin) * 1e-3});
  }
  return found;
}

/// When a marker was out of sight: nothing of it is visible from `gone` on, something from `returning` on, and all of
/// it from `back` on.
struct Absence {
  Timestamp gone, returning, back;
};

inline std::vector<Absence> absences(const Situation& situation, std::size_t marker) {
  std::vector<Absence> found;
  constexpr Timestamp kHere = -1;
  Absence absence{kHere, kHere, kHere};
  const auto end = static_cast<Timestamp>(situation.simulator.duration_s * 1e6);
  for (Timestamp t = 0; t < end; t += 1000) {
    const double share = visible_share(situation, marker, static_cast<double>(t) * 1e-6);
    if (share == 0) absence = {absence.gone == kHere ? t : absence.gone, kHere, kHere};
    if (absence.gone != kHere && share > 0 && absence.returning == kHere) absence.returning = t;
    if (share < 1 || absence.gone == kHere) continue;
    absence.back = t;
    found.push_back(absence);
    absence = {kHere, kHere, kHere};
  }
  return found;
}

/// Something that a developer of trackers should inspect.
struct Incident {
  std::string what;
  std::size_t marker;
  Timestamp t;
  double value;
};

/// Sums over the markers and seeds of a scenario.
class Verdict {
 public:
  static constexpr Timestamp kSlot = 10000;  // [us]

  void add(const Situation& situation, const Run& run) {
    for (std::size_t marker = 0; marker < run.markers.size(); ++marker) add_marker(situation, run, marker);
    strangers_ += run.strangers.size();
    for (std::size_t i = 0; i < run.strangers.size(); ++i)
      note("stranger", static_cast<std::size_t>(run.stranger_ids[i]), run.strangers[i].t, 0);
    events_ += run.events;
    track_s_ += run.track_s;
    detect_s_ += run.detect_s;
    simulated_s_ += situation.simulator.duration_s;
  }

  Spread translation_mm() const { return Spread::of(translation_mm_); }
  Spread rotation_deg() const { return Spread::of(rotation_deg_); }
  Spread nees() const { return Spread::of(nees_); }  ///< per degree of freedom
  bool has_nees() const { return !nees_.empty(); }
  /// Share of the 10 ms slots from the first pose on, all of the marker in sight, that hold a `tracking` pose.
  double coverage() const { return slots_ > 0 ? static_cast<double>(covered_) / static_cast<double>(slots_) : 0; }
  int markers() const { return markers_; }
  int found() const { return found_; }  ///< markers that ever had a pose
  double first_ms() const { return Spread::of(first_ms_).mean; }
  double latest_first_ms() const { return Spread::of(first_ms_).max; }
  std::size_t tracking() const { return translation_mm_.size(); }
  double poses_per_s() const { return markers_ > 0 ? static_cast<double>(tracking()) / marker_seconds_ : 0; }
  std::size_t wild() const { return wild_; }
  double longest_wild_ms() const { return longest_wild_ms_; }
  std::size_t lost() const { return lost_; }
  std::size_t strangers() const { return strangers_; }
  int absences() const { return absences_; }
  double lost_late_ms() const { return lost_late_ms_; }  ///< longest that a marker out of sight was still tracked
  double back_late_ms() const { return back_late_ms_; }  ///< longest from all in sight again to `tracking`; inf never
  double ns_per_event() const { return events_ > 0 ? 1e9 * track_s_ / static_cast<double>(events_) : 0; }
  double detection_share() const { return simulated_s_ > 0 ? detect_s_ / simulated_s_ : 0; }  ///< of real time
  std::uint64_t events() const { return events_; }
  const std::vector<Incident>& incidents() const { return incidents_; }

 private:
  void note(const char* what, std::size_t marker, Timestamp t, double value) {
    incidents_.push_back({what, marker, t, value});
  }

  void add_marker(const Situation& situation, const Run& run, std::size_t marker) {
    const auto& poses = run.markers[marker];
    const double duration_s = situation.simulator.duration_s;
    ++markers_;
    marker_seconds_ += duration_s;
    if (poses.empty()) {
      note("never_found", marker, 0, 0);
      return;
    }
    ++found_;
    first_ms_.push_back(static_cast<double>(poses.front().t) * 1e-3);
    note("first", marker, poses.front().t, poses.front().error.translation_mm);
    for (const JudgedPose& pose : poses) {
      if (pose.state == TrackingState::lost) {
        ++lost_;
        note("lost", marker, pose.t, pose.error.translation_mm);
      }
      if (!pose.tracking()) continue;
      translation_mm_.push_back(pose.error.translation_mm);
      rotation_deg_.push_back(pose.error.rotation_deg);
      if (std::isfinite(pose.nees)) nees_.push_back(pose.nees);
      wild_ += pose.wild();
    }
    add_wild_stretches(poses, marker);
    add_slots(situation, poses, marker);
    for (const Absence& absence : bench::absences(situation, marker)) add_absence(absence, poses, marker);
  }

  void add_wild_stretches(const std::vector<JudgedPose>& poses, std::size_t marker) {
    for (const WildStretch& stretch : wild_stretches(poses, kSlot)) {
      longest_wild_ms_ = std::max(longest_wild_ms_, stretch.length_ms);
      note("wild_ms", marker, stretch.begin, stretch.length_ms);
    }
  }

  void add_slots(const Situation& situation, const std::vector<JudgedPose>& poses, std::size_t marker) {
    const Timestamp first = poses.front().t;
    const auto end = static_cast<Timestamp>(situation.simulator.duration_s * 1e6);
    auto pose = poses.begin();
    Timestamp gap_begin = -1;
    const auto close_gap = [&](Timestamp t) {
      if (gap_begin >= 0 && t - gap_begin > 2 * kSlot)
        note("gap_ms", marker, gap_begin, static_cast<double>(t - gap_begin) * 1e-3);
      gap_begin = -1;
    };
    for (Timestamp slot = first; slot + kSlot <= end; slot += kSlot) {
      bool covered = false;
      for (; pose != poses.end() && pose->t < slot + kSlot; ++pose) covered = covered || pose->tracking();
      bool in_sight = true;
      for (const Timestamp t : {slot, slot + kSlot / 2, slot + kSlot})
        in_sight = in_sight && visible_share(situation, marker, static_cast<double>(t) * 1e-6) == 1;
      if (covered || !in_sight) close_gap(slot);
      if (!in_sight) continue;
      ++slots_;
      covered_ += covered;
      if (!covered && gap_begin < 0) gap_begin = slot;
    }
    close_gap(end);
  }

  void add_absence(const Absence& absence, const std::vector<JudgedPose>& poses, std::size_t marker) {
    ++absences_;
    double late_ms = 0, back_ms = std::numeric_limits<double>::infinity();
    for (const JudgedPose& pose : poses) {
      if (!pose.tracking()) continue;
      if (pose.t >= absence.gone && pose.t < absence.returning)
        late_ms = static_cast<double>(pose.t - absence.gone) * 1e-3;
      if (pose.t >= absence.back && std::isinf(back_ms)) back_ms = static_cast<double>(pose.t - absence.back) * 1e-3;
    }
    lost_late_ms_ = std::max(lost_late_ms_, late_ms);
    back_late_ms_ = std::max(back_late_ms_, back_ms);
    note("lost_late_ms", marker, absence.gone, late_ms);
    note("back_late_ms", marker, absence.back, back_ms);
  }

  std::vector<double> translation_mm_, rotation_deg_, nees_, first_ms_;
  int markers_ = 0, found_ = 0, absences_ = 0;
  std::size_t slots_ = 0, covered_ = 0, wild_ = 0, lost_ = 0, strangers_ = 0;
  double longest_wild_ms_ = 0, lost_late_ms_ = 0, back_late_ms_ = 0, marker_seconds_ = 0, simulated_s_ = 0;
  double track_s_ = 0, detect_s_ = 0;
  std::uint64_t events_ = 0;
  std::vector<Incident> incidents_;
};

}  // namespace evmarker::bench
