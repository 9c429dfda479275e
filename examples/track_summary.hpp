#pragma once
// The summary at the end of a tracking program: counts, poses per marker, errors, time.
#include <cinttypes>
#include <cstdio>
#include <evmarker/evaluation/accuracy.hpp>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/recording_statistics.hpp>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

#include "recorded_time.hpp"
#include "recording_faults.hpp"

class TrackSummary {
 public:
  void add(std::span<const evmarker::Event> batch) {
    for (const evmarker::Event& event : batch) recorded_.add(event.t);
  }

  void add(const evmarker::PoseEstimate& pose, const std::optional<Eigen::Isometry3d>& truth) {
    Marker& marker = markers_[pose.id];
    if (marker.poses++ == 0) marker.first_t = pose.t;
    if (pose.quality.state == evmarker::TrackingState::lost) ++marker.losses[pose.quality.loss_reason];
    if (truth) marker.accuracy.add(pose, *truth);
    ++poses_;
    compared_ += truth.has_value();
  }

  std::uint64_t poses() const { return poses_; }
  /// From the first event to the last, whatever single times say [s].
  double recorded_s() const { return recorded_.seconds(); }

  /// @throws std::runtime_error where there are poses, but none of their markers is in the truth
  void require_compared(const std::string& truth_path) const {
    if (poses_ == 0 || compared_ > 0) return;
    std::string ids;
    for (const auto& [id, marker] : markers_) ids += (ids.empty() ? "" : ", ") + std::to_string(id);
    throw std::runtime_error(truth_path + ": no true pose at the time of any of the " + std::to_string(poses_) +
                             " poses of marker " + ids);
  }

  void print(const evmarker::io::RecordingStatistics& recording, const evmarker::TrackerStatistics& tracker,
             double wall_s) const {
    const auto share = [&](std::uint64_t n) {
      return 100.0 * static_cast<double>(n) / static_cast<double>(tracker.events);
    };
    const std::uint64_t kept = tracker.events - tracker.off_sensor - tracker.hot - tracker.filtered;
    if (tracker.events > 0)
      std::printf("events     %" PRIu64 " read, %" PRIu64 " kept by the filter (%.0f %%), %" PRIu64
                  " matched (%.0f %%)\n",
                  tracker.events, kept, share(kept), tracker.matched, share(tracker.matched));
    print_faults(recording, tracker);
    recording_faults::print(recorded_.stray(), recording_faults::kStray);
    for (const auto& [id, marker] : markers_) print(id, marker);
    std::printf("time       %.2f s for %.2f s of recording\n", wall_s, recorded_s());
  }

 private:
  struct Marker {
    std::uint64_t poses = 0;
    std::map<evmarker::LossReason, std::uint64_t> losses;
    evmarker::Timestamp first_t = 0;
    evmarker::AccuracyMeter accuracy;
  };

  static void print_faults(const evmarker::io::RecordingStatistics& recording,
                           const evmarker::TrackerStatistics& tracker) {
    recording_faults::print(recording);
    recording_faults::print(tracker.outages, "outages, in which even the noise has stopped");
    recording_faults::print(tracker.hot, "events of hot pixels, dropped");
  }

  // As "lost 3 times: 2 hidden, 1 verification".
  static std::string text(const std::map<evmarker::LossReason, std::uint64_t>& losses) {
    std::uint64_t sum = 0;
    std::string reasons;
    for (const auto& [reason, count] : losses) {
      sum += count;
      reasons += (reasons.empty() ? ": " : ", ") + std::to_string(count) + ' ' + to_string(reason);
    }
    return "lost " + std::to_string(sum) + " times" + reasons;
  }

  void print(evmarker::MarkerId id, const Marker& marker) const {
    std::printf("marker %-3d %" PRIu64 " poses, the first at %.3f s, %s\n", id, marker.poses,
                static_cast<double>(evmarker::elapsed_us(recorded_.begin(), marker.first_t)) * 1e-6,
                text(marker.losses).c_str());
    if (marker.accuracy.tracking() == 0) return;
    const auto mm = marker.accuracy.translation_mm(), deg = marker.accuracy.rotation_deg();
    std::printf("           error %.2f mm %.2f deg mean, %.2f mm %.2f deg median, %.2f mm %.2f deg at 95 %%\n", mm.mean,
                deg.mean, mm.median, deg.median, mm.p95, deg.p95);
    std::printf("           tracked in %.1f %% of the 10 ms slots since the first pose\n",
                100 * marker.accuracy.coverage(recorded_.end()));
  }

  std::uint64_t poses_ = 0, compared_ = 0;
  RecordedTime recorded_;
  std::map<evmarker::MarkerId, Marker> markers_;
};
